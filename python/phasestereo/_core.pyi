"""The compiled core: validated again here, so that no argument can make it panic."""

from collections.abc import Callable
from typing import final

import numpy as np
from numpy.typing import NDArray

from phasestereo._images import Pixels
from phasestereo.blur import Kind
from phasestereo.equalisation import Equalisation
from phasestereo.settings import Settings

__all__ = [
    "DEBUG_BUILD",
    "FLAGS",
    "Workers",
    "__version__",
    "aggregate_volume",
    "check_settings",
    "check_versions",
    "cost_volume",
    "descriptor",
    "estimate_blur",
    "match_pair",
    "optimize_volume",
    "simd_level",
]

__version__: str
DEBUG_BUILD: bool
FLAGS: dict[str, int]

@final
class Workers:
    def __new__(cls, threads: int | None) -> Workers: ...
    @property
    def count(self) -> int: ...

def check_settings(settings: Settings) -> None: ...
def check_versions(versions: Equalisation | None) -> None: ...
def estimate_blur(
    images: tuple[Pixels, Pixels],
    masks: tuple[NDArray[np.bool_] | None, NDArray[np.bool_] | None],
    disparities: tuple[int, int],
    threads: int | Workers | None,
) -> tuple[
    list[tuple[int, Kind, float, float, NDArray[np.float64] | None]],
    NDArray[np.uint8],
    int,
    float,
    float,
    tuple[float, float],
]: ...
def match_pair(
    images: tuple[Pixels, Pixels],
    masks: tuple[NDArray[np.bool_] | None, NDArray[np.bool_] | None],
    disparities: tuple[int, int],
    settings: Settings,
    threads: int | Workers | None,
    progress: Callable[[int, int], object] | None,
    versions: Equalisation | None,
) -> tuple[
    NDArray[np.float32], NDArray[np.uint16], NDArray[np.float32] | None, dict[str, float]
]: ...
def descriptor(
    image: Pixels,
    mask: NDArray[np.bool_] | None,
    settings: Settings,
    threads: int | None,
    noise: float | None,
) -> NDArray[np.uint16] | NDArray[np.uint32] | NDArray[np.uint64]: ...
def cost_volume(
    images: tuple[Pixels, Pixels],
    disparities: tuple[int, int],
    settings: Settings,
    threads: int | None,
    versions: Equalisation | None,
) -> NDArray[np.uint16]: ...
def aggregate_volume(costs: NDArray[np.uint16], settings: Settings) -> NDArray[np.uint32]: ...
def optimize_volume(
    costs: NDArray[np.uint32], settings: Settings, penalty: tuple[int, int]
) -> NDArray[np.uint16]: ...
def simd_level() -> str: ...

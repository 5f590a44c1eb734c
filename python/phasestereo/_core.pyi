"""The compiled core. It validates arguments again, so that none can make it panic."""

from collections.abc import Callable, Sequence
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from phasestereo._devices import Device
from phasestereo._images import Pixels
from phasestereo.known import Known, Noise
from phasestereo.result import Result
from phasestereo.rig.alignment import Alignment
from phasestereo.rig.compensation import BlurCompensation
from phasestereo.rig.estimates import Estimates
from phasestereo.second import SecondMatcher
from phasestereo.settings import Settings
from phasestereo.verification import Verification
from phasestereo_large.bands import Checked, PairStatistics

__all__ = [
    "BAND_ROWS",
    "DEBUG_BUILD",
    "DECISIVE_TOPICS",
    "FLAGS",
    "LARGER",
    "LEAST_SIZE",
    "MOST_CLASSES",
    "MOST_DISPARITIES",
    "MUCH_LARGER",
    "NO_DEPTH",
    "PRESETS",
    "SETTINGS",
    "VERDICTS",
    "Back",
    "Ready",
    "Rig",
    "Scale",
    "Setting",
    "TemporalFilter",
    "Workers",
    "__version__",
    "aggregate_volume",
    "check_blur_compensation",
    "check_noise",
    "check_settings",
    "cost_volume",
    "descriptor",
    "estimate_pair",
    "estimate_pair_by_rows",
    "find_borders",
    "find_overlays",
    "find_roughness",
    "find_scale",
    "fit_right",
    "halo",
    "kept_pixels",
    "match_pair",
    "match_raw",
    "match_rows",
    "observe_maps",
    "optimize_volume",
    "prepare_pair",
    "preset",
    "rays_of_pixels",
    "rectify_pairs",
    "register_depths",
    "release_memory",
    "rows_to_tally",
    "self_check",
    "simd_level",
    "verify_map",
    "working_memory",
]

__version__: str
BAND_ROWS: int
DEBUG_BUILD: bool
DECISIVE_TOPICS: list[str]
FLAGS: dict[str, int]
LARGER: int
MUCH_LARGER: int
NO_DEPTH: str
LEAST_SIZE: int
MOST_CLASSES: int
MOST_DISPARITIES: int
PRESETS: list[str]
SETTINGS: list[Setting]
VERDICTS: dict[str, int]

@final
class Scale:
    @property
    def packing(self) -> tuple[float, int, bool, bool]: ...
    @property
    def ranges(self) -> tuple[tuple[float, float], tuple[float, float]] | None: ...

@final
class Setting:
    @property
    def name(self) -> str: ...
    @property
    def annotation(self) -> str: ...
    @property
    def summary(self) -> str: ...
    @property
    def text(self) -> str: ...
    @property
    def choices(self) -> list[tuple[str, str]]: ...

@final
class Rig:
    def __new__(cls, written: str | None) -> Rig: ...
    @property
    def text(self) -> str: ...
    @property
    def frames(self) -> int: ...
    @property
    def health(self) -> float: ...
    @property
    def events(self) -> list[tuple[str, int, str]]: ...
    @property
    def disparities(self) -> tuple[int, int] | None: ...
    @property
    def field(self) -> Alignment | None: ...
    def check(
        self, limits: list[tuple[str, float]], focal: float | None
    ) -> list[tuple[str, str, str, float, float, bool | None]]: ...
    @property
    def cameras(self) -> tuple[dict[str, NDArray[np.float64]], tuple[int, int]] | None: ...

@final
class TemporalFilter:
    def __new__(cls) -> TemporalFilter: ...

@final
class Back:
    def __new__(cls, written: str) -> Back: ...
    @property
    def text(self) -> str: ...
    @property
    def size(self) -> tuple[int, int]: ...
    @property
    def prepared_size(self) -> tuple[int, int]: ...
    def restored(self, disparity: NDArray[np.float32]) -> NDArray[np.float32]: ...

@final
class Ready: ...

@final
class Workers:
    def __new__(cls, threads: int | None, device: Device | None = None) -> Workers: ...
    @property
    def count(self) -> int: ...

def check_settings(settings: Settings) -> None: ...
def check_noise(noise: Noise) -> None: ...
def check_blur_compensation(compensation: BlurCompensation | None) -> None: ...
def estimate_pair(
    images: tuple[Pixels, Pixels],
    masks: tuple[NDArray[np.bool_] | None, NDArray[np.bool_] | None],
    disparities: tuple[int, int | None],
    settings: Settings,
    threads: int | Workers | None,
    self_rectify: bool,
) -> Estimates: ...
def kept_pixels(
    keep: str,
    disparity: NDArray[np.float32],
    flags: NDArray[np.uint16],
    confidence: NDArray[np.float32] | None,
    wrong: float,
) -> NDArray[np.bool_]: ...
def rays_of_pixels(
    pixels: NDArray[np.float64], lens: tuple[NDArray[np.float64], list[float], bool]
) -> NDArray[np.float64]: ...
def register_depths(
    depth: NDArray[np.float32],
    others: Sequence[NDArray[np.float32]],
    left: tuple[tuple[float, float], tuple[float, float], float],
    lens: tuple[NDArray[np.float64], list[float], bool],
    pose: tuple[NDArray[np.float64], NDArray[np.float64]],
    size: tuple[int, int],
) -> tuple[
    NDArray[np.int64],
    NDArray[np.float32],
    NDArray[np.bool_],
    NDArray[np.bool_],
    list[NDArray[np.float32]],
]: ...
def release_memory() -> None: ...
def rectify_pairs(
    pairs: Sequence[tuple[Pixels, Pixels]],
) -> tuple[dict[str, NDArray[np.float64]], float, list[str]]: ...
def estimate_pair_by_rows(
    read: Checked,
    size: tuple[int, int],
    disparities: tuple[int, int | None],
    settings: Settings,
    scale: Scale,
    threads: int | Workers | None,
    known: Known,
    borders: tuple[float, float],
    overlays: Sequence[tuple[int, int, int, int]],
) -> Estimates: ...
def find_borders(
    read: Checked, size: tuple[int, int], disparities: tuple[int, int | None]
) -> list[tuple[float, NDArray[np.uint32] | None]]: ...
def find_overlays(
    read: Checked,
    size: tuple[int, int],
    disparities: tuple[int, int | None],
    scale: Scale,
) -> list[tuple[int, int, int, int]]: ...
def find_roughness(
    read: Checked,
    size: tuple[int, int],
    disparities: tuple[int, int | None],
    scale: Scale,
    impulses: float,
) -> tuple[int, int]: ...
def find_scale(
    images: tuple[Pixels, Pixels],
    masks: tuple[NDArray[np.bool_] | None, NDArray[np.bool_] | None],
    read: Checked,
    size: tuple[int, int],
    disparities: tuple[int, int | None],
) -> Scale: ...
def fit_right(
    images: tuple[Pixels, Pixels],
    masks: tuple[NDArray[np.bool_] | None, NDArray[np.bool_] | None],
) -> tuple[Pixels, NDArray[np.bool_] | None, NDArray[np.float64]]: ...
def halo(
    settings: Settings, compensation: BlurCompensation | None, alignment: Alignment | None
) -> tuple[int, int]: ...
def working_memory(statistics: PairStatistics, rows: int, threads: int, itemsize: int) -> int: ...
def match_rows(
    images: tuple[Pixels, Pixels],
    masks: tuple[NDArray[np.bool_] | None, NDArray[np.bool_] | None],
    statistics: PairStatistics,
    first: int,
    rows: tuple[int, int],
    threads: int | Workers | None,
    progress: Callable[[int, int], object] | None,
) -> Result: ...
def match_raw(
    images: tuple[Pixels, Pixels],
    masks: tuple[NDArray[np.bool_] | None, NDArray[np.bool_] | None],
    statistics: PairStatistics,
    first: int,
    rows: tuple[int, int],
    threads: int | Workers | None,
) -> tuple[Result, tuple[int, int, int, int, int]]: ...
def rows_to_tally(height: int) -> list[tuple[int, int]]: ...
def match_pair(
    images: tuple[Pixels, Pixels],
    masks: tuple[NDArray[np.bool_] | None, NDArray[np.bool_] | None],
    disparities: tuple[int, int | None],
    settings: Settings,
    threads: int | Workers | None,
    progress: Callable[[int, int], object] | None,
    known: Known,
    temporal: TemporalFilter | None,
    rig: Rig | None,
    reestimate: int,
    vertical: bool | None,
    second: NDArray[np.float32] | SecondMatcher | None,
) -> Result: ...
def prepare_pair(
    images: tuple[Pixels, Pixels],
    masks: tuple[NDArray[np.bool_] | None, NDArray[np.bool_] | None],
    disparities: tuple[int, int | None],
    max_disparity: int | None,
    settings: Settings,
    threads: int | Workers | None,
    known: Known | None,
) -> tuple[tuple[Pixels | None, Pixels | None], list[str], int, Back, Ready, Estimates]: ...
def observe_maps(
    images: tuple[Pixels, Pixels],
    maps: list[NDArray[np.float32]],
    settings: Settings,
    threads: int | Workers | None,
) -> tuple[Result, list[NDArray[np.float32]]]: ...
def verify_map(
    images: tuple[Pixels, Pixels],
    masks: tuple[NDArray[np.bool_] | None, NDArray[np.bool_] | None],
    disparity: NDArray[np.float32],
    settings: Settings,
    threads: int | Workers | None,
    progress: Callable[[int, int], object] | None,
    known: Known,
    ready: Ready | None,
) -> Verification: ...
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
    compensation: BlurCompensation | None,
) -> NDArray[np.uint16]: ...
def aggregate_volume(costs: NDArray[np.uint16], settings: Settings) -> NDArray[np.uint32]: ...
def optimize_volume(
    costs: NDArray[np.uint32], settings: Settings, p1: int, p2: int
) -> NDArray[np.uint16]: ...
def preset(name: str) -> dict[str, Any]: ...
def self_check(progress: Callable[[int, int], object] | None) -> list[str]: ...
def simd_level() -> str: ...

"""The matching costs of a pair as a volume, for small images: `match` itself never makes one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from phasestereo import _core
from phasestereo._images import as_pair
from phasestereo.equalisation import Equalisation, Noise, as_versions
from phasestereo.settings import Settings, resolve

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray


def cost_volume(
    left: ArrayLike,
    right: ArrayLike,
    *,
    num_disparities: int,
    min_disparity: int = 0,
    settings: Settings | None = None,
    threads: int | None = None,
    noise: Noise | None = None,
    equalisation: Equalisation | None = None,
    **overrides: Any,
) -> NDArray[np.uint16]:
    """Compare every pixel with every candidate.

    Parameters
    ----------
    left, right, num_disparities, min_disparity, threads, noise, equalisation
        As `match` takes them.
    settings
        Settings to start from; None: the preset ``"paper"``. ``cost`` and those it depends on
        matter here.
    **overrides
        Fields of `Settings` by name.

    Returns
    -------
    ndarray
        uint16 (H, W, num_disparities): the cost of left pixel (x, y) at disparity
        ``min_disparity + k``; candidates outside the right image are taken at its border column.
        Unit: bits for ``cost="phase"``, 1/16 gray level for ``"sad"`` (255 levels to the intensity
        range), 1/256 standard deviation for ``"nsad"``.

    Raises
    ------
    TypeError, ValueError, MemoryError
        As `match` does.
    """
    chosen = resolve("paper" if settings is None else None, settings, overrides)
    disparities = min_disparity, num_disparities
    versions = as_versions(noise, equalisation)
    return _core.cost_volume(as_pair(left, right), disparities, chosen, threads, versions)

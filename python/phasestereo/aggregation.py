"""Costs summed over windows, of which the best of five positions counts."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from phasestereo import _core
from phasestereo._images import as_array
from phasestereo.settings import Settings

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


Unsigned = TypeVar("Unsigned", np.uint16, np.uint32)


def aggregate(costs: ArrayLike, *, window: int = 9, shiftable: bool = True) -> NDArray[np.uint32]:
    """Aggregate a cost volume.

    Parameters
    ----------
    costs
        uint16 (H, W, D), as from `cost_volume`.
    window
        Side of the square window, odd, 1 to 63. Costs continue beyond the image by repeating its
        edge.
    shiftable
        Whether the least of five sums counts, centred on the pixel and half a window above, below,
        left and right of it, each centre clamped into the image (Pedone & Heikkilä 2008, section
        2.3); or the centred one alone.

    Returns
    -------
    ndarray
        uint32 (H, W, D), sums: divide by ``window ** 2`` for the mean cost.

    Raises
    ------
    TypeError
        If the costs are no uint16 array.
    ValueError
        If they are not 3-D, are empty, or the window is out of range.
    """
    volume = as_volume(costs, np.uint16)
    settings = replace(Settings.preset("paper"), window=window, shiftable=shiftable)
    return _core.aggregate_volume(volume, settings)


def as_volume(costs: ArrayLike, dtype: type[Unsigned]) -> NDArray[Unsigned]:
    """Return a volume of costs of the given type as a contiguous array in native byte order."""
    volume = as_array(costs, "costs")
    if volume.dtype.kind != "u" or volume.dtype.itemsize != np.dtype(dtype).itemsize:
        raise TypeError(f"costs: got dtype {volume.dtype}; accepts {np.dtype(dtype)}")
    if volume.ndim != 3 or volume.size == 0:
        raise ValueError(f"costs: got shape {volume.shape}; accepts (H, W, D), none of them 0")
    return np.require(volume, dtype, ["C", "ALIGNED"])

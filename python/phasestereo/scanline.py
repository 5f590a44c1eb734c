"""Aggregated costs -> the candidate of every pixel."""

from __future__ import annotations

from dataclasses import replace
from operator import index
from typing import TYPE_CHECKING, Literal

import numpy as np

from phasestereo import _core
from phasestereo.aggregation import as_volume
from phasestereo.settings import Settings

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

LARGEST_PENALTY = 2**40


def optimize(
    costs: ArrayLike,
    *,
    p1: int,
    p2: int,
    optimizer: Literal["dp", "so", "wta", "sgm"] = "dp",
) -> NDArray[np.uint16]:
    """Choose a candidate for every pixel of a volume of aggregated costs.

    Parameters
    ----------
    costs
        uint32 (H, W, D), as from `aggregate`, up to 2^28.
    p1, p2
        What a change of the index by one, and by more, costs along a path, in the unit of the
        costs: integers from 0 to 2^40. Those above 2^28 count as 2^28.
    optimizer
        ``"dp"``: dynamic programming along each row under the ordering constraint that an index may
        rise by one at most from a pixel to the next, for P1, or drop to any smaller one, for P2
        (Pedone & Heikkilä 2008, section 2.3); equal costs go to the same index, then to the smaller
        one. ``"so"``: the least mean of the totals of two paths along the row, from the left and
        from the right, along each of which the index stays, changes by one, for P1, or by more,
        for P2, which counts at least P1. ``"sgm"``: the least mean of the totals of four
        such paths, from the left, the right, above and below (Hirschmüller, *Stereo Processing by
        Semiglobal Matching and Mutual Information*, PAMI 2008). ``"wta"``: the least cost of each
        pixel by itself. Equal means and costs go to the smallest index. Paths from the right begin
        16 columns beyond each panel of 64 columns, those from above and below 16 rows outside each
        band of 64 rows.

    Returns
    -------
    ndarray
        uint16 (H, W), indices: add ``min_disparity`` for disparities.

    Raises
    ------
    TypeError
        If the costs are no uint32 array, or P1 or P2 is not an integer.
    ValueError
        If the costs are not 3-D, are empty or exceed 2^28, P1 or P2 is out of range, or there is no
         such optimizer.
    """
    volume = as_volume(costs, np.uint32)
    settings = replace(Settings.preset("paper"), optimizer=optimizer)
    return _core.optimize_volume(volume, settings, _penalty(p1, "p1"), _penalty(p2, "p2"))


def _penalty(value: int, name: str) -> int:
    """Return a penalty as a plain integer."""
    if isinstance(value, bool):
        raise TypeError(f"{name}: got a bool; accepts an integer")
    try:
        whole = index(value)
    except TypeError:
        raise TypeError(f"{name}: got {type(value).__name__}; accepts an integer") from None
    if not 0 <= whole <= LARGEST_PENALTY:
        # Not printed: Python may refuse to print a huge integer.
        raise ValueError(f"{name}: got an integer out of range; accepts those from 0 to 2^40")
    return whole

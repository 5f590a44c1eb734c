"""Which disparities to search: found by trying all of them on small copies of a pair.

Here belongs what the rough map of disparities tells about the range as a whole: its ends, and
whether the two images are in the places of each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from phasestereo.alignment import straightened
from phasestereo.rough import LEAST_SIZE, largest_disparity, reduced, reduction, rough_disparity

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from phasestereo.alignment import Alignment

    Plane = NDArray[np.float32]
    Counts = NDArray[np.intp]

_WIDTH = 256  # of the copy: blur of 10 pixels in a large image is of none there
_LEAST_MATCHED = 0.45  # of the pixels: unrelated images agree by chance in 0.4, true pairs in 0.75
_LONGEST = 0.75  # of all disparities tried: what unrelated images take
_CORE = 0.97  # of the matches lie in the shortest range that is believed
_FEW = 0.001  # of the matches in a disparity next to it: it belongs there, too
_NEXT = 0.12  # of the range's length: what is farther off are mistakes
_MARGIN = 0.08  # of the range's length, on both sides
_NEARLY_ALL = 0.95  # of the matches
_CLEARLY = 2  # pixels of the copy: not zero


@dataclass(frozen=True, slots=True)
class SearchRange:
    """The range of disparities of a pair.

    Parameters
    ----------
    min_disparity, num_disparities
        What to give to `phasestereo.match`, with a margin.
    low, high
        Ends of what was found, pixels.
    matched
        Share of the pixels, 0 to 1, at which both images agree on a disparity.
    swapped
        Whether every part of the scene has a clearly negative disparity, as when the left image
        is given as the right one. (A rig whose cameras squint so that all of the scene lies behind
        the point at which they look gives the same.)
    mixed
        Whether disparities of both signs are clearly there, as with squinting cameras.
    """

    min_disparity: int
    num_disparities: int
    low: float
    high: float
    matched: float
    swapped: bool
    mixed: bool


def find_range(left: Plane, right: Plane, alignment: Alignment | None) -> SearchRange | None:
    """Find the range of disparities of a pair, searching 45 % of the width either way.

    Parameters
    ----------
    left, right
        Gray images, float32 (H, W), of any scale.
    alignment
        Their alignment, which is evened out first; None: they are taken as they are.

    Returns
    -------
    SearchRange or None
        None where the images are too small, have too little texture or too little in common.
    """
    if min(left.shape) < LEAST_SIZE or np.ptp(left) == 0 or np.ptp(right) == 0:
        return None
    factor = reduction(left.shape, _WIDTH)
    small_left, small_right = reduced(left, factor), reduced(right, factor)
    if alignment is not None:
        small_right = straightened(small_right, alignment, factor)
    disparity = rough_disparity(small_left, small_right)
    known = disparity[np.isfinite(disparity)].astype(np.intp)
    matched = known.size / disparity.size
    if matched < _LEAST_MATCHED:
        return None
    first, last = _extent(known)
    if last - first > _LONGEST * 2 * largest_disparity(disparity.shape[1]):
        return None
    low, high = (first - 0.5) * factor, (last + 0.5) * factor
    start, count = _with_margin(low, high, left.shape[1])
    return SearchRange(
        min_disparity=start,
        num_disparities=count,
        low=low,
        high=high,
        matched=matched,
        swapped=_share(known < 0) >= _NEARLY_ALL and float(np.median(known)) <= -_CLEARLY,
        mixed=min(_share(known <= -_CLEARLY), _share(known >= _CLEARLY)) >= 1 - _NEARLY_ALL,
    )


def _share(chosen: NDArray[np.bool_]) -> float:
    return float(np.mean(chosen))


def _extent(disparities: Counts) -> tuple[int, int]:
    """Return the least and the largest disparity of those that are no mistakes."""
    least = int(disparities.min())
    counts = np.bincount(disparities - least)
    below = np.concatenate([[0], np.cumsum(counts)])
    starts = np.arange(counts.size)
    ends = np.searchsorted(below, below[:-1] + _CORE * disparities.size)  # exclusive
    lengths = np.where(ends <= counts.size, ends - starts, counts.size + 1)
    first = int(lengths.argmin())
    last = int(ends[first]) - 1
    likely = np.flatnonzero(counts >= _FEW * disparities.size)
    while True:
        step = max(2, round(_NEXT * (last - first)))
        near = likely[(likely >= first - step) & (likely <= last + step)]
        wider = min(first, int(near.min(initial=first))), max(last, int(near.max(initial=last)))
        if wider == (first, last):
            return first + least, last + least
        first, last = wider


def _with_margin(low: float, high: float, width: int) -> tuple[int, int]:
    """Return the first disparity to search and how many, some more than from low to high."""
    margin = 1 + _MARGIN * (high - low)
    start, end = int(np.floor(low - margin)), int(np.ceil(high + margin))
    if low + high > 0:  # what is all on one side of zero stays there
        start = max(start, min(0, int(np.ceil(low))))
    else:
        end = min(end, max(0, int(np.floor(high))))
    return start, min(end - start + 1, width)

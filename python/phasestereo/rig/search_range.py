"""The disparities that were searched, and why."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A place that seems to have disparities outside the search range.

    Parameters
    ----------
    rows, columns
        Its place in the left image, half-open.
    low, high
        Ends of its disparities, px.

    Examples
    --------
    >>> search = ps.check(left, right).search
    >>> search.left_out
    """

    rows: tuple[int, int]
    columns: tuple[int, int]
    low: float
    high: float

    def __str__(self) -> str:
        (top, bottom), (first, end) = self.rows, self.columns
        return (
            f"{self.low:g} to {self.high:g} px in rows {top} to {bottom - 1}, "
            f"columns {first} to {end - 1}"
        )


@dataclass(frozen=True, slots=True)
class SearchRange:
    """The range of disparities of a pair.

    Parameters
    ----------
    min_disparity, num_disparities
        The disparities [min_disparity, min_disparity + num_disparities), with a margin if they were
        found.
    origin
        "given" by the caller; "found" in the images; "default", a third of the width, if the images
        do not show a range.
    confidence
        Mean confidence, 0 to 1, of a rough match of small copies over these disparities; NaN if
        there was none.
    low, high
        Ends of the range that was found, pixels; NaN if it was not searched for. It is searched for
        if no range was given, or if the given one matches badly.
    negative
        Whether every part of the scene has a clearly negative disparity: the images are swapped or
        cropped, or the cameras are so toed in that the whole scene lies behind their crossing
        point.
    swapped
        Whether the scene also shows that the images are swapped: lower things in the image are
        farther, and areas that only one camera sees are on the wrong side of near things.
    mixed
        Whether there are clearly disparities of both signs, as with toed-in cameras.
    inverted
        Whether the images match only after one is inverted: bright in one is dark in the other.
        With ``compensate_blur``, the negative of the right one is matched.
    identical
        Whether both images are the same, up to noise.
    left_out
        Places that seem to have disparities outside the range: for a found range, those too small
        to be sure; for a given one, all that small copies show.

    Examples
    --------
    >>> search = ps.check(left, right).search
    >>> ps.match(
    ...     left,
    ...     right,
    ...     num_disparities=search.num_disparities,
    ...     min_disparity=search.min_disparity,
    ... )
    """

    min_disparity: int
    num_disparities: int
    origin: Literal["given", "found", "default"] = "given"
    confidence: float = math.nan
    low: float = math.nan
    high: float = math.nan
    negative: bool = False
    swapped: bool = False
    mixed: bool = False
    identical: bool = False
    inverted: bool = False
    left_out: tuple[LeftOut, ...] = ()

    def __str__(self) -> str:
        last = self.min_disparity + self.num_disparities - 1
        return f"{self.min_disparity} to {last} px, {self.origin}"

"""Which disparities were searched, and why these."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A place whose disparities are not searched, although something seems to be there.

    Parameters
    ----------
    rows, columns
        Where it is in the left image, half-open.
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
        "given" by the caller; "found" in the images; "default", a third of the width, if nothing is
        found in them.
    confidence
        Mean confidence, 0 to 1, of a rough match of small copies over these disparities; NaN if
        there was none.
    low, high
        Ends of what was found, pixels; NaN if they were not looked for. They are where the range
        was not given, or matches badly as given.
    negative
        Whether every part of the scene has a clearly negative disparity: the left image is given as
        the right one, the images are cropped, or the cameras are so toed in that all of the scene
        lies behind the point at which they look.
    swapped
        Whether the scene shows that the left image is given as the right one, too: what is lower in
        the image is farther, and what one camera alone sees is on the wrong side of near things.
    mixed
        Whether disparities of both signs are clearly there, as with toed-in cameras.
    inverted
        Whether the images match once one of them is inverted, and not before: what is bright in one
        is dark in the other. With ``compensate_blur``, the negative of the right one is matched.
    identical
        Whether both images are the same, up to noise.
    left_out
        Where something seems to have disparities that are not searched: too little of it to be
        sure of where the range was found, all that small copies show where it was given.

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

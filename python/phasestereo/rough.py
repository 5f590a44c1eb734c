"""What a quick look at a pair needs: small copies of the images, and a rough map of disparities.

Here belong the reductions and the match over *all* disparities, of either sign, that the diagnosis
of a pair (`phasestereo.diagnosis`) starts from; nothing here knows what the disparities should be.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phasestereo.matcher import match

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Plane = NDArray[np.float32]

LEAST_SIZE = 48
"""Images with fewer rows or columns are too small to tell much of."""

_REACH = 0.45  # of the width
_LARGEST = 128  # pixels: only panoramas, which cannot be made smaller, are that wide
_LEAST_ROWS = 24  # of a copy


def reduction(size: tuple[int, ...], width: int) -> int:
    """Return by which power of two to make an image smaller, for at most this width.

    What is very wide stays wider, as far as its height goes.
    """
    factor = 1
    while size[1] > width * factor and size[0] >= 2 * factor * _LEAST_ROWS:
        factor *= 2
    return factor


def largest_disparity(width: int) -> int:
    """Return the largest disparity that is tried, either way, in a copy of this width."""
    return min(int(_REACH * width), _LARGEST)


def reduced(image: Plane, factor: int) -> Plane:
    """Return an image made smaller by a whole factor: means of factor x factor pixels.

    Pixel (x, y) of it has its centre at ``factor * (x + 1/2) - 1/2`` of the image; what does not
    fill a pixel at the right and the lower border is left out.
    """
    if factor == 1:
        return image
    rows, cols = (size // factor for size in image.shape)
    blocks = image[: rows * factor, : cols * factor].reshape(rows, factor, cols, factor)
    small: Plane = blocks.mean(axis=(1, 3), dtype=np.float32)
    return small


def rough_disparity(left: Plane, right: Plane) -> Plane:
    """Match over all disparities up to `largest_disparity`, whichever their sign.

    Parameters
    ----------
    left, right
        Gray images, float32 (H, W), of any scale; small ones, since every disparity is tried.

    Returns
    -------
    ndarray
        float32 (H, W): whole disparities, NaN where the match of the right image to the left one
        disagrees by more than a pixel.
    """
    reach = largest_disparity(left.shape[1])
    forth = _matched(left, right, reach)
    # Where nothing tells disparities apart, a match takes the least one. The roles exchanged, and
    # the sign with them, that is the largest one: such places disagree.
    back = -_matched(right, left, reach)
    columns = np.arange(left.shape[1]) - forth.astype(np.intp)
    inside = (columns >= 0) & (columns < left.shape[1])
    answer = np.take_along_axis(back, np.where(inside, columns, 0), axis=1)
    agrees = inside & (np.abs(answer - forth) <= 1)
    return np.where(agrees, forth, np.float32(np.nan))


def _matched(left: Plane, right: Plane, reach: int) -> Plane:
    # Windows that shift and small penalties find matches on rows that do not correspond, too.
    return match(
        left,
        right,
        num_disparities=2 * reach + 1,
        min_disparity=-reach,
        preset="fast",
        shiftable=True,
        penalty=(1.0, 4.5),
        edges=0.0,
        median=0,
    ).disparity

"""Small copies of images, for a quick look at a pair."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Plane = NDArray[np.float32]

_LEAST_ROWS = 24  # of a copy


def reduction(size: tuple[int, ...], width: int) -> int:
    """Return by which power of two to make an image smaller, for at most this width.

    What is very wide stays wider, as far as its height goes.
    """
    factor = 1
    while size[1] > width * factor and size[0] >= 2 * factor * _LEAST_ROWS:
        factor *= 2
    return factor


def reduced(image: Plane, factor: int) -> Plane:
    """Return an image made smaller by a whole factor: means of factor x factor pixels.

    Pixel (x, y) of it has its center at ``factor * (x + 1/2) - 1/2`` of the image; what does not
    fill a pixel at the right and the lower border is left out.
    """
    if factor == 1:
        return image

    rows, cols = (size // factor for size in image.shape)
    blocks = image[: rows * factor, : cols * factor].reshape(rows, factor, cols, factor)
    small: Plane = blocks.mean(axis=(1, 3), dtype=np.float32)
    return small

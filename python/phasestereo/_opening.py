"""Images that a caller passes as arrays or as files."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo import _core
from phasestereo._images import (
    ImageOrPath,
    Mask,
    Pixels,
    RightView,
    Seen,
    as_seen,
    join_masks,
)

Progress: TypeAlias = Callable[[int, int], object]
"""Called as ``progress(done, total)`` during a match."""


def opened(image: ImageOrPath) -> ArrayLike:
    """Return an image; read a path as `phasestereo.io.read_image` does.

    Raises
    ------
    OSError, ValueError, ImportError
        As `phasestereo.io.read_image`.
    """
    if isinstance(image, str | os.PathLike):
        from phasestereo.io.image import read_image  # noqa: PLC0415 - it doubles the time of import

        return read_image(image)
    return image


class Opened(NamedTuple):
    """A pair as the caller gave it, as the core takes it, and the valid pixels of both images."""

    arrays: tuple[NDArray[np.generic], NDArray[np.generic]]
    pair: tuple[Pixels, Pixels]
    masks: tuple[Mask | None, Mask | None]


def opened_valid(
    images: tuple[ImageOrPath, ImageOrPath],
    masks: tuple[ArrayLike | None, ArrayLike | None] = (None, None),
) -> Opened:
    """Return a pair and its valid pixels, by masks, alpha, NaN and the no-data values of files.

    Parameters
    ----------
    images
        The left and the right image, or their files.
    masks
        bool (H, W), True = valid; None: all.

    Raises
    ------
    TypeError, ValueError
        If the images or the masks are invalid, or do not fit each other.
    OSError, ImportError
        As `phasestereo.io.read_image`; ImportError also for a GeoTIFF file without the extra
        ``geo``.
    """
    left = _opened(images[0], masks[0], "left")
    right = _opened(images[1], masks[1], "right")
    return Opened((left.array, right.array), (left.pixels, right.pixels), (left.valid, right.valid))


def _opened(image: ImageOrPath, mask: ArrayLike | None, name: str) -> Seen:
    if not isinstance(image, str | os.PathLike):
        return as_seen(image, mask, name)

    from phasestereo.io.views import read_view  # noqa: PLC0415 - it doubles the time of import

    view = read_view(image)
    found = as_seen(view.image, mask, name)
    return found._replace(valid=join_masks(found.valid, view.mask))


class Fitted(NamedTuple):
    """A pair and its valid pixels, with the right image at the left one's size."""

    pair: tuple[Pixels, Pixels]
    masks: tuple[Mask | None, Mask | None]
    right: RightView | None
    """None: it has this size already."""


def opened_alike(
    images: tuple[ImageOrPath, ImageOrPath],
    masks: tuple[ArrayLike | None, ArrayLike | None] = (None, None),
) -> Fitted:
    """Return a pair as `opened_valid` does, the right image at the size of the left one.

    Raises
    ------
    TypeError, ValueError, OSError, ImportError
        As `opened_valid`; ValueError also if one image is more than 8 times as large.
    """
    _, pair, valid = opened_valid(images, masks)
    rows, cols = pair[1].shape[:2]
    if pair[0].shape[:2] == (rows, cols):
        return Fitted(pair, valid, None)
    right, mask, matrix = _core.fit_right(pair, valid)
    return Fitted((pair[0], right), (valid[0], mask), RightView((cols, rows), matrix))

"""Images that a caller has, or names the file of."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._images import (
    ImageOrPath,
    Mask,
    Pixels,
    Seen,
    as_pair,
    as_seen,
    join_masks,
)

Progress: TypeAlias = Callable[[int, int], object]
"""Called as ``progress(done, total)`` while a pair is worked on."""


def opened(image: ImageOrPath) -> ArrayLike:
    """Return an image; where it is a path, read it, as `phasestereo.io.read_image` does.

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
    """A pair as a caller gave it, as the core takes it, and what of both images is valid."""

    arrays: tuple[NDArray[np.generic], NDArray[np.generic]]
    pair: tuple[Pixels, Pixels]
    masks: tuple[Mask | None, Mask | None]


def opened_valid(
    images: tuple[ImageOrPath, ImageOrPath],
    masks: tuple[ArrayLike | None, ArrayLike | None] = (None, None),
) -> Opened:
    """Return a pair with what masks, alpha, NaN and the no-data values of files leave of it.

    Parameters
    ----------
    images
        The left and the right image, or the files of them.
    masks
        bool (H, W), True = valid; None: all.

    Raises
    ------
    TypeError, ValueError
        If they are not images, or the masks are not those of them.
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


def opened_pair(left: ImageOrPath, right: ImageOrPath) -> tuple[Pixels, Pixels]:
    """Return both images of a pair as `as_pair` does; those of which there is a path are read."""
    return as_pair(opened(left), opened(right))

"""Images that a caller has, or names the file of."""

from __future__ import annotations

import os
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._images import (
    ImageOrPath,
    Mask,
    Pixels,
    as_array,
    as_mask,
    as_pair,
    as_valid,
    as_views,
    join_masks,
)


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
    """Return a pair with what masks, NaN and the no-data values of GeoTIFF files leave of it.

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
    names = "left", "right"
    left, right = (_opened(*one) for one in zip(images, masks, names, strict=True))
    arrays = left[0], right[0]
    pair = as_views(*arrays)
    valid = (
        as_valid(left[1], pair[0], "left_mask"),
        as_valid(right[1], pair[1], "right_mask"),
    )
    return Opened(arrays, pair, valid)


def _opened(
    image: ImageOrPath, mask: ArrayLike | None, name: str
) -> tuple[NDArray[np.generic], ArrayLike | None]:
    if not isinstance(image, str | os.PathLike):
        return as_array(image, name), mask

    from phasestereo.io.views import read_view  # noqa: PLC0415 - it doubles the time of import

    view = read_view(image)
    given = as_mask(mask, view.image.shape[:2], f"{name}_mask")
    return view.image, join_masks(given, view.mask)


def opened_pair(left: ImageOrPath, right: ImageOrPath) -> tuple[Pixels, Pixels]:
    """Return both images of a pair as `as_pair` does; those of which there is a path are read."""
    return as_pair(opened(left), opened(right))

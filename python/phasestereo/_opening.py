"""Images that a caller has, or names the file of."""

from __future__ import annotations

import os

from numpy.typing import ArrayLike

from phasestereo._images import ImageOrPath, Pixels, as_pair, as_views


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


def opened_pair(left: ImageOrPath, right: ImageOrPath) -> tuple[Pixels, Pixels]:
    """Return both images of a pair as `as_pair` does; those of which there is a path are read."""
    return as_pair(opened(left), opened(right))


def opened_views(left: ImageOrPath, right: ImageOrPath) -> tuple[Pixels, Pixels]:
    """Return both images as `as_views` does; those of which there is a path are read."""
    return as_views(opened(left), opened(right))

"""Stereo photographs: both views in one file."""

from __future__ import annotations

import os
from typing import Any, Literal, TypeAlias

from numpy.typing import NDArray

from phasestereo.io.files import StrPath, decoding
from phasestereo.io.image import as_image, read_image
from phasestereo.io.pixels import Pixels
from phasestereo.io.raster import decode_frames

Layout: TypeAlias = Literal["side-by-side", "top-bottom"]

AXES = {"side-by-side": 1, "top-bottom": 0}
"""Along which axis of a picture its left and its right view follow each other, by layout."""


class LayoutError(ValueError):
    """A picture cannot be cut in two equal halves."""


def read_pair(path: StrPath, layout: Layout | None = None) -> tuple[Pixels, Pixels]:
    """Read a stereo photograph: a picture that holds both views, or a file of two pictures (MPO).

    Parameters
    ----------
    path
        The file, as `read_image` reads it; or an MPO file, as cameras with two lenses write, of
        which the first two pictures are read: the left view and the right one.
    layout
        Where one picture has both views: ``"side-by-side"``, left and right halves, or
        ``"top-bottom"``, the left view above. None: the file has two pictures.

    Returns
    -------
    tuple
        The left and the right image, each as `read_image` returns it. Views that were recorded
        crosswise are the other way round: exchange them.

    Raises
    ------
    OSError, ImportError
        As `read_image`.
    ValueError
        As `read_image`; also if the layout is unknown or missing, the picture has an odd number of
        columns or rows there, or the pictures of a file differ in size.
    """
    if layout is not None and layout not in AXES:
        names = ", ".join(map(repr, AXES))
        raise ValueError(f"layout: got {layout!r}; accepts {names}, or None for a file of two")

    if layout is not None:
        return halves(read_image(path), layout)

    with decoding(path) as file:
        # An MPO file is a JPEG with further pictures behind the first.
        jpeg = file.read(3) == b"\xff\xd8\xff"
        pictures = [as_image(picture) for picture in decode_frames(file)] if jpeg else []

    if not pictures:
        raise ValueError(
            f"layout: got None for {os.fspath(path)}, which holds one picture; accepts "
            "side-by-side or top-bottom, or else the right view comes in a file of its own"
        )

    left, right = pictures
    if left.shape != right.shape:
        raise ValueError(
            f"{os.fspath(path)}: pictures of {left.shape[:2]} and {right.shape[:2]} pixels; "
            "accepts two of one size"
        )
    return left, right


def halves(picture: NDArray[Any], layout: Layout) -> tuple[NDArray[Any], NDArray[Any]]:
    """Cut a picture that holds both views in two.

    Raises
    ------
    LayoutError
        If it has an odd number of columns or rows there.
    """
    axis = AXES[layout]
    half, rest = divmod(picture.shape[axis], 2)

    if rest or not half:
        size, sides = f"{picture.shape[1]} x {picture.shape[0]}", ("rows", "columns")[axis]
        raise LayoutError(f"layout: {layout!r} needs an even number of {sides}, got {size} pixels")

    return (picture[:half], picture[half:]) if axis == 0 else (picture[:, :half], picture[:, half:])

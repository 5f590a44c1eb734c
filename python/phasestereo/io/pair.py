"""Stereo photographs: both views in one file."""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING

from phasestereo.io.files import decoding
from phasestereo.io.image import as_image, read_image
from phasestereo.io.raster import decode_frames

if TYPE_CHECKING:
    from phasestereo.integrations.video.capture import Layout
    from phasestereo.io.files import StrPath
    from phasestereo.io.pixels import Pixels


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
    capture = import_module("phasestereo.integrations.video.capture")
    if layout is not None and layout not in capture.AXES:
        names = ", ".join(map(repr, capture.AXES))
        raise ValueError(f"layout: got {layout!r}; accepts {names}, or None for a file of two")

    if layout is not None:
        left, right = capture.halves(read_image(path), layout)
        return left, right

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

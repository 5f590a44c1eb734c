"""Stereo photographs: both views in one file."""

from __future__ import annotations

import os
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from phasestereo.io.files import StrPath, decoding
from phasestereo.io.heif import HEIF_MAGICS, decode_spatial
from phasestereo.io.image import as_image, read_image
from phasestereo.io.pixels import Pixels
from phasestereo.io.raster import decode_frames

Layout: TypeAlias = Literal[
    "side-by-side", "top-bottom", "half-side-by-side", "half-top-bottom", "anaglyph"
]

LAYOUTS: tuple[Layout, ...] = get_args(Layout)


class LayoutError(ValueError):
    """A picture cannot hold two views in this layout."""


class Photograph(NamedTuple):
    """Both views of a stereo photograph, and their focal length in pixels (None: unknown)."""

    left: Pixels
    right: Pixels
    focal: float | None = None


def read_pair(path: StrPath, layout: Layout | None = None) -> tuple[Pixels, Pixels]:
    """Read a stereo photograph: a picture that holds both views, or a file of two pictures.

    Parameters
    ----------
    path
        The file, as `read_image` reads it. Files of two pictures are spatial photographs (HEIC, as
        phones and headsets take them), whose group ``ster`` names the left one, and MPO, as cameras
        with two lenses write; the first two pictures are read.
    layout
        Where one picture has both views: ``"side-by-side"``, left and right halves, or
        ``"top-bottom"``, the left view above; the middle column or row of an odd number is dropped.
        With ``"half-side-by-side"`` and ``"half-top-bottom"``, as in movies, each view was squeezed
        to half its width or height, and is widened again. With ``"anaglyph"``, for red-cyan
        glasses, the left view is red and the right one green. None: the file has two pictures.

    Returns
    -------
    tuple
        The left and the right image, each as `read_image` returns it. Cross-eyed views come out
        swapped: exchange them.

    Raises
    ------
    OSError, ImportError
        As `read_image`.
    ValueError
        As `read_image`; also if the layout is unknown or missing, the picture is too small or
        gray, or the pictures of a file differ in size.
    """
    return read_photograph(path, layout)[:2]


def read_photograph(path: StrPath, layout: Layout | None = None) -> Photograph:
    """Read a stereo photograph as `read_pair` does, with the focal length from its file."""
    if layout is not None:
        check_layout(layout)
        return Photograph(*views_of(read_image(path), layout))

    with decoding(path) as file:
        head = file.read(8)
        file.seek(0)
        pictures: list[Pixels] = []
        focal = None
        if head.startswith(b"\xff\xd8\xff"):  # MPO: a JPEG with more behind the first
            pictures = [as_image(picture) for picture in decode_frames(file)]
        elif head.startswith(HEIF_MAGICS):
            found, focal = decode_spatial(file)
            pictures = [as_image(picture) for picture in found]

    if not pictures:
        read_image(path)  # whose error names files that are not images
        raise ValueError(
            f"layout: got None for {os.fspath(path)}, and no right image; accepts a right image, "
            f"or for a file with both views {', '.join(LAYOUTS)}"
        )

    left, right = pictures
    if left.shape != right.shape:
        raise ValueError(
            f"{os.fspath(path)}: pictures of {left.shape[:2]} and {right.shape[:2]} pixels; "
            "accepts two of one size"
        )
    return Photograph(left, right, focal)


def check_layout(layout: str) -> None:
    """Refuse unknown layouts.

    Raises
    ------
    ValueError
        If it is unknown.
    """
    if layout not in LAYOUTS:
        names = ", ".join(map(repr, LAYOUTS))
        raise ValueError(f"layout: got {layout!r}; accepts {names}, or None for a file of two")


def views_of(picture: NDArray[Any], layout: Layout) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return both views that a picture holds.

    Raises
    ------
    LayoutError
        If the views would have fewer than two columns or rows, or an anaglyph has no colors.
    """
    size = f"{picture.shape[1]} x {picture.shape[0]}"
    if layout == "anaglyph":
        if picture.ndim != 3:
            raise LayoutError(f"layout: 'anaglyph' needs colors, got {size} pixels of gray")
        return picture[..., 0], picture[..., 1]

    axis = 0 if layout.endswith("top-bottom") else 1
    half = picture.shape[axis] // 2
    if not half:
        sides = ("rows", "columns")[axis]
        raise LayoutError(f"layout: {layout!r} needs two {sides} or more, got {size} pixels")

    both = (
        (picture[:half], picture[-half:]) if axis == 0 else (picture[:, :half], picture[:, -half:])
    )
    if layout.startswith("half-"):
        return _doubled(both[0], axis), _doubled(both[1], axis)
    return both


def _doubled(view: NDArray[Any], axis: int) -> NDArray[Any]:
    """Return an image twice as long along an axis, linear between the centers of its pixels."""
    lines = np.moveaxis(view, axis, 0).astype(np.float32)
    before, after = np.concatenate([lines[:1], lines[:-1]]), np.concatenate([lines[1:], lines[-1:]])
    parts = np.stack([0.75 * lines + 0.25 * before, 0.75 * lines + 0.25 * after], axis=1)
    made = parts.reshape(-1, *lines.shape[1:])
    if view.dtype.kind == "u":
        np.rint(made, out=made)
    return np.ascontiguousarray(np.moveaxis(made.astype(view.dtype), 0, axis))

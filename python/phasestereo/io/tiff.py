"""TIFF through tifffile: 8 and 16 bits and float32, gray, RGB and RGB with alpha."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from phasestereo._extras import require
from phasestereo.io.files import decoding
from phasestereo.io.pixels import channels, check_size, expand_bits, look_up

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from phasestereo.io.files import StrPath
    from phasestereo.io.pixels import Pixels

# What tifffile is to say about an image, by the number of channels.
_TAGS: dict[int, dict[str, Any]] = {
    1: {"photometric": "minisblack"},
    3: {"photometric": "rgb"},
    4: {"photometric": "rgb", "extrasamples": ["unassalpha"]},
}


TIFF_MAGICS = b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"
"""How a TIFF or BigTIFF file starts."""

# Scale and tie points, transformation, GeoTIFF's keys, GDAL's "no data" value, RPCs.
_GEO_TAGS = {33550, 33922, 34264, 34735, 42113, 50844}


def is_geotiff(path: StrPath) -> bool:
    """Tell whether a file is a TIFF with tags that place it, or that mask it by a value.

    Raises
    ------
    OSError, ValueError, ImportError
        As `phasestereo.io.read_image`.
    """
    with decoding(path) as file:
        if not file.read(4).startswith(TIFF_MAGICS):
            return False
        file.seek(0)
        with require("tifffile", extra="io").TiffFile(file) as tiff:
            return not _GEO_TAGS.isdisjoint(tag.code for tag in tiff.pages[0].tags)


def decode_tiff(file: BinaryIO) -> NDArray[Any]:
    """Decode the only page of a TIFF file; reduced copies of it (overviews) do not count.

    Raises
    ------
    ValueError
        If there are several pages, parts of the page are missing, or its colours are not gray,
        RGB or a palette.
    """
    tifffile = require("tifffile", extra="io")
    with tifffile.TiffFile(file) as tiff:
        # aspage: later pages of a series are mere frames, which lack tags
        pages = [page for page in (each.aspage() for each in tiff.pages) if not page.is_reduced]
        if len(pages) != 1:
            raise ValueError(f"the TIFF has {len(pages)} pages, and only one can be the image")
        page = pages[0]
        check_size(page.imagewidth, page.imagelength)
        _check_complete(page)
        if page.axes not in ("YX", "YXS", "SYX"):
            raise ValueError(f"the TIFF page has axes {page.axes}, an image has YX and channels S")
        samples: NDArray[Any] = page.asarray()
        if page.axes == "SYX":  # one plane a channel
            samples = np.ascontiguousarray(np.moveaxis(samples, 0, 2))
        return _apply_photometric(samples, page, tifffile.PHOTOMETRIC)


def _check_complete(page: Any) -> None:
    """Refuse a page with strips or tiles left out: tifffile would fill them in without a word."""
    sizes = page.databytecounts
    if not math.prod(page.chunked) == len(page.dataoffsets) == len(sizes) or 0 in sizes:
        raise ValueError("some strips or tiles of the TIFF page are missing")


def _apply_photometric(samples: NDArray[Any], page: Any, photometric: Any) -> NDArray[Any]:
    """Turn what the samples stand for into gray levels or RGB; a bit becomes 0 or 255."""
    if page.photometric == photometric.PALETTE and samples.dtype == np.uint8:
        colours = page.colormap.T >> 8  # a palette holds 8-bit levels as 16 bits
        return look_up(colours.astype(np.uint8), samples)
    if page.photometric == photometric.MINISWHITE and samples.dtype.kind in "bu":
        samples = ~samples
    elif page.photometric not in (photometric.MINISBLACK, photometric.RGB):
        name = getattr(page.photometric, "name", page.photometric)
        raise ValueError(f"the TIFF has {name} samples of type {samples.dtype}, not gray or RGB")
    return expand_bits(samples) if samples.dtype == np.bool_ else samples


def encode_tiff(file: BinaryIO, image: Pixels) -> None:
    """Encode an image, uncompressed."""
    tifffile = require("tifffile", extra="io")
    # metadata: plain TIFF, without tifffile's own description of the shape.
    tifffile.imwrite(file, image, metadata=None, **_TAGS[channels(image.shape)])

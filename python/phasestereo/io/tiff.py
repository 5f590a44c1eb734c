"""TIFF through tifffile: 8 and 16 bits and float32, gray, RGB and RGB with alpha."""

from __future__ import annotations

import logging
import math
import zlib
from importlib.metadata import entry_points
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo.io.files import StrPath, decoding
from phasestereo.io.limits import UNPACKING
from phasestereo.io.pixels import Pixels, channels, expand_bits, look_up
from phasestereo.io.tiff_layout import BOUNDED, DEFLATED, TIFF_MAGICS, check_whole, read_layout

# What tifffile is to say about an image, by the number of channels.
_TAGS: dict[int, dict[str, Any]] = {
    1: {"photometric": "minisblack"},
    3: {"photometric": "rgb"},
    4: {"photometric": "rgb", "extrasamples": ["unassalpha"]},
}


# Errors in a file are raised; without a handler, its log lines would reach the terminal.
logging.getLogger("tifffile").addHandler(logging.NullHandler())

_REDUCED, _SUBFILE = 1, 254
_PIECE = 2**20  # bytes unpacked at a time where they are only counted
_HARMLESS = 2**24  # bytes that a block may unpack to without being counted, which takes time
_MOST_PACKED = 2**20  # bytes of a block of PackBits, which tifffile unpacks without a bound
_PACKBITS = 32773

# Scale and tie points, transformation, GeoTIFF's keys, GDAL's "no data" value, RPCs.
_GEO_TAGS = {33550, 33922, 34264, 34735, 42113, 50844}
FORMATS = "phasestereo.formats"
"""The group of entry points by which other distributions add formats."""


def is_geotiff(path: StrPath) -> bool:
    """Return whether a file is a TIFF with tags that place it, or that mask it by a value.

    Raises
    ------
    OSError, ValueError
        As `phasestereo.io.read_image`.
    """
    with decoding(path) as file:
        if not file.read(4).startswith(TIFF_MAGICS):
            return False
        return not _GEO_TAGS.isdisjoint(read_layout(file)[0].tags)


def geotiff() -> Any:
    """Return the module that reads and writes GeoTIFF files, from ``phasestereo-large``.

    Raises
    ------
    ImportError
        If it is not installed.
    """
    for point in entry_points(group=FORMATS, name="geotiff"):
        return point.load()

    raise ImportError(
        "phasestereo-large is not installed; it comes with: pip install 'phasestereo[geo]'"
    )


def decode_tiff(file: BinaryIO) -> NDArray[Any]:
    """Decode the only page of a TIFF file; reduced copies of it (overviews) do not count.

    Raises
    ------
    ValueError
        If the file has several pages, parts of the page are missing, it exceeds the limit or
        unpacks to more than it needs, or its colors are not gray, RGB or a palette.
    """
    tifffile = require("tifffile", extra="io")
    _check_bounds(file)
    file.seek(0)
    with tifffile.TiffFile(file) as tiff:
        # aspage: later pages of a series are mere frames, without tags
        pages = [page for page in (each.aspage() for each in tiff.pages) if not page.is_reduced]
        if len(pages) != 1:
            raise ValueError(f"the TIFF has {len(pages)} pages, and only one can be the image")

        page = pages[0]
        _check_complete(page)
        if page.axes not in ("YX", "YXS", "SYX"):
            raise ValueError(f"the TIFF page has axes {page.axes}, an image has YX and channels S")

        samples: NDArray[Any] = page.asarray()
        if page.axes == "SYX":  # one plane a channel
            samples = np.ascontiguousarray(np.moveaxis(samples, 0, 2))

        return _apply_photometric(samples, page, tifffile.PHOTOMETRIC)


def _check_bounds(file: BinaryIO) -> None:
    """Refuse data that tifffile would unpack without a bound."""
    pages = [page for page in read_layout(file) if not page.number(_SUBFILE, 0) & _REDUCED]
    if len(pages) != 1:
        raise ValueError(f"the TIFF has {len(pages)} pages, and only one can be the image")

    page = pages[0]
    if page.compression not in BOUNDED:
        raise ValueError(
            f"the TIFF is compressed in a way (number {page.compression}) that is not read here: "
            "uncompressed, deflate, PackBits and LZW are; phasestereo_large.geotiff reads more"
        )

    check_whole(file, page)
    stored = page.stored(file)
    if page.compression == _PACKBITS and (stored > _MOST_PACKED).any():
        raise ValueError(f"a block of PackBits has more than {_MOST_PACKED} bytes")

    # Only deflate packs so tightly that a small file can fill the memory.
    if page.compression in DEFLATED:
        for number, (offset, count) in enumerate(zip(page.places(file), stored, strict=True)):
            file.seek(int(offset))
            if _unpacks_beyond(file, int(count), page.block_bytes):
                raise ValueError(
                    f"strip or tile {number} of the TIFF unpacks to more than the "
                    f"{page.block_bytes} bytes that the picture needs of it"
                )


def _unpacks_beyond(file: BinaryIO, count: int, most: int) -> bool:
    """Return whether deflated bytes unpack to more than a limit, without keeping them."""
    if count * UNPACKING <= max(most, _HARMLESS):
        return False

    unpacker = zlib.decompressobj()
    total = 0
    try:
        while count > 0 and not unpacker.eof:
            rest = file.read(min(count, _PIECE))
            count -= len(rest) or count

            # Each turn unpacks a bounded amount; the rest of the input comes in the next turn.
            while rest and not unpacker.eof:
                total += len(unpacker.decompress(rest, _PIECE))
                rest = unpacker.unconsumed_tail
                if total > most:
                    return True
    except zlib.error as error:
        raise ValueError(f"a strip or tile of the TIFF is damaged: {error}") from error
    return False


def _check_complete(page: Any) -> None:
    """Refuse a page with strips or tiles left out: tifffile would silently fill them in."""
    sizes = page.databytecounts
    if not math.prod(page.chunked) == len(page.dataoffsets) == len(sizes) or 0 in sizes:
        raise ValueError("some strips or tiles of the TIFF page are missing")


def _apply_photometric(samples: NDArray[Any], page: Any, photometric: Any) -> NDArray[Any]:
    """Turn samples into gray levels or RGB; a bit becomes 0 or 255."""
    if page.photometric == photometric.PALETTE and samples.dtype == np.uint8:
        colors = page.colormap.T >> 8  # a palette holds 8-bit levels as 16 bits
        return look_up(colors.astype(np.uint8), samples)

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

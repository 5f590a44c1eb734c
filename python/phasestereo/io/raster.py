"""PNG, PBM/PGM/PPM, JPEG, WebP and BMP through Pillow, without loss in any sample.

Pictures are turned by their EXIF orientation: phones store them lying on their side.

This module works around two habits of Pillow. It silently narrows 16-bit color to 8 bits, and it
rescales Netpbm samples with a maximum other than 255 or 65535, which would change disparities coded
in them. Its low-level decoders do neither, so this module uses them to get the unchanged samples.
And ``Image.open`` warns of images above 89 megapixels and refuses them above 179, by a global
limit. The class of the format does not, so this module calls it, with the limit of
`phasestereo.io`.
"""

from __future__ import annotations

import os
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo.io.limits import check_size, check_unpacked
from phasestereo.io.pixels import Pixels, expand_bits, look_up

# The first bytes of a file -> Pillow's module for the format, and its class that opens the file.
_OPENERS = {
    b"\x89PNG\r\n\x1a\n": ("PIL.PngImagePlugin", "PngImageFile"),
    b"\xff\xd8\xff": ("PIL.JpegImagePlugin", "jpeg_factory"),
    b"RIFF": ("PIL.WebPImagePlugin", "WebPImageFile"),  # or else sound, which it refuses
    b"BM": ("PIL.BmpImagePlugin", "BmpImageFile"),
    **{f"P{kind}".encode(): ("PIL.PpmImagePlugin", "PpmImageFile") for kind in range(1, 7)},
}
RASTER_MAGICS = tuple(_OPENERS)

# Netpbm's samples of two bytes, by Pillow's name for those of one.
_WIDE = {"L": "I;16B", "RGB": "RGB;16B"}
# Big-endian 16-bit color as Pillow unpacks it, into the high bytes -> what unpacks the low bytes.
_LOW_BYTES = {"RGB;16B": "RGB;16L", "RGBA;16B": "RGBA;16L"}


_ORIENTATION = 0x0112  # the EXIF tag
# EXIF orientation -> whether rows and columns change places, then whether rows and columns turn.
_TURNS = {
    2: (False, 1, -1),
    3: (False, -1, -1),
    4: (False, -1, 1),
    5: (True, 1, 1),
    6: (True, 1, -1),
    7: (True, -1, -1),
    8: (True, -1, 1),
}


class _Tile(NamedTuple):
    """Pillow's description of the coded samples of an image."""

    codec: str
    extents: tuple[int, int, int, int] | None
    offset: int
    unpacking: Any


def decode_raster(file: BinaryIO) -> NDArray[Any]:
    """Decode the only frame of an image: uint8 or uint16, (H, W), (H, W, 3) or (H, W, 4).

    Later pictures of other sizes, such as the previews and gain maps that cameras and phones
    append, do not count as frames.

    Raises
    ------
    ValueError
        If the image has several frames, or samples that decoding would change.
    """
    first = _open(file)
    orientation = _orientation(first)
    if first.format == "WEBP":  # has 8 bits and no tiles
        return _turned(_expand(first), orientation)

    planes: list[NDArray[Any]] = []
    for tile in _exact_tiles(first):
        image = _open(file)
        image.tile = [tile]
        planes.append(_expand(image))

    if len(planes) == 1:
        return _turned(planes[0], orientation)

    high, low = planes
    return _turned((high.astype(np.uint16) << 8) | low, orientation)


def decode_frames(file: BinaryIO) -> list[NDArray[Any]]:
    """Decode the first two pictures of a file of several, as cameras with two lenses write (MPO).

    Returns
    -------
    list
        The pictures, as `decode_raster` returns one; empty if the file holds only one.
    """
    image = _open(file, frames=2)
    if getattr(image, "n_frames", 1) < 2:
        return []

    length = os.fstat(file.fileno()).st_size
    pictures, orientation = [], _orientation(image)
    for number in range(2):
        image.seek(number)
        _check(image, length)
        # The second picture may leave to the first one how both were held.
        pictures.append(_turned(_expand(image), _orientation(image) or orientation))
    return pictures


def _orientation(image: Any) -> int:
    """Return the EXIF orientation of an image; 0: not given."""
    # Without this test Pillow decodes a PNG to look behind its samples.
    found = image.getexif().get(_ORIENTATION) if "exif" in image.info else None
    return found if found in _TURNS else 0


def _turned(samples: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Return samples as they are to be looked at."""
    is_on_side, down, along = _TURNS.get(orientation, (False, 1, 1))
    upright = samples.swapaxes(0, 1) if is_on_side else samples
    return upright[::down, ::along]


def _open(file: BinaryIO, frames: int = 1) -> Any:
    """Parse the header with Pillow; by default, of a file of one picture."""
    file.seek(0)
    head = file.read(8)
    length = file.seek(0, os.SEEK_END)
    file.seek(0)

    module, opener = next(_OPENERS[magic] for magic in RASTER_MAGICS if head.startswith(magic))
    image = getattr(require(module, extra="io"), opener)(file)
    _check(image, length)

    if frames == 1 and _has_more(image):
        raise ValueError(
            f"the file holds {image.n_frames} images, and only one can be meant; "
            "phasestereo.io.read_pair reads stereo photographs"
        )

    return image


def _check(image: Any, length: int) -> None:
    """Refuse a picture too large, or larger than the bytes of its file can hold."""
    check_size(*image.size)
    bands = len(image.getbands())
    samples = bands if bands > 1 else 1 / 8  # gray levels and palettes may have one bit
    check_unpacked(int(image.width * image.height * samples), length)


def _has_more(image: Any) -> bool:
    """Return whether a file has a second picture of the size of the first."""
    count, size = getattr(image, "n_frames", 1), image.size
    if count < 2 or image.format != "MPO":
        return bool(count > 1)

    alike = []
    for number in range(1, count):
        image.seek(number)
        alike.append(image.size == size)
    image.seek(0)
    return any(alike)


def _exact_tiles(image: Any) -> list[_Tile]:
    """Return Pillow's tiles: one, or two for the high and the low bytes of colors."""
    if not image.tile:
        raise ValueError("the file has a header but no samples")
    tile = _Tile(*image.tile[0])

    if tile.codec == "ppm_plain" and image.mode != "1":
        maximum = tile.unpacking[1]
        if maximum != (65535 if image.mode == "I" else 255):
            raise ValueError(f"plain-text samples up to {maximum} would be rescaled; use binary")

    if tile.codec == "ppm":  # this decoder rescales, the raw one does not
        mode, maximum = tile.unpacking
        wide = maximum > np.iinfo(np.uint8).max
        tile = tile._replace(codec="raw", unpacking=_WIDE[mode] if wide else mode)

    if tile.unpacking in _LOW_BYTES:
        return [tile, tile._replace(unpacking=_LOW_BYTES[tile.unpacking])]
    if str(tile.unpacking).endswith(";16B") and image.mode not in ("I", "I;16"):
        raise ValueError(f"16-bit samples stored as {tile.unpacking} cannot be read exactly")
    return [tile]


def _expand(image: Any) -> NDArray[Any]:
    """Return the samples of a decoded image; palettes are looked up, a bit becomes 0 or 255."""
    samples: NDArray[Any] = np.array(image)
    if image.mode == "1":
        return expand_bits(samples)
    if image.mode == "P":
        return look_up(np.array(image.getpalette("RGB"), np.uint8).reshape(-1, 3), samples)
    if image.mode == "LA":
        return np.array(image.convert("RGBA"))
    if image.mode == "I":
        return samples.astype(np.uint16)  # 16-bit PGM, which Pillow keeps in 32 bits

    if image.mode not in ("L", "RGB", "RGBA", "I;16"):
        raise ValueError(f"{image.mode} images are not read, only gray, RGB and palette ones")
    return samples


def encode_raster(file: BinaryIO, image: Pixels, image_format: str) -> None:
    """Encode an image in a format of Pillow's that can hold it."""
    picture = require("PIL.Image", extra="io").fromarray(image)
    options = {"quality": 95, "subsampling": 0} if image_format == "JPEG" else {}
    picture.save(file, format=image_format, **options)

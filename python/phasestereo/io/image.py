"""Images: the format of a file, and the content that each format can hold."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from phasestereo._images import as_numbers
from phasestereo.io.drafts import replacing
from phasestereo.io.files import StrPath, decoding, suffix
from phasestereo.io.heif import HEIF_MAGICS, decode_heif
from phasestereo.io.npy import decode_npy, encode_npy
from phasestereo.io.pfm import decode_pfm, encode_pfm
from phasestereo.io.pixels import Pixels, channels
from phasestereo.io.raster import RASTER_MAGICS, decode_raster, encode_raster
from phasestereo.io.tiff import decode_tiff, encode_tiff
from phasestereo.io.tiff_layout import TIFF_MAGICS

# The first bytes of a file -> its decoder.
_DECODERS: dict[tuple[bytes, ...], Callable[[BinaryIO], NDArray[Any]]] = {
    RASTER_MAGICS: decode_raster,
    TIFF_MAGICS: decode_tiff,
    HEIF_MAGICS: decode_heif,
    (b"\x93NUMPY",): decode_npy,
    (b"Pf", b"PF"): decode_pfm,
}

_DTYPES = ("uint8", "uint16", "float32")
_ANYTHING = {(dtype, count) for dtype in _DTYPES for count in (1, 3, 4)}

# Suffix -> its encoder, and the dtypes and numbers of channels that it holds.
_ENCODERS: dict[str, tuple[Callable[[BinaryIO, Pixels], None], set[tuple[str, int]]]] = {
    ".png": (
        partial(encode_raster, image_format="PNG"),
        {("uint8", 1), ("uint8", 3), ("uint8", 4), ("uint16", 1)},
    ),
    ".pgm": (partial(encode_raster, image_format="PPM"), {("uint8", 1), ("uint16", 1)}),
    ".ppm": (partial(encode_raster, image_format="PPM"), {("uint8", 3)}),
    ".bmp": (partial(encode_raster, image_format="BMP"), {("uint8", 1), ("uint8", 3)}),
    ".jpg": (partial(encode_raster, image_format="JPEG"), {("uint8", 1), ("uint8", 3)}),
    ".jpeg": (partial(encode_raster, image_format="JPEG"), {("uint8", 1), ("uint8", 3)}),
    ".tif": (encode_tiff, _ANYTHING),
    ".tiff": (encode_tiff, _ANYTHING),
    ".npy": (encode_npy, _ANYTHING),
    ".pfm": (encode_pfm, {("float32", 1), ("float32", 3)}),
}


def read_image(path: StrPath) -> Pixels:
    """Read an image with its samples exactly as stored.

    The format is recognized by the content: PNG, PBM/PGM/PPM, JPEG, WebP, HEIF, BMP, TIFF,
    ``.npy`` or PFM.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    ndarray
        uint8, uint16 or float32 of shape (H, W) for gray, (H, W, 3) for RGB, (H, W, 4) for RGB with
        alpha. A palette is looked up (a gray one gives a gray image), gray levels of 1, 2 or 4 bits
        are scaled to 255, gray with alpha becomes RGB with alpha, float64 becomes float32.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is damaged or of another format; if it holds several images; if its samples are not of
        the types above, or could not be read without loss; if it has more pixels than `max_pixels`
        (200 million), or is too short for the size it claims.
    ImportError
        If the format needs the extra ``io``, or HEIF the extra ``heif``, and that is not installed.

    Notes
    -----
    Samples are not interpreted: 10-bit values in a 16-bit file stay below 1024, and color profiles,
    gamma and PNG's transparent color are ignored. Pictures are turned by the EXIF orientation of
    JPEG, PNG and WebP files and by that of HEIF, as viewers and ``cv2.imread`` do. HEIF of more
    than 8 bits is returned as the high bits of 16. From a JPEG with previews or a gain map behind
    the picture, the picture is read. TIFF is read uncompressed or with deflate, PackBits or LZW;
    `read_geotiff` reads further compressions.
    """
    return cast("Pixels", read_samples(path, _DTYPES))


def read_samples(path: StrPath, dtypes: Sequence[str]) -> NDArray[Any]:
    """Read a file as `read_image` does, of one of these dtypes.

    Raises
    ------
    OSError, ValueError, ImportError
        As `read_image`.
    """
    with decoding(path) as file:
        head = file.read(8)
        if not head:
            raise ValueError("an empty file")
        file.seek(0)
        for magics, decode in _DECODERS.items():
            if head.startswith(magics):
                return _as_samples(decode(file), dtypes)

        raise ValueError(
            "not an image of a known format: PNG, PBM/PGM/PPM, JPEG, WebP, HEIF, BMP, TIFF, .npy "
            "or PFM"
        )


def is_picture(path: StrPath) -> bool:
    """Return whether a file begins like a picture for viewers: not TIFF, an array or PFM.

    Raises
    ------
    OSError
        If the file cannot be read.
    """
    with decoding(path) as file:
        return file.read(8).startswith(RASTER_MAGICS + HEIF_MAGICS)


def read_mask(path: StrPath | None, *, level: int = 1) -> NDArray[np.bool_] | None:
    """Read a mask: True where a channel other than alpha reaches the level; None without a file.

    Raises
    ------
    OSError, ValueError
        As `read_image`; ValueError also if the samples are not integers.
    """
    if path is None:
        return None

    pixels = np.atleast_3d(read_image(path))[:, :, :3]
    if pixels.dtype.kind != "u":
        raise ValueError(f"{path}: a mask has 8 or 16-bit samples, this has {pixels.dtype}")
    return np.any(pixels >= level, axis=2)


def as_image(samples: NDArray[Any]) -> Pixels:
    """Check that decoded samples form an image, and return it in its type and shape in memory."""
    return cast("Pixels", _as_samples(samples, _DTYPES))


def _as_samples(samples: NDArray[Any], dtypes: Sequence[str]) -> NDArray[Any]:
    if samples.shape[2:] == (1,):
        samples = samples[:, :, 0]

    if not channels(samples.shape):
        raise ValueError(f"samples of shape {samples.shape}, an image has 1, 3 or 4 channels")

    if samples.dtype == np.float64:
        with np.errstate(over="raise"):
            samples = samples.astype(np.float32)

    if samples.dtype.name not in dtypes:
        accepted = f"{', '.join(dtypes[:-1])} or {dtypes[-1]}"
        raise ValueError(f"samples of type {samples.dtype}; accepts {accepted}")
    return np.ascontiguousarray(samples, samples.dtype.newbyteorder("="))


def write_image(path: StrPath, image: Pixels) -> None:
    """Write an image in the format that the suffix names.

    ========================  ============================================================
    suffix                    holds
    ========================  ============================================================
    ``.png``                  uint8 gray, RGB, RGB with alpha; uint16 gray
    ``.pgm``, ``.ppm``        uint8 and uint16 gray; uint8 RGB
    ``.bmp``                  uint8 gray, RGB
    ``.jpg``, ``.jpeg``       uint8 gray, RGB (with loss: quality 95, no chroma subsampling)
    ``.tif``, ``.tiff``       all, uncompressed
    ``.npy``                  all
    ``.pfm``                  float32 gray, RGB
    ========================  ============================================================

    Parameters
    ----------
    path
        The file; an existing one is replaced once the new one is complete.
    image
        uint8, uint16 or float32 of shape (H, W), (H, W, 3) or (H, W, 4).

    Raises
    ------
    TypeError
        If the image is not an array of one of these dtypes.
    ValueError
        If its shape is not that of an image, the suffix is unknown, or the format cannot hold it.
    OSError
        If the file cannot be written.
    ImportError
        If the format needs the extra ``io`` and that is not installed.
    """
    pixels = as_numbers(
        image, "image", _DTYPES, *(("H", "W", *count) for count in ((), (3,), (4,)))
    )
    kind = pixels.dtype.name, channels(pixels.shape)
    ending = suffix(path)
    if ending not in _ENCODERS:
        raise ValueError(f"path must end in one of {', '.join(_ENCODERS)}, got {ending!r}")

    encode, kinds = _ENCODERS[ending]
    if kind not in kinds:
        able = ", ".join(other for other, (_, held) in _ENCODERS.items() if kind in held)
        raise ValueError(
            f"{ending} cannot hold {kind[0]} samples in {kind[1]} channel(s); these can: {able}"
        )

    with replacing(path) as file:
        encode(file, np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("=")))

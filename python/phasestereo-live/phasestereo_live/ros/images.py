"""Convert between arrays and images in ``sensor_msgs/Image`` and ``CompressedImage``.

The library rosbags-image knows the encodings. This module checks sizes before it sees a message,
and removes the padding of rows, which it does not expect. It decodes pictures like image files:
within the same bounds, and with all their bits.
"""

from __future__ import annotations

import io
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo.io.files import named
from phasestereo.io.image import as_image
from phasestereo.io.limits import check_size
from phasestereo.io.pixels import Pixels
from phasestereo.io.raster import RASTER_MAGICS, decode_raster

_BAYER = [f"bayer_{order}" for order in ("rggb", "bggr", "gbrg", "grbg")]
_GRAY = {"mono8": 1, "mono16": 2, "8UC1": 1, "16UC1": 2, "32FC1": 4}
_COLORS = {
    "rgb8": {"rgb8": 3, "bgr8": 3, "8UC3": 3, "rgba8": 4, "bgra8": 4}
    | {"uyvy": 2, "yuv422": 2, "yuyv": 2, "yuv422_yuy2": 2}
    | {f"{order}8": 1 for order in _BAYER},
    "rgb16": {"rgb16": 6, "bgr16": 6, "rgba16": 8, "bgra16": 8}
    | {f"{order}16": 2 for order in _BAYER},
}

# Encoding -> bytes of a pixel, and the encoding to convert to.
_ENCODINGS = {name: (size, name) for name, size in _GRAY.items()} | {
    name: (size, target) for target, sizes in _COLORS.items() for name, size in sizes.items()
}
_SAME = {"8UC3": "bgr8"}  # by the convention of OpenCV, which the library leaves open
_LONGEST_NAME = 40  # characters of a name from a message


def decode_image(message: Any) -> Pixels:
    """Return the image of a message.

    Parameters
    ----------
    message
        A ``sensor_msgs/Image`` (mono8, mono16, rgb8, bgr8, rgba8, bgra8, rgb16, bgr16, rgba16,
        bgra16, 8UC1, 8UC3, 16UC1, 32FC1, uyvy, yuyv, or a Bayer pattern of 8 or 16 bits, which
        OpenCV interpolates) or a ``sensor_msgs/CompressedImage`` (JPEG or PNG).

    Returns
    -------
    ndarray
        uint8, uint16 or float32, (H, W) gray or (H, W, 3) RGB; alpha is left out.

    Raises
    ------
    ValueError
        If the encoding is different, the data is cut short or damaged, or the image has more pixels
        than `phasestereo.io.max_pixels`.
    ImportError
        If the extra ``ros`` is not installed.
    """
    if hasattr(message, "format"):
        return _decompressed(message)

    encoding, rows, cols, step = message.encoding, message.height, message.width, message.step
    if encoding not in _ENCODINGS:
        known = ", ".join(_ENCODINGS)
        raise ValueError(f"encoding: got {_short(encoding)}; accepts {known}")

    length = cols * _ENCODINGS[encoding][0]
    data = np.frombuffer(message.data, np.uint8)
    if not rows or not cols or step < length:
        raise ValueError(f"image: got {cols} x {rows} pixels with rows of {step} bytes")
    if data.size < rows * step:
        raise ValueError(f"image: cut short, it has {data.size} bytes of {rows * step}")
    with named("image"):
        check_size(cols, rows)

    # Rows may be padded at their end: `step` is their length in bytes.
    packed = data[: rows * step].reshape(rows, step)[:, :length].copy()
    return _developed(packed, encoding, (rows, cols), is_bigendian=bool(message.is_bigendian))


def _decompressed(message: Any) -> Pixels:
    data = bytes(message.data)
    encoding = message.format.partition(";")[0].strip()
    if not data.startswith(RASTER_MAGICS):
        raise ValueError(f"format: got {_short(message.format)}; accepts jpeg and png")

    with named("image"):
        samples = as_image(decode_raster(io.BytesIO(data)))

    # A picture of a Bayer pattern is gray; the table has names for both depths.
    is_raw = samples.ndim == 2 and encoding in _ENCODINGS and encoding.startswith("bayer_")
    if is_raw and _ENCODINGS[encoding][0] == samples.itemsize:
        return _developed(samples, encoding, samples.shape)
    return samples[..., :3] if samples.ndim == 3 else samples


def _developed(
    data: NDArray[Any], encoding: str, shape: tuple[int, ...], *, is_bigendian: bool = False
) -> Pixels:
    """Return samples without padding as an image; interpolate a Bayer pattern."""
    message = SimpleNamespace(
        height=shape[0],
        width=shape[1],
        encoding=_SAME.get(encoding, encoding),
        is_bigendian=is_bigendian,
        data=data,
    )
    convert = require("rosbags.image", extra="ros").message_to_cvimage
    return as_image(np.asarray(convert(message, _ENCODINGS[encoding][1])))


def _short(name: str) -> str:
    """Return a name from a message for an error: its beginning, if it is long."""
    return repr(name) if len(name) <= _LONGEST_NAME else f"{name[:_LONGEST_NAME]!r}..."


def encode_image(array: NDArray[Any]) -> dict[str, Any]:
    """Return the fields, except the header, of a ``sensor_msgs/Image`` that holds an array.

    Parameters
    ----------
    array
        uint8, uint16 or float32, (H, W), or uint8 (H, W, 3), RGB.
    """
    names = {"uint8": "mono8", "uint16": "16UC1", "float32": "32FC1"}
    plain = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
    rows, cols = plain.shape[:2]

    return {
        "height": rows,
        "width": cols,
        "encoding": "rgb8" if plain.ndim == 3 else names[plain.dtype.name],
        "is_bigendian": 0,
        "step": plain.strides[0],
        "data": plain.reshape(-1).view(np.uint8),
    }

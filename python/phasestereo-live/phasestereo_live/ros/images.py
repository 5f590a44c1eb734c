"""Images as messages hold them: ``sensor_msgs/Image`` and ``CompressedImage``, and arrays."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo.io.files import named
from phasestereo.io.image import as_image
from phasestereo.io.pixels import Pixels
from phasestereo.io.raster import RASTER_MAGICS, decode_raster

# Encoding -> type of its samples, how many a pixel has, and which of them are red, green and blue
# (or red, green, blue and alpha).
_ENCODINGS: dict[str, tuple[str, int, tuple[int, ...]]] = {
    "mono8": ("u1", 1, (0,)),
    "8UC1": ("u1", 1, (0,)),
    "mono16": ("u2", 1, (0,)),
    "16UC1": ("u2", 1, (0,)),
    "32FC1": ("f4", 1, (0,)),
    "rgb8": ("u1", 3, (0, 1, 2)),
    "bgr8": ("u1", 3, (2, 1, 0)),
    "8UC3": ("u1", 3, (2, 1, 0)),
    "rgba8": ("u1", 4, (0, 1, 2)),
    "bgra8": ("u1", 4, (2, 1, 0)),
    "rgb16": ("u2", 3, (0, 1, 2)),
    "bgr16": ("u2", 3, (2, 1, 0)),
    **{
        f"bayer_{order}{bits}": (f"u{bits // 8}", 1, (0,))
        for order in ("rggb", "bggr", "gbrg", "grbg")
        for bits in (8, 16)
    },
}
ENCODINGS = tuple(_ENCODINGS)
"""Encodings that are read."""


def decode_image(message: Any) -> Pixels:
    """Return the image of a message.

    Parameters
    ----------
    message
        A ``sensor_msgs/Image`` (mono8, mono16, rgb8, bgr8, rgba8, bgra8, rgb16, bgr16, 8UC1, 8UC3,
        16UC1, 32FC1, or a Bayer pattern of 8 or 16 bits, which OpenCV interpolates) or a
        ``sensor_msgs/CompressedImage`` (JPEG or PNG).

    Returns
    -------
    ndarray
        uint8, uint16 or float32, (H, W) gray or (H, W, 3) RGB; alpha is left out.

    Raises
    ------
    ValueError
        If the encoding is another, or the data is cut short or damaged.
    ImportError
        If Pillow (compressed) or OpenCV (Bayer) is not installed.
    """
    if hasattr(message, "format"):
        return _decompressed(message)
    samples = _samples(message)
    return _developed(samples, message.encoding)


def _samples(message: Any) -> NDArray[Any]:
    """Return the samples as they are stored: (H, W) or (H, W, C), in the order of red to blue."""
    if message.encoding not in _ENCODINGS:
        known = ", ".join(ENCODINGS)
        raise ValueError(f"encoding: got {message.encoding!r}; accepts {known}")
    kind, count, order = _ENCODINGS[message.encoding]
    dtype = np.dtype((">" if message.is_bigendian else "<") + kind)
    rows, cols, step = message.height, message.width, message.step
    data = np.frombuffer(bytes(message.data), np.uint8)

    if not rows or not cols or step < cols * count * dtype.itemsize:
        raise ValueError(f"image: got {cols} x {rows} pixels with rows of {step} bytes")
    if data.size < rows * step:
        raise ValueError(f"image: cut short, it has {data.size} bytes of {rows * step}")

    # Rows may be padded at their end: `step` is their length in bytes.
    lines = data[: rows * step].reshape(rows, step)[:, : cols * count * dtype.itemsize]
    pixels = np.ascontiguousarray(lines).view(dtype).reshape(rows, cols, count)
    return pixels[:, :, list(order)].astype(dtype.newbyteorder("="), copy=False)


def _decompressed(message: Any) -> Pixels:
    data = bytes(message.data)
    encoding = message.format.partition(";")[0].strip()
    if not data.startswith(RASTER_MAGICS):
        raise ValueError(f"format: got {message.format!r}; accepts jpeg and png")

    with named("image"):
        samples = as_image(decode_raster(io.BytesIO(data)))
    return _developed(samples[:, :, np.newaxis] if samples.ndim == 2 else samples, encoding)


def _developed(samples: NDArray[Any], encoding: str) -> Pixels:
    """Return samples as an image: a Bayer pattern is interpolated, alpha left out."""
    if samples.shape[2] == 1 and encoding.startswith("bayer_"):
        cv2 = require("cv2", extra="ros")
        order = encoding.removeprefix("bayer_")[:4].upper()
        code = getattr(cv2, f"COLOR_Bayer{order}2RGB")
        return as_image(np.asarray(cv2.cvtColor(np.ascontiguousarray(samples[:, :, 0]), code)))
    return as_image(samples[:, :, :3])


def encode_image(array: NDArray[Any]) -> dict[str, Any]:
    """Return the fields of a ``sensor_msgs/Image`` that holds an array, but for its header.

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

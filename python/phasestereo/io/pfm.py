"""PFM, the portable float map: float32 samples behind a three-line header, bottom row first.

Own code because no reader at hand is exact on the files that stereo data sets come in. Pillow 13
has no color PFM, no scale of more than ten characters, and does not notice trailing data.
OpenCV 5 divides by the scale, so Middlebury's ground truth (scale -0.003922) comes out 255 times
too large. imageio 2.38 returns integers, with 0 for inf.
"""

from __future__ import annotations

import math
import os
import re
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from phasestereo._images import as_numbers
from phasestereo.io.drafts import replacing
from phasestereo.io.files import StrPath, decoding
from phasestereo.io.limits import check_size
from phasestereo.io.pixels import channels

_MAGICS = {1: b"Pf", 3: b"PF"}  # by the number of channels
_HEADER = re.compile(rb"(P[fF])\s+(\S+)\s+(\S+)\s+(\S+)(?:\r\n|\s)")
_HEADER_LIMIT = 256  # bytes; the longest headers in use have about 40
_COUNT = re.compile(rb"\d{1,10}")
_SCALE = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def read_pfm(path: StrPath) -> NDArray[np.float32]:
    """Read a PFM file.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    ndarray
        float32, shape (H, W) for ``Pf`` or (H, W, 3) for ``PF``, top row first. Samples are
        returned exactly as stored, to the bit, inf and NaN included.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is not a PFM file, or its header does not fit the amount of data.

    Notes
    -----
    Only the sign of the scale is used: negative means little endian. The format's description [1]_
    lets its magnitude be the physical unit of a sample, but the files of the stereo data sets hold
    plain pixels regardless of the scale (Middlebury's have 0.003922, about 1/255, and disparities
    that lie, unscaled, between the vmin and vmax of their calibration), so samples are never
    multiplied by it.

    References
    ----------
    .. [1] Paul Debevec, PFM: Portable FloatMap, https://netpbm.sourceforge.net/doc/pfm.html
    """
    with decoding(path) as file:
        return decode_pfm(file)


def decode_pfm(file: BinaryIO) -> NDArray[np.float32]:
    """Decode a PFM file opened at its start; see `read_pfm`."""
    shape, byte_order, start = _parse_header(file.read(_HEADER_LIMIT))
    expected = start + 4 * math.prod(shape)
    actual = os.fstat(file.fileno()).st_size
    if actual != expected:  # checked before anything is allocated
        raise ValueError(f"the header asks for {expected} bytes, but the file has {actual}")

    check_size(shape[1], shape[0])
    file.seek(start)
    samples = np.fromfile(file, dtype=f"{byte_order}f4", count=math.prod(shape))
    return np.ascontiguousarray(samples.reshape(shape)[::-1], dtype=np.float32)


def _parse_header(head: bytes) -> tuple[tuple[int, ...], str, int]:
    """Return the shape, the byte order and where the samples start."""
    match = _HEADER.match(head)
    if match is None:
        raise ValueError("not a PFM file: it does not start with 'Pf' or 'PF', size and scale")

    magic, width, height, scale = match.groups()
    if not (_COUNT.fullmatch(width) and _COUNT.fullmatch(height)):
        raise ValueError(f"the PFM size must be two whole numbers, got {width!r} and {height!r}")
    if int(width) == 0 or int(height) == 0:
        raise ValueError(f"the PFM size must not be zero, got {int(width)} x {int(height)}")
    if not _SCALE.fullmatch(scale) or float(scale) == 0 or math.isinf(float(scale)):
        raise ValueError(f"the PFM scale must be a finite number other than zero, got {scale!r}")

    # The sign of the scale is the byte order; its size is not used.
    color = (3,) if magic == b"PF" else ()
    byte_order = "<" if float(scale) < 0 else ">"
    return (int(height), int(width), *color), byte_order, match.end()


def write_pfm(path: StrPath, array: NDArray[np.float32]) -> None:
    """Write a PFM file, little endian, scale -1.

    Parameters
    ----------
    path
        The file; an existing one is replaced once the new one is complete.
    array
        float32, shape (H, W) or (H, W, 3), top row first. Written to the bit, inf and NaN included.

    Raises
    ------
    TypeError
        If the array is not a float32 array.
    ValueError
        If its shape is not that of an image.
    OSError
        If the file cannot be written.
    """
    samples = as_numbers(array, "array", ("float32",), ("H", "W"), ("H", "W", 3))
    with replacing(path) as file:
        encode_pfm(file, samples)


def encode_pfm(file: BinaryIO, array: NDArray[Any]) -> None:
    """Encode a checked array; see `write_pfm`."""
    height, width = array.shape[:2]
    file.write(b"%s\n%d %d\n-1\n" % (_MAGICS[channels(array.shape)], width, height))
    file.write(np.ascontiguousarray(array[::-1], dtype="<f4").data)

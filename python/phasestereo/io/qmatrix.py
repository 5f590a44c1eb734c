"""OpenCV's matrix Q, in the files in which people keep it."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from phasestereo.io.files import StrPath, decoding, read_bounded, suffix
from phasestereo.io.limits import SMALL
from phasestereo.io.npz import decode_array, decode_arrays

Matrix = NDArray[np.float64]

# A 4 x 4 matrix named Q as cv2.FileStorage writes it; it may be one of many things in the file.
_YAML = r"^Q: *!!opencv-matrix\s+rows: *4\s+cols: *4\s+dt: *[df]\s+data: *\[([^\]]*)\]"
_XML = (
    r'<Q type_id="opencv-matrix">\s*<rows>4</rows>\s*<cols>4</cols>\s*<dt>[df]</dt>'
    r"\s*<data>([^<]*)</data>\s*</Q>"
)


def read_q(path: StrPath) -> Matrix:
    """Read the matrix Q of OpenCV's ``stereoRectify``, for `Calibration.from_q`.

    Parameters
    ----------
    path
        ``.npy`` with the matrix; ``.npz`` with an array named ``Q``; ``.txt`` with four rows of
        four numbers, set apart by spaces or commas; ``.yml``, ``.yaml`` or ``.xml`` as written by
        ``cv2.FileStorage``, with a matrix named ``Q``.

    Returns
    -------
    ndarray
        float64, (4, 4).

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If the suffix is unknown, or the file does not hold such a matrix.
    """
    ending = suffix(path)
    if ending not in _DECODERS:
        raise ValueError(
            f"path of a matrix Q must end in one of {', '.join(_DECODERS)}, got {ending!r}"
        )

    with decoding(path) as file:
        matrix = _DECODERS[ending](file)
        if matrix.shape != (4, 4) or matrix.dtype.kind not in "iuf":
            raise ValueError(f"Q is 4 x 4 numbers, this is {matrix.dtype} of shape {matrix.shape}")
        return matrix.astype(np.float64)


def _from_npy(file: BinaryIO) -> Matrix:
    return decode_array(read_bounded(file, SMALL))


def _from_npz(file: BinaryIO) -> Matrix:
    arrays = decode_arrays(read_bounded(file, SMALL), SMALL)
    if "Q" not in arrays:
        raise ValueError(f"no array is named Q, only {', '.join(arrays) or 'nothing'}")
    return arrays["Q"]


def _from_text(file: BinaryIO) -> Matrix:
    rows = [line.split() for line in _text(file).replace(",", " ").splitlines()]
    return np.array([[float(word) for word in row] for row in rows if row])


def _from_storage(file: BinaryIO, pattern: str) -> Matrix:
    found = re.search(pattern, _text(file), re.MULTILINE)
    if found is None:
        raise ValueError("no 4 x 4 matrix of real numbers is named Q, as cv2.FileStorage writes it")

    numbers = [float(word) for word in found.group(1).replace(",", " ").split()]
    if len(numbers) != 16:
        raise ValueError(f"the matrix Q has {len(numbers)} numbers instead of 16")
    return np.array(numbers).reshape(4, 4)


def _text(file: BinaryIO) -> str:
    return read_bounded(file, SMALL).decode("utf-8-sig")


_DECODERS: dict[str, Callable[[BinaryIO], Matrix]] = {
    ".npy": _from_npy,
    ".npz": _from_npz,
    ".txt": _from_text,
    ".yml": partial(_from_storage, pattern=_YAML),
    ".yaml": partial(_from_storage, pattern=_YAML),
    ".xml": partial(_from_storage, pattern=_XML),
}

"""NumPy's ``.npy``: one array of plain numbers. Pickled objects are never loaded."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.lib import format as npy_format

if TYPE_CHECKING:
    from numpy.typing import NDArray

_DTYPES = ("uint8", "uint16", "float32", "float64")


def decode_npy(file: BinaryIO) -> NDArray[Any]:
    """Decode an array of numbers that images are made of, whatever its shape.

    Raises
    ------
    ValueError
        If the dtype is another, or the header does not fit the amount of data.
    """
    shape, fortran_order, dtype = read_header(file)
    if dtype.name not in _DTYPES:
        raise ValueError(f"the array has dtype {dtype}, an image has one of {', '.join(_DTYPES)}")
    expected = file.tell() + math.prod(shape) * dtype.itemsize
    actual = os.fstat(file.fileno()).st_size
    if actual != expected:  # compared before anything is allocated
        raise ValueError(f"the header asks for {expected} bytes, but the file has {actual}")
    samples = np.fromfile(file, dtype, math.prod(shape))
    samples = samples.reshape(shape, order="F" if fortran_order else "C")
    return np.ascontiguousarray(samples, dtype.newbyteorder("="))


def read_header(file: BinaryIO) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Read shape, whether columns come first, and dtype; the data begin where the file is then."""
    version = npy_format.read_magic(file)
    if version == (1, 0):
        return npy_format.read_array_header_1_0(file)
    if version == (2, 0):
        return npy_format.read_array_header_2_0(file)
    raise ValueError(f"the .npy format is version {version}, arrays of numbers have 1.0 or 2.0")


def encode_npy(file: BinaryIO, array: NDArray[Any]) -> None:
    """Encode an array."""
    np.save(file, array, allow_pickle=False)

"""NumPy's ``.npy``, one array of plain numbers, and ``.npz``, a zip of these.

Pickled objects are never loaded, and no zip is unpacked beyond a limit in bytes.
"""

from __future__ import annotations

import io
import math
import os
import struct
import zipfile
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from phasestereo.io.limits import check_size

_DTYPES = ("uint8", "uint16", "int16", "float32", "float64")
_MAGIC = 8  # bytes before the length of the header
_LONGEST_HEADER = 2**14  # bytes; an image has about 120
_MOST_ARRAYS = 256
_METHODS = zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED  # as NumPy writes; others may ask for gigabytes


def decode_npy(file: BinaryIO) -> NDArray[Any]:
    """Decode an array of numbers that images or maps are made of, whatever its shape.

    Raises
    ------
    ValueError
        If the dtype is wrong, the header does not fit the amount of data, or asks for more pixels
        than allowed.
    """
    shape, fortran_order, dtype = read_header(file)
    if dtype.name not in _DTYPES:
        raise ValueError(
            f"the array has dtype {dtype}, images and maps have one of {', '.join(_DTYPES)}"
        )

    count = check_length(file, shape, dtype, os.fstat(file.fileno()).st_size)
    if len(shape) > 1 and 0 not in shape:
        check_size(shape[1], shape[0])

    samples = np.fromfile(file, dtype, count)
    samples = samples.reshape(shape, order="F" if fortran_order else "C")
    return np.ascontiguousarray(samples, dtype.newbyteorder("="))


def read_header(file: BinaryIO) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Read shape, whether columns come first, and dtype; leave the file at the data."""
    version = npy_format.read_magic(file)

    # The header begins with its length, in 2 bytes up to version 1.0, in 4 later.
    (length,) = struct.unpack("<I", file.read(4 if version > (1, 0) else 2).ljust(4, b"\0"))
    if length > _LONGEST_HEADER:
        raise ValueError(f"the .npy header has {length} bytes; at most {_LONGEST_HEADER} are read")

    # NumPy reads the length once more.
    file.seek(_MAGIC)
    if version == (1, 0):
        return npy_format.read_array_header_1_0(file)
    if version == (2, 0):
        return npy_format.read_array_header_2_0(file)

    raise ValueError(f"the .npy format is version {version}, arrays of numbers have 1.0 or 2.0")


def check_length(file: BinaryIO, shape: tuple[int, ...], dtype: np.dtype[Any], actual: int) -> int:
    """Count the values after the header; refuse other data before anything is allocated."""
    count = math.prod(shape)
    expected = file.tell() + count * dtype.itemsize
    if actual != expected:
        raise ValueError(f"the header asks for {expected} bytes, but the file has {actual}")
    return count


def encode_npy(file: BinaryIO, array: NDArray[Any]) -> None:
    """Encode an array."""
    np.save(file, array, allow_pickle=False)


def decode_arrays(content: bytes, most: int) -> dict[str, NDArray[Any]]:
    """Return the arrays of a ``.npz`` file by their names.

    Parameters
    ----------
    content
        The file.
    most
        The most bytes of all arrays together.

    Raises
    ------
    ValueError
        If they have more, or the file is damaged or holds anything but plain arrays.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = archive.infolist()
            # No entry unpacks to more than its claimed size.
            size = sum(entry.file_size for entry in entries)
            if size > most or len(entries) > _MOST_ARRAYS:
                raise ValueError(
                    f"the arrays take {size} bytes in {len(entries)} files; at most {most} bytes "
                    f"in {_MOST_ARRAYS} are read"
                )

            if any(entry.compress_type not in _METHODS for entry in entries):
                raise ValueError("the arrays are packed otherwise than NumPy packs them")

            return {
                entry.filename.removesuffix(".npy"): decode_array(archive.read(entry))
                for entry in entries
            }
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError) as error:
        raise ValueError(f"not a sound .npz file: {error}") from error


def decode_array(content: bytes) -> NDArray[Any]:
    """Return the array of a ``.npy`` file.

    Raises
    ------
    ValueError
        If the content is damaged, has objects in it, or is not as long as its header says.
    """
    file = io.BytesIO(content)
    shape, columns_first, dtype = read_header(file)
    if dtype.hasobject:
        raise ValueError("an array of objects, which are never loaded")
    start, count = file.tell(), check_length(file, shape, dtype, len(content))

    if not dtype.itemsize:
        return np.zeros(shape, dtype)  # np.frombuffer refuses items of no bytes

    array = np.frombuffer(content, dtype, count, start)
    return array.reshape(shape, order="F" if columns_first else "C").copy()

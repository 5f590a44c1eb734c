"""NumPy's ``.npz``, a zip of arrays, unpacked to no more bytes than are allowed."""

from __future__ import annotations

import io
import zipfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo.io.npy import check_length, read_header

_MOST_ARRAYS = 256
_METHODS = zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED  # as NumPy writes; others may ask for gigabytes


def decode_arrays(content: bytes, most: int) -> dict[str, NDArray[Any]]:
    """Return the arrays of a ``.npz`` file by their names.

    Parameters
    ----------
    content
        The file.
    most
        Bytes that all arrays together may have.

    Raises
    ------
    ValueError
        If they have more, or the file is damaged or holds anything but plain arrays.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = archive.infolist()
            # No entry unpacks to more than the size that it claims.
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

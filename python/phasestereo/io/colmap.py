"""Depth and normal maps of COLMAP: ``width&height&channels&``, then floats, channel by channel."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo.io.drafts import replacing
from phasestereo.io.files import StrPath, decoding, read_bounded
from phasestereo.io.limits import check_size

COLMAP = ".bin"
"""The suffix of these files: ``NAME.geometric.bin`` and ``NAME.photometric.bin``."""

_HEADER = 64  # bytes: three numbers and their separators are fewer
_CHANNELS = 1, 3


def read_colmap(path: StrPath) -> NDArray[np.float32]:
    """Read a depth or a normal map of COLMAP [1]_.

    Parameters
    ----------
    path
        The file, ``.bin``.

    Returns
    -------
    ndarray
        float32, (H, W) or (H, W, 3), as it is stored: 0 where COLMAP has no depth or normal.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is damaged, or has more pixels than `phasestereo.io.max_pixels` says.

    References
    ----------
    .. [1] COLMAP, output format, dense reconstruction,
       https://colmap.github.io/format.html#depth-and-normal-maps
    """
    with decoding(path) as file:
        head = file.read(_HEADER)
        fields = head.split(b"&", 3)
        if len(fields) != 4 or not all(one.isdigit() for one in fields[:3]):
            raise ValueError("is not a depth map of COLMAP: no width&height&channels& at its start")
        cols, rows, channels = (int(one) for one in fields[:3])
        if channels not in _CHANNELS:
            raise ValueError(f"has {channels} channels; depth maps have 1, normal maps 3")
        check_size(cols, rows)

        wanted = 4 * cols * rows * channels
        data = fields[3] + read_bounded(file, wanted + _HEADER)
        if len(data) != wanted:
            raise ValueError(f"has {len(data)} bytes of values; {wanted} belong to its size")
    planes = np.frombuffer(data, "<f4").reshape(channels, rows, cols).astype(np.float32)
    return planes[0] if channels == 1 else np.moveaxis(planes, 0, 2)


def write_colmap(path: StrPath, values: NDArray[Any]) -> None:
    """Write a depth map (H, W) or normals (H, W, 3) in COLMAP's format, 0 where missing.

    Raises
    ------
    OSError
        If the file cannot be written.
    ValueError
        If the suffix or the shape is wrong.
    """
    if not os.fspath(path).lower().endswith(COLMAP):
        raise ValueError(f"path of a map of COLMAP must end in {COLMAP}, got {os.fspath(path)!r}")
    planes = np.moveaxis(np.atleast_3d(values), 2, 0)
    channels, rows, cols = planes.shape
    if channels not in _CHANNELS:
        raise ValueError(f"values must have shape (H, W) or (H, W, 3), got {values.shape}")
    with replacing(path) as file:
        file.write(f"{cols}&{rows}&{channels}&".encode("ascii"))
        file.write(np.ascontiguousarray(planes, "<f4").data)

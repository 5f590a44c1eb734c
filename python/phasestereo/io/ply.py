"""Point clouds as PLY, the format of the Stanford 3D Scanning Repository."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo._numbers import check_type
from phasestereo.io.drafts import replacing
from phasestereo.io.files import StrPath, suffix
from phasestereo.shapes import PointCloud

_POSITION = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
_COLOR = [("red", "u1"), ("green", "u1"), ("blue", "u1")]
_BAR = [("near", "<f4"), ("far", "<f4"), ("uncertainty", "<f4")]
_NAMES = {"<f4": "float", "u1": "uchar"}
_CHUNK = 2**18  # vertices written at a time


def write_ply(path: StrPath, cloud: PointCloud) -> None:
    """Write a point cloud as a binary, little-endian PLY file [1]_.

    Parameters
    ----------
    path
        The file, ``.ply``; an existing one is replaced once the new one is complete.
    cloud
        The points; each becomes a vertex of float x, y, z; with colors also uchar red, green, blue;
        with error bars also float near and far, the depths at their ends, and uncertainty, half the
        distance between these. Coordinates are written to the bit.

    Raises
    ------
    TypeError
        If cloud is not a `PointCloud`.
    ValueError
        If the suffix is wrong.
    OSError
        If the file cannot be written.

    References
    ----------
    .. [1] Greg Turk, The PLY polygon file format, 1994.
    """
    if suffix(path) != ".ply":
        raise ValueError(f"path of a point cloud must end in .ply, got {suffix(path)!r}")
    check_type("cloud", cloud, PointCloud, "a PointCloud")

    with replacing(path) as file:
        file.write(_header(cloud))
        for start in range(0, len(cloud), _CHUNK):
            file.write(_vertices(cloud, slice(start, start + _CHUNK)).data)


def _vertices(cloud: PointCloud, part: slice) -> NDArray[Any]:
    points = cloud.points[part]
    vertices = np.empty(len(points), dtype=_columns(cloud))

    for axis, (name, _) in enumerate(_POSITION):
        vertices[name] = points[:, axis]

    if cloud.colors is not None:
        for channel, (name, _) in enumerate(_COLOR):
            vertices[name] = cloud.colors[part, channel]

    if cloud.near is not None and cloud.far is not None:
        near, far = cloud.near[part], cloud.far[part]
        for (name, _), column in zip(_BAR, (near, far, (far - near) / 2), strict=True):
            vertices[name] = column

    return vertices


def _columns(cloud: PointCloud) -> list[tuple[str, str]]:
    colored = _POSITION + ([] if cloud.colors is None else _COLOR)
    return colored + ([] if cloud.near is None else _BAR)


def _header(cloud: PointCloud) -> bytes:
    columns = _columns(cloud)
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        "comment left camera: x to the right, y down, z forward",
        f"element vertex {len(cloud)}",
        *(f"property {_NAMES[kind]} {name}" for name, kind in columns),
        "end_header\n",
    ]
    return "\n".join(lines).encode("ascii")

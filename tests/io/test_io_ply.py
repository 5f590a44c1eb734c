"""PLY: what independent readers find in our files."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo import PointCloud
from phasestereo.io import Calibration, write_ply
from support import counterpart


def cloud(*, colored: bool, count: int = 1000) -> PointCloud:
    random = np.random.default_rng(0)
    points = random.normal(0, 1000, (count, 3)).astype(np.float32)
    colors = random.integers(0, 256, (count, 3), dtype=np.uint8) if colored else None
    return PointCloud(points, colors)


@pytest.mark.parametrize("colored", [False, True])
@pytest.mark.parametrize("count", [0, 1, 1000])
def test_plyfile_reads_it(tmp_path: Path, *, colored: bool, count: int) -> None:
    plyfile = counterpart("plyfile")

    written = cloud(colored=colored, count=count)
    write_ply(tmp_path / "cloud.ply", written)

    read = plyfile.PlyData.read(tmp_path / "cloud.ply", mmap=False)
    assert (read.text, read.byte_order, len(read.elements)) == (False, "<", 1)

    vertices = read["vertex"].data
    columns = ["x", "y", "z", *(["red", "green", "blue"] if colored else [])]
    assert list(vertices.dtype.names) == columns
    assert [vertices.dtype[name].str for name in columns] == ["<f4"] * 3 + ["|u1"] * (
        len(columns) - 3
    )

    found = np.stack([vertices[name] for name in "xyz"], axis=1)
    np.testing.assert_array_equal(found, written.points)

    if written.colors is not None:
        shown = np.stack([vertices[name] for name in ("red", "green", "blue")], axis=1)
        np.testing.assert_array_equal(shown, written.colors)


def test_error_bars_are_properties_of_the_points(tmp_path: Path) -> None:
    plyfile = counterpart("plyfile")
    disparity = np.array([[10, np.nan, 0.5], [20, 5, -1]], np.float32)
    rig = Calibration.from_focal(100, 0.25, width=3, height=2)
    bar = np.full(disparity.shape, 1, np.float32)
    flags = np.zeros(disparity.shape, np.uint16)
    result = ps.Result(disparity, flags, bar, ps.Settings(), {}, uncertainty=bar)

    write_ply(tmp_path / "cloud.ply", ps.point_cloud(result, rig, yaw=0.02, keep="all"))
    found = plyfile.PlyData.read(tmp_path / "cloud.ply", mmap=False)["vertex"].data
    wanted = ps.depth_interval(result, rig, yaw=0.02, keep="all", finite=True)
    kept = np.isfinite(wanted.depth)
    for name, values in zip(("z", "near", "far"), wanted, strict=True):
        np.testing.assert_array_equal(found[name], values[kept])
    np.testing.assert_array_equal(found["uncertainty"], ((wanted.far - wanted.near) / 2)[kept])
    assert np.isinf(found["uncertainty"][1]), "it may be infinitely far"


def test_it_is_written_byte_by_byte_as_the_format_says(tmp_path: Path) -> None:
    points = np.array([[1, -2, 3.5]], np.float32)

    write_ply(tmp_path / "CLOUD.PLY", PointCloud(points, np.array([[1, 2, 255]], np.uint8)))
    header, body = (tmp_path / "CLOUD.PLY").read_bytes().split(b"end_header\n")

    assert header.decode() == (
        "ply\n"
        "format binary_little_endian 1.0\n"
        "comment left camera: x to the right, y down, z forward\n"
        "element vertex 1\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    )

    assert body == b"\0\0\x80\x3f\0\0\0\xc0\0\0\x60\x40\x01\x02\xff"


@pytest.mark.parametrize(
    ("name", "given", "error", "message"),
    [
        ("cloud.pcd", cloud(colored=True), ValueError, r"path .* \.ply, got '\.pcd'"),
        ("cloud", cloud(colored=True), ValueError, "path"),
        ("cloud.ply", np.zeros((4, 3)), TypeError, "cloud: got ndarray; accepts a PointCloud"),
        ("none/cloud.ply", cloud(colored=True), FileNotFoundError, "no such folder"),
    ],
)
def test_refusals_leave_nothing(
    tmp_path: Path, name: str, given: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        write_ply(tmp_path / name, given)
    assert os.listdir(tmp_path) == []  # noqa: PTH208 - names, hidden ones too

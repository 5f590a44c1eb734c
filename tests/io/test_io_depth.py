"""Depth maps: whole millimetres in a PNG, floats as they are, NaN: none."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given as drawn, strategies as st
from numpy.typing import NDArray

from phasestereo.io import (
    LengthUnit,
    read_depth,
    read_image,
    write_depth,
    write_image,
)
from phasestereo.io.colmap import read_colmap, write_colmap
from support import counterpart


def depths() -> NDArray[np.float32]:
    depth = np.random.default_rng(0).uniform(500, 9000, (5, 7)).astype(np.float32)
    depth[2, 3] = np.nan
    return depth


@pytest.mark.parametrize("suffix", [".tif", ".TIFF", ".npy", ".pfm"])
@pytest.mark.parametrize("unit", ["mm", "m"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_floats_come_back_exactly(
    tmp_path: Path, suffix: str, unit: LengthUnit, dtype: type
) -> None:
    depth = depths()
    depth[0, :2] = [1e-30, 1e30]
    path = tmp_path / f"depth{suffix}"

    write_depth(path, depth.astype(dtype), unit=unit)
    loaded = read_depth(path, unit=unit)

    assert loaded.dtype == np.float32
    np.testing.assert_array_equal(loaded, depth)
    assert np.isinf(read_image(path)[2, 3]) == (suffix == ".pfm")


def test_png_holds_whole_millimetres(tmp_path: Path) -> None:
    path = tmp_path / "depth.png"
    depth = np.array([[np.nan, 0.4999, 0.5, 1.49, 1.5, 65535.4, 65535.5, 1e9]], np.float32)
    write_depth(path, depth, unit="mm")
    np.testing.assert_array_equal(read_image(path), [[0, 0, 1, 1, 2, 65535, 0, 0]])
    nan = np.nan
    np.testing.assert_array_equal(read_depth(path), [[nan, nan, 1, 1, 2, 65535, nan, nan]])


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1), ("cm", 10), ("m", 1000)])
def test_png_is_in_millimetres_whatever_the_unit(
    tmp_path: Path, unit: LengthUnit, scale: int
) -> None:
    path = tmp_path / "depth.png"
    depth = depths()

    write_depth(path, depth / scale, unit=unit)

    known = ~np.isnan(depth)
    stored = read_image(path).astype(np.float64)
    np.testing.assert_allclose(stored[known], depth[known], rtol=0, atol=0.5001)
    assert stored[2, 3] == 0

    np.testing.assert_allclose(read_depth(path, unit=unit), depth / scale, atol=0.5001 / scale)


@pytest.mark.parametrize(("scale", "end"), [(1000, 65.5355), (256, 255.998), (5000, 13.1071)])
def test_png_is_in_the_units_of_kitti_and_tum_too(tmp_path: Path, scale: float, end: float) -> None:
    path = tmp_path / "depth.png"
    depth = np.array([[1.0, 12.3456, end - 0.01, end + 0.01, np.nan]], np.float32)
    write_depth(path, depth, unit="m", depth_scale=scale)
    stored = read_image(path)
    np.testing.assert_array_equal(
        stored, [[scale, round(12.3456 * scale), round((end - 0.01) * scale), 0, 0]]
    )
    np.testing.assert_allclose(
        read_depth(path, unit="m", depth_scale=scale)[0, :3], depth[0, :3], atol=0.5001 / scale
    )


def test_maps_of_colmap_are_those_of_its_own_reader(tmp_path: Path) -> None:
    """COLMAP's own reader, and its layout: width&height&channels& and floats, a row at a time."""
    pycolmap = counterpart("pycolmap")
    depth = depths()
    path = tmp_path / "left.png.geometric.bin"
    write_depth(path, depth)
    np.testing.assert_array_equal(read_depth(path), depth)
    assert path.read_bytes()[:6] == b"7&5&1&"
    theirs = pycolmap.DepthMap()
    theirs.read(path)
    np.testing.assert_array_equal(theirs.to_array(), np.nan_to_num(depth))

    normals = np.random.default_rng(1).normal(size=(5, 7, 3)).astype(np.float32)
    write_colmap(path, normals)
    np.testing.assert_array_equal(read_colmap(path), normals)
    assert path.read_bytes() == b"7&5&3&" + np.moveaxis(normals, 2, 0).tobytes()

    for content, message in (
        (b"7&5&", "is not a depth map of COLMAP"),
        (b"7&5&2&", "has 2 channels"),
        (b"7&5&1&1234", "has 4 bytes of values; 140 belong"),
        (b"900000000&5&1&", "900000000 x 5 pixels"),
    ):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=message):
            read_depth(path)
    with pytest.raises(ValueError, match=r"must end in \.bin"):
        write_colmap(tmp_path / "a.png", depth)


@drawn(code=st.integers(1, 65535), unit=st.sampled_from(["mm", "cm", "m"]))
def test_every_millimetre_survives(
    code: int, unit: LengthUnit, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path, again = (tmp_path_factory.getbasetemp() / name for name in ("one.png", "two.png"))
    write_image(path, np.array([[code]], np.uint16))
    write_depth(again, read_depth(path, unit=unit), unit=unit)
    assert read_image(again)[0, 0] == code


@pytest.mark.parametrize("suffix", [".tif", ".npy", ".pfm"])
def test_floats_that_are_no_depths_are_none(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"depth{suffix}"
    write_image(path, np.array([[1, 0, -1, np.inf, -np.inf, np.nan]], np.float32))
    np.testing.assert_array_equal(read_depth(path), [[1, *[np.nan] * 5]])


ONE = np.ones((2, 3), np.float32)


@pytest.mark.parametrize(
    ("name", "given", "error", "message"),
    [
        ("a.jpg", (ONE, "mm"), ValueError, r"path of a depth map must end in .*\.bin, got '\.jpg'"),
        ("a.png", (ONE, "inch"), ValueError, "unit must be one of mm, cm, m, got 'inch'"),
        ("a.tif", (ONE, "inch"), ValueError, "unit must be one of"),
        ("a.png", (ONE[0], "mm"), ValueError, "depth: got shape"),
        ("a.png", ([["1"]], "mm"), TypeError, "depth: got dtype .*; accepts float32 or float64"),
        ("a.png", (ONE.astype(np.uint16), "mm"), TypeError, "depth: got dtype uint16"),
        ("a.tif", (ONE * np.float32(np.inf), "mm"), ValueError, "depth must be finite .* no depth"),
        ("a.tif", (ONE - 1, "mm"), ValueError, "depth must be positive.* got 0"),
        ("a.png", (ONE - 3, "mm"), ValueError, "depth must be positive.* got -2"),
        ("a.png", (ONE * 66, "m"), ValueError, "all of it is from 66 to 66 m"),
        ("a.png", (ONE, None), ValueError, "^unit: got None for a .png, which holds lengths"),
        ("a.png", (ONE / 10, "mm"), ValueError, "all of it is from 0.0001 .*: is the unit right"),
    ],
)
def test_refusals_leave_nothing(
    tmp_path: Path, name: str, given: tuple[Any, Any], error: type[Exception], message: str
) -> None:
    depth, unit = given
    with pytest.raises(error, match=message):
        write_depth(tmp_path / name, depth, unit=unit)
    assert os.listdir(tmp_path) == []  # noqa: PTH208 - names, hidden ones too


def test_other_images_are_no_depth_maps(tmp_path: Path) -> None:
    write_image(tmp_path / "a.png", np.zeros((2, 3), np.uint8))
    with pytest.raises(ValueError, match=r"a\.png: a depth map in \.png is uint16 .* uint8"):
        read_depth(tmp_path / "a.png")

    write_image(tmp_path / "a.tif", np.zeros((2, 3), np.uint16))
    with pytest.raises(ValueError, match=r"a\.tif: a depth map in \.tif is float32"):
        read_depth(tmp_path / "a.tif")

    with pytest.raises(ValueError, match="unit must be one of"):
        read_depth(tmp_path / "a.png", unit="inch")  # type: ignore[arg-type] # what is tested

    with pytest.raises(FileNotFoundError):
        read_depth(tmp_path / "none.png")

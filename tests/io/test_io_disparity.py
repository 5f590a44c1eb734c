"""Disparity maps and ground truth: NaN in memory is each format's own mark in its files."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from test_io_pfm import floats

from phasestereo.io import (
    read_disparity,
    read_image,
    read_truth,
    write_disparity,
    write_image,
)


@pytest.mark.parametrize("suffix", [".pfm", ".npy", ".tif", ".TIFF"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_float_maps_come_back_exactly(tmp_path: Path, suffix: str, dtype: type) -> None:
    disparity = floats((5, 7))
    disparity[1, :4] = [np.nan, 0, -0.0, 1e-40]
    path = tmp_path / f"map{suffix}"

    write_disparity(path, disparity.astype(dtype))
    loaded = read_disparity(path)

    assert loaded.dtype == np.float32
    np.testing.assert_array_equal(loaded, disparity)
    assert np.isinf(read_image(path)[1, 0]) == (suffix == ".pfm")


@pytest.mark.parametrize("suffix", [".pfm", ".npy", ".tif"])
def test_nothing_infinite_is_an_estimate(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"map{suffix}"
    write_image(path, np.array([[1, np.inf, -np.inf, np.nan]], np.float32))
    np.testing.assert_array_equal(read_disparity(path), [[1, np.nan, np.nan, np.nan]])


def test_kitti_codes_are_256_times_the_disparity(tmp_path: Path) -> None:
    path = tmp_path / "map.png"
    disparity = np.array([[np.nan, 0, -0.0, 1 / 512, 1, 2.5 / 256, 65535.25 / 256]], np.float32)
    write_disparity(path, disparity)
    np.testing.assert_array_equal(read_image(path), [[0, 1, 1, 1, 256, 3, 65535]])
    decoded = np.array([[np.nan, 1 / 256, 1 / 256, 1 / 256, 1, 3 / 256, 65535 / 256]], np.float32)
    np.testing.assert_array_equal(read_disparity(path), decoded)


@given(code=st.integers(1, 65535))
def test_every_kitti_code_survives(code: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.getbasetemp() / "code.png"
    write_disparity(path, np.array([[code / 256]], np.float32))
    assert read_disparity(path)[0, 0] == code / 256


@pytest.mark.parametrize("value", [-1, -1e-9, 65535.5 / 256, 1e30])
def test_kitti_png_refuses_what_it_cannot_represent(tmp_path: Path, value: float) -> None:
    path = tmp_path / "map.png"
    with pytest.raises(ValueError, match=r"\[0, 65535\.5/256\).*1 values.*\.pfm.* instead"):
        write_disparity(path, np.array([[5, np.nan, value]], np.float32))
    assert not path.exists()


@pytest.mark.parametrize("suffix", [".pfm", ".npy", ".tif", ".png"])
@pytest.mark.parametrize(
    ("disparity", "error", "message"),
    [
        (np.array([[np.inf]], np.float32), ValueError, "finite"),
        (np.array([[-np.inf]], np.float32), ValueError, "finite"),
        (np.array([[1e300]]), ValueError, "finite"),
        (np.ones((2, 2, 3), np.float32), ValueError, "shape"),
        (np.ones((0, 2), np.float32), ValueError, "shape"),
        (np.ones((2, 2), np.int16), TypeError, "int16"),
        ([[1]], TypeError, "disparity: got dtype int"),
    ],
)
def test_arrays_that_are_no_maps_are_refused(
    tmp_path: Path, suffix: str, disparity: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        write_disparity(tmp_path / f"map{suffix}", disparity)
    assert not list(tmp_path.iterdir())


def test_unknown_suffixes_of_maps_are_refused(tmp_path: Path) -> None:
    for use in (read_disparity, lambda path: write_disparity(path, np.ones((2, 2), np.float32))):
        for name in ("map.jpg", "map", ".png"):
            with pytest.raises(ValueError, match=r"\.pfm, \.npy, \.tif, \.tiff, \.png"):
                use(tmp_path / name)


def test_images_that_are_no_maps_are_refused(tmp_path: Path) -> None:
    write_image(tmp_path / "gray.png", np.ones((3, 4), np.uint8))
    write_image(tmp_path / "codes.npy", np.ones((3, 4), np.uint16))
    write_image(tmp_path / "color.pfm", floats((3, 4, 3)))
    for name in ("gray.png", "codes.npy", "color.pfm"):
        with pytest.raises(ValueError, match=rf"{name}: a disparity map"):
            read_disparity(tmp_path / name)


def test_truth_is_the_gray_level_over_the_scale(tmp_path: Path) -> None:
    path = tmp_path / "truth.png"
    write_image(path, np.array([[0, 1, 255]], np.uint8))
    truth = read_truth(path, scale=3)
    assert truth.dtype == np.float32
    np.testing.assert_array_equal(truth, np.array([[np.nan, 1 / 3, 85]], np.float32))
    np.testing.assert_array_equal(read_truth(path, scale=1, unknown=None), [[0, 1, 255]])
    np.testing.assert_array_equal(read_truth(path, scale=0.5, unknown=255), [[0, 2, np.nan]])


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"scale": 0}, ValueError),
        ({"scale": -1}, ValueError),
        ({"scale": np.nan}, ValueError),
        ({"scale": np.inf}, ValueError),
        ({"scale": "4"}, TypeError),
        ({"scale": True}, TypeError),
        ({"scale": 4, "unknown": -1}, ValueError),
        ({"scale": 4, "unknown": 65536}, ValueError),
        ({"scale": 4, "unknown": 0.0}, TypeError),
        ({"scale": 4, "unknown": False}, TypeError),
    ],
)
def test_codings_that_make_no_sense_are_refused(
    tmp_path: Path, options: dict[str, Any], error: type[Exception]
) -> None:
    path = tmp_path / "truth.png"
    write_image(path, np.ones((2, 2), np.uint8))
    with pytest.raises(error, match=r"unknown" if "unknown" in options else r"scale"):
        read_truth(path, **options)


@pytest.mark.parametrize(("dtype", "shape"), [("float32", (3, 4)), ("uint8", (3, 4, 3))])
def test_truth_must_be_gray_integers(tmp_path: Path, dtype: str, shape: tuple[int, ...]) -> None:
    write_image(tmp_path / "truth.npy", np.ones(shape, dtype))
    with pytest.raises(ValueError, match=r"truth\.npy: gray-coded"):
        read_truth(tmp_path / "truth.npy", scale=4)

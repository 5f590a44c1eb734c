"""The command line on GeoTIFF files: masks count, and the map lies where the left image does."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.io import read_image, write_image
from phasestereo_large.geotiff import Georeference, write_geotiff
from support import counterpart

rasterio = counterpart("rasterio")
cli = counterpart("phasestereo.cli")

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

PLACE = Georeference(crs="EPSG:32631", transform=(0.5, 0, 500000, 0, -0.5, 4800000))
COUNT = 16


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> NDArray[np.uint8]:
    """Return the content of both images, bands (5, H, W), in the current folder."""
    monkeypatch.chdir(tmp_path)
    return np.random.default_rng(0).integers(1, 256, (5, 60, 95), dtype=np.uint8)


@pytest.fixture
def match(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    def match(*options: str) -> tuple[int, str]:
        code = cli.run(
            ["match", "left.tif", "right.tif", "--num-disparities", str(COUNT), *options]
        )
        return code, capsys.readouterr().err

    return match


def save(name: str, planes: NDArray[Any], **profile: Any) -> None:
    """Write bands (count, H, W) by rasterio alone."""
    count, height, width = planes.shape
    size = {"count": count, "height": height, "width": width, "dtype": planes.dtype.name}
    place = {"crs": PLACE.crs, "transform": rasterio.Affine(*PLACE.transform)}
    with rasterio.open(name, "w", driver="GTiff", **size, **place | profile) as file:
        file.write(planes)


def test_the_map_lies_where_the_left_image_does(
    scene: NDArray[np.uint8], match: Callable[..., tuple[int, str]]
) -> None:
    images = [np.moveaxis(view, 0, 2) for view in (scene[:3, :, :-5], scene[:3, :, 5:])]
    write_geotiff("left.tif", images[0], like=PLACE)
    write_geotiff("right.tif", images[1])  # whose place nobody knows

    assert match("-o", "out.tif") == (0, "")

    with rasterio.open("out.tif") as file:
        assert file.crs.to_epsg() == 32631
        assert tuple(file.transform)[:6] == PLACE.transform
        assert file.descriptions == ("disparity",)
        found = file.read(1)

    np.testing.assert_array_equal(found, ps.match(*images, num_disparities=COUNT).disparity)


def test_no_data_joins_the_given_masks(
    scene: NDArray[np.uint8], match: Callable[..., tuple[int, str]]
) -> None:
    left, right = scene[:1, :, :-5].astype(np.int16), scene[:1, :, 5:].astype(np.int16)
    left[0, 20:30, 40:50] = right[0, 40:44] = -9999
    save("left.tif", left, nodata=-9999)
    save("right.tif", right, nodata=-9999)

    mask = np.ones(left.shape[1:], np.uint8)
    mask[:7] = 0
    write_image("mask.png", mask)

    assert match("-o", "out.tif", "--left-mask", "mask.png", "--preset", "paper") == (0, "")

    expected = ps.match(
        left[0].astype(np.float32),
        right[0].astype(np.float32),
        num_disparities=COUNT,
        left_mask=(left[0] != -9999) & (mask > 0),
        right_mask=right[0] != -9999,
        preset="paper",
    ).disparity

    assert np.isnan(expected[25, 45])
    assert np.isnan(expected[3, 20])
    np.testing.assert_array_equal(read_image("out.tif"), expected)


@pytest.mark.parametrize(("option", "bands"), [("4", [3]), ("3,2,1", [2, 1, 0])])
def test_bands_are_chosen(
    scene: NDArray[np.uint8], match: Callable[..., tuple[int, str]], option: str, bands: list[int]
) -> None:
    save("left.tif", scene[:, :, :-5], photometric="minisblack")
    save("right.tif", scene[:, :, 5:], photometric="minisblack")

    code, error = match("-o", "out.tif")
    assert code == 1
    assert error.startswith("phasestereo: error: left.tif: bands: the file has 5 ")

    assert match("-o", "out.tif", "--bands", option) == (0, "")
    images = [np.moveaxis(view[bands], 0, 2) for view in (scene[:, :, :-5], scene[:, :, 5:])]
    expected = ps.match(*images, num_disparities=COUNT).disparity
    np.testing.assert_array_equal(read_image("out.tif"), expected)


@pytest.mark.parametrize(
    ("option", "message"),
    [("1,2", "--bands: got 2; accepts one, or three"), ("red", "Invalid value for --bands")],
)
def test_wrong_bands_are_wrong_usage(
    scene: NDArray[np.uint8], match: Callable[..., tuple[int, str]], option: str, message: str
) -> None:
    save("left.tif", scene[:, :, :-5])
    save("right.tif", scene[:, :, 5:])
    code, error = match("-o", "out.tif", "--bands", option)
    assert code == 2
    assert message in error


def test_plain_tiff_needs_no_rasterio(
    scene: NDArray[np.uint8],
    match: Callable[..., tuple[int, str]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    write_image("left.tif", scene[0, :, :-5])
    write_image("right.tif", scene[0, :, 5:])
    monkeypatch.setitem(sys.modules, "rasterio", None)
    assert match("-o", "out.tif") == (0, "")
    assert read_image("out.tif").shape == (60, 90)


def test_without_rasterio_nothing_is_dropped_silently(
    scene: NDArray[np.uint8],
    match: Callable[..., tuple[int, str]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    save("left.tif", scene[:1, :, :-5])
    save("right.tif", scene[:1, :, 5:])
    monkeypatch.setitem(sys.modules, "rasterio", None)

    code, error = match("-o", "out.tif")
    assert code == 1
    assert error == (
        "phasestereo: error: left.tif is a GeoTIFF, whose masks and place count: rasterio is not "
        "installed; it comes with: pip install 'phasestereo[geo]'\n"
    )

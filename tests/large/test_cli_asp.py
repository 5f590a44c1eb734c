"""The three files of the Ames Stereo Pipeline, written and read by GDAL, as that does."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

import phasestereo as ps
from support import counterpart

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from support import Run

rasterio = counterpart("rasterio")
counterpart("cyclopts")
NAMES = "left.tif", "right.tif", "out.tif"
pytestmark = pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def tile(name: str, pixels: NDArray[np.float32]) -> None:
    """Write an image as the pipeline writes its aligned tiles."""
    height, width = pixels.shape
    with rasterio.open(
        name, "w", driver="GTiff", count=1, height=height, width=width, dtype="float32",
        nodata=np.nan, tiled=True, blockxsize=256, blockysize=256, compress="lzw",
    ) as file:  # fmt: skip
        file.write(pixels, 1)


@pytest.fixture
def tiles() -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Write a rendered pair with pixels without data; return it, and right less left columns."""
    from phasestereo_bench.rendering import render_pair  # noqa: PLC0415 -- with the counterpart

    pair = render_pair(2, height=200, width=300, num_disparities=60)
    left, right = (image.mean(axis=2, dtype=np.float32) for image in (pair.left, pair.right))
    left[:15] = left[60:80, 100:130] = np.nan
    right[100:140, 180:210] = np.nan
    tile("left.tif", left)
    tile("right.tif", right)
    return left, right, -pair.truth


def written() -> NDArray[np.float32]:
    with rasterio.open("left.tif") as image, rasterio.open("out.tif") as file:
        assert (file.dtypes, file.shape) == (("float32",), image.shape)
        assert np.isnan(file.nodata)
        found: NDArray[np.float32] = file.read(1)
    return found


def test_what_is_written_leads_from_data_to_data(
    tiles: tuple[NDArray[np.float32], ...], run: Callable[..., Run]
) -> None:
    left, right, truth = tiles
    assert run("asp", *NAMES)[0] == 0
    found = written()

    rows, columns = np.nonzero(np.isfinite(found))
    partners = columns + np.rint(found[rows, columns]).astype(int)
    assert np.isfinite(left[rows, columns]).all()
    assert np.isfinite(right[rows, partners]).all()

    errors = np.abs(found - truth)[rows, columns]
    assert rows.size > 0.65 * found.size
    assert np.median(errors) < 0.2
    assert (errors > 1).mean() < 0.07


def test_a_range_is_that_of_match_with_the_other_sign(
    tiles: tuple[NDArray[np.float32], ...], run: Callable[..., Run]
) -> None:
    left, right, _ = tiles
    assert run("asp", "-r", "-40", "-R", "3", "--preset", "fast", *NAMES)[0] == 0
    expected = ps.match(
        left,
        right,
        min_disparity=-3,
        num_disparities=44,
        left_mask=np.isfinite(left),
        right_mask=np.isfinite(right),
        preset="fast",
        fill=False,
        self_rectify=False,
    )

    found = written()
    kept = np.isfinite(found)
    np.testing.assert_array_equal(found[kept], -expected.disparity[kept])
    assert kept.sum() > 0.99 * np.isfinite(expected.disparity).sum()


def test_a_tile_without_data_gives_one_without_data(run: Callable[..., Run]) -> None:
    for name in NAMES[:2]:
        tile(name, np.full((40, 50), np.nan, np.float32))
    assert run("asp", *NAMES)[0] == 0
    assert np.isnan(written()).all()


@pytest.mark.usefixtures("tiles")
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("-r", "-8", *NAMES), "--minimum: got -8 with --maximum None; accepts both"),
        (("-r", "8", "-R", "-8", *NAMES), "--minimum: got 8 with --maximum -8"),
        (("left.tif", "right.tif", "left.tif"), "--output: left.tif is an input or another"),
        (("--window", "4", *NAMES), "--window: got 4"),
    ],
)
def test_what_cannot_be_meant_is_refused(
    run: Callable[..., Run], words: tuple[str, ...], message: str
) -> None:
    code, _, err = run("asp", *words)
    assert code == 2
    assert message in err

"""Stereo photographs: both views in one picture, or two pictures in one file."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import phasestereo as ps
import phasestereo_live as live
from conftest import counterpart
from phasestereo.io import read_image, read_pair, write_image

image = counterpart("PIL.Image")

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")  # noise is matched here

RNG = np.random.default_rng(0)
LEFT, RIGHT = RNG.integers(0, 256, (2, 40, 60, 3), np.uint8)


def write_mpo(path: Path, *pictures: Any) -> None:
    first, *others = (image.fromarray(picture) for picture in pictures)
    first.save(path, format="MPO", save_all=True, append_images=others, quality=95)


@pytest.mark.parametrize(("layout", "axis"), [("side-by-side", 1), ("top-bottom", 0)])
@pytest.mark.parametrize("suffix", [".png", ".tif", ".npy"])
def test_halves_of_a_picture(tmp_path: Path, layout: Any, axis: int, suffix: str) -> None:
    write_image(tmp_path / f"both{suffix}", np.concatenate([LEFT, RIGHT], axis))
    left, right = read_pair(tmp_path / f"both{suffix}", layout)
    np.testing.assert_array_equal(left, LEFT)
    np.testing.assert_array_equal(right, RIGHT)


@pytest.mark.parametrize("count", [2, 3])
def test_the_first_two_pictures_of_a_file(tmp_path: Path, count: int) -> None:
    path = tmp_path / "photo.jpg"  # its name does not matter
    views = [np.full_like(LEFT, level) for level in (40, 90, 200)]
    write_mpo(path, *views[:count])
    left, right = read_pair(path)
    for found, given in zip((left, right), views[:2], strict=True):
        assert found.shape == given.shape
        assert np.abs(found.astype(int) - given).mean() < 3


def test_what_is_no_stereo_photograph(tmp_path: Path) -> None:
    write_image(tmp_path / "one.png", LEFT)
    write_image(tmp_path / "one.jpg", LEFT)

    for name in ("one.png", "one.jpg"):
        with pytest.raises(ValueError, match=rf"^layout: got None for .*{name}.*; accepts "):
            read_pair(tmp_path / name)

    with pytest.raises(ValueError, match="^layout: got 'both'; accepts 'side-by-side'"):
        read_pair(tmp_path / "one.png", "both")  # type: ignore[arg-type]

    write_image(tmp_path / "odd.png", LEFT[:, 1:])
    with pytest.raises(ValueError, match="^layout: 'side-by-side' needs an even number of columns"):
        read_pair(tmp_path / "odd.png", "side-by-side")

    write_mpo(tmp_path / "unlike.mpo", LEFT, RIGHT[:20])
    with pytest.raises(ValueError, match=r"unlike\.mpo: pictures of \(40, 60\) and \(20, 60\)"):
        read_pair(tmp_path / "unlike.mpo")

    write_mpo(tmp_path / "pair.mpo", LEFT, RIGHT)
    with pytest.raises(ValueError, match=r"pair\.mpo: the file holds 2 images, .*read_pair"):
        read_image(tmp_path / "pair.mpo")

    with pytest.raises(FileNotFoundError):
        read_pair(tmp_path / "nowhere.mpo")


def test_a_photograph_that_is_cut_short(tmp_path: Path) -> None:
    write_mpo(tmp_path / "photo.mpo", LEFT, RIGHT)
    content = (tmp_path / "photo.mpo").read_bytes()
    for length in range(3, len(content), 211):
        (tmp_path / "cut.mpo").write_bytes(content[:length])
        with pytest.raises(ValueError, match=r"cut\.mpo"):
            read_pair(tmp_path / "cut.mpo")


# Paths in place of images


@pytest.fixture
def paths(tmp_path: Path) -> tuple[str, Path]:
    scene = RNG.integers(0, 256, (80, 126), np.uint8)
    write_image(tmp_path / "left.png", scene[:, :-6])
    write_image(tmp_path / "right.png", scene[:, 6:])
    return str(tmp_path / "left.png"), tmp_path / "right.png"


def test_paths_stand_for_images(paths: tuple[str, Path]) -> None:
    images = read_image(paths[0]), read_image(paths[1])
    expected = ps.match(*images, num_disparities=16)
    matcher = ps.Matcher()

    for given in (paths, (images[0], paths[1])):
        for result in (
            ps.match(*given, num_disparities=16),
            matcher.match(*given, num_disparities=16),
        ):
            np.testing.assert_array_equal(result.disparity, expected.disparity)
            for kept, image in zip(result.pair, images, strict=True):
                np.testing.assert_array_equal(kept, image)

    assert str(ps.check(*paths)) == str(ps.check(*images))
    assert str(ps.estimate_blur(*paths)) == str(ps.estimate_blur(*images))

    [frame] = live.stream([paths], num_disparities=16)
    np.testing.assert_array_equal(frame.result.disparity, expected.disparity)

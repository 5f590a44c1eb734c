"""Vertical misalignment: what is injected is found, what is not there is not."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from phasestereo.rig.alignment import Alignment
from phasestereo_bench import degradation
from phasestereo_bench.datasets import find_scene
from support.estimating import estimated
from support.warping import moved

Plane = NDArray[np.float32]

SCENES = "tsukuba", "cones"


def gray(image: NDArray[np.uint8]) -> Plane:
    plane: Plane = image.mean(axis=2).astype(np.float32)
    return plane


def texture(rows: int, cols: int) -> Plane:
    """Return noise with detail of all sizes."""
    noise = np.random.default_rng(0)
    sizes = [2**n for n in range(5)]
    layers = [
        np.kron(noise.normal(size=(rows // n + 1, cols // n + 1)), np.ones((n, n)))[:rows, :cols]
        for n in sizes
    ]
    return np.asarray(np.sum(layers, axis=0), np.float32)


def measured(left: Plane, right: Plane) -> Alignment:
    return estimated(left, right).alignment


def views(data: Path, name: str) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    pair = find_scene(data / "middlebury", name).load()
    return pair.left, pair.right


@pytest.mark.parametrize(("down", "across"), [(0, 7), (3, 12), (-2, 0), (5, -9)])
def test_whole_pixels_are_found_whatever_the_disparity(down: int, across: int) -> None:
    scene = texture(140, 200)
    left, right = scene[20:-20, 20:-20], scene[20 - down : -20 - down, 20 + across : 180 + across]
    found = measured(left, right)
    assert found.vertical == pytest.approx(down, abs=0.02)
    assert found.rms == pytest.approx(abs(down), abs=0.02)
    assert found.rotation == pytest.approx(0, abs=0.02)
    assert found.scale == pytest.approx(1, abs=0.001)


def test_signs_and_units_of_rotation_and_scale() -> None:
    scene = texture(200, 300)
    found = measured(scene, moved(scene, clockwise=0.8, scale=1.01))
    assert found.rotation == pytest.approx(0.8, abs=0.03)
    assert found.scale == pytest.approx(1.01, abs=0.001)
    assert found.vertical == pytest.approx(0, abs=0.1)


@pytest.mark.parametrize("down", [-2.0, 0.5])
def test_injected_shifts_are_found_on_real_pairs(data: Path, down: float) -> None:
    for name in SCENES:
        left, right = views(data, name)
        before = measured(gray(left), gray(right)).vertical
        after = measured(gray(left), moved(gray(right), down=down)).vertical
        assert after - before == pytest.approx(down, abs=0.08), name


def test_one_degree_is_found_on_real_pairs(data: Path) -> None:
    for name in SCENES:
        left, right = views(data, name)
        turned = measured(gray(left), moved(gray(right), clockwise=1))
        assert turned.rotation == pytest.approx(1, abs=0.05), name
        turned = measured(moved(gray(left), clockwise=1), gray(right))
        assert turned.rotation == pytest.approx(-1, abs=0.05), name


def test_one_sided_blur_does_not_hide_a_shift_nor_make_one(data: Path) -> None:
    defocus = degradation.Degradation(degradation.disk_psf(6), noise=1)
    for name in SCENES:
        left, right = views(data, name)

        soft = gray(defocus(left))
        found = measured(soft, gray(right))

        assert found.rms < max(0.3, 4 * found.error), name

        shifted = measured(soft, moved(gray(right), down=1))
        assert shifted.vertical - found.vertical == pytest.approx(1, abs=0.15), name


@pytest.mark.parametrize(
    "pair",
    [
        (np.zeros((100, 100), np.float32), np.zeros((100, 100), np.float32)),
        (texture(100, 100), np.zeros((100, 100), np.float32)),
        (texture(47, 100), texture(47, 100)),
        (texture(1, 1), texture(1, 1)),
        (texture(120, 120), np.random.default_rng(1).normal(size=(120, 120)).astype(np.float32)),
    ],
)
def test_nothing_is_concluded_from_nothing(pair: tuple[Plane, Plane]) -> None:
    assert estimated(*pair).alignment is None

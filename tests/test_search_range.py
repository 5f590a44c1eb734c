"""The range of disparities: it holds the truth, without much else; swapped pairs are recognized."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

import phasestereo as ps
from estimating import estimated
from phasestereo_bench import degradation
from phasestereo_bench.datasets import find_scene
from test_alignment import gray

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from phasestereo.rig.search_range import SearchRange

    Plane = NDArray[np.float32]

SCENES = "tsukuba", "cones", "Playroom", "Aloe"


def found(left: Plane, right: Plane) -> SearchRange:
    search = estimated(left, right).search
    assert search.origin == "found"
    return search


def noise(seed: int, shape: tuple[int, int] = (80, 160)) -> Plane:
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


def inside(truth: NDArray[np.floating], search: SearchRange) -> float:
    last = search.min_disparity + search.num_disparities - 1
    return float(np.mean((truth >= search.min_disparity) & (truth <= last)))


@pytest.mark.parametrize("radius", [0, 6])
def test_range_holds_the_truth_and_little_else(data: Path, radius: int) -> None:
    defocus = degradation.Degradation(degradation.disk_psf(radius), noise=1)
    for name in SCENES:
        pair = find_scene(data / "middlebury", name).load()
        assert pair.truth is not None

        search = found(gray(defocus(pair.left)), gray(pair.right))
        truth = pair.truth[np.isfinite(pair.truth)]
        assert inside(truth, search) >= 0.995, name

        low, high = np.percentile(truth, [0.25, 99.75])
        assert search.num_disparities <= 2.5 * (high - low) + 4, name
        assert (search.swapped, search.mixed) == (False, False), name


def test_exchanged_images_are_reported_and_their_range_found(data: Path) -> None:
    for name in SCENES:
        pair = find_scene(data / "middlebury", name).load()
        assert pair.truth is not None
        search = found(gray(pair.right), gray(pair.left))
        assert search.swapped, name
        assert inside(-pair.truth[np.isfinite(pair.truth)], search) >= 0.995, name


def test_match_takes_the_range(data: Path) -> None:
    pair = find_scene(data / "middlebury", "cones").load()
    search = found(gray(pair.left), gray(pair.right))

    result = ps.match(
        pair.left,
        pair.right,
        min_disparity=search.min_disparity,
        num_disparities=search.num_disparities,
    )
    assert np.isfinite(result.disparity).all()


@pytest.mark.parametrize("shift", [0, 1, -1])
def test_disparities_around_zero_accuse_nobody(shift: int) -> None:
    scene = noise(0)
    search = found(scene[:, 4:-4], scene[:, 4 + shift : 156 + shift])
    assert search.min_disparity <= shift < search.min_disparity + search.num_disparities
    assert (search.swapped, search.mixed) == (False, False)


def test_toed_in_cameras_are_not_called_swapped() -> None:
    far, near = noise(0, (80, 200)), noise(1, (80, 200))
    left, right = far[:, 10:-10].copy(), far[:, :-20].copy()  # disparity -10 ...
    left[20:60, 60:120] = near[20:60, 60:120]
    right[20:60, 52:112] = near[20:60, 60:120]  # ... and 8
    search = found(left, right)
    assert search.mixed
    assert not search.swapped


@pytest.mark.parametrize(
    "pair",
    [
        (noise(0), noise(1)),
        (noise(0), np.zeros((80, 160), np.float32)),
        (noise(0, (30, 30)), noise(0, (30, 30))),
        (np.repeat(noise(0)[:, :1], 160, axis=1), np.repeat(noise(0)[:, :1], 160, axis=1)),
        (noise(0, (1, 1)), noise(0, (1, 1))),
    ],
)
def test_nothing_is_found_in_what_is_no_pair(pair: tuple[Plane, Plane]) -> None:
    assert estimated(*pair).search.origin == "default"

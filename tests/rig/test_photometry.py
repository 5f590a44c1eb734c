"""Gray levels of real pairs: gain, gamma and exposure are found back, clipped areas are counted."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo import io
from phasestereo.rig.photometry import Contrast
from phasestereo_bench import degradation
from phasestereo_bench.datasets import find_scene


def compared(left: Any, right: Any) -> Contrast:
    return ps.check(left, right).contrast


@pytest.mark.parametrize(("gamma", "gain"), [(1, 1), (2, 1), (0.5, 0.4)])
def test_gain_and_gamma_are_found_on_real_pairs_despite_blur(
    data: Path, gamma: float, gain: float
) -> None:
    change = degradation.Degradation(degradation.disk_psf(8), gamma=gamma, gain=gain, noise=1)
    for name in ("tsukuba", "cones"):
        pair = find_scene(data / "middlebury", name).load()
        found = compared(change(pair.left), pair.right)
        assert (found.gain, found.gamma) == pytest.approx((gain, gamma), rel=0.15), name


def test_real_exposure_is_found(data: Path) -> None:
    folder = data / "middlebury/MiddEval3/trainingQ"
    left, usual, dimmed = (
        io.read_image(folder / name)
        for name in ("MotorcycleE/im0.png", "Motorcycle/im1.png", "MotorcycleE/im1.png")
    )

    assert 0.9 < compared(left, usual).ratio < 1.1
    assert 1.5 < compared(left, dimmed).ratio < 2.0


def test_pixels_whose_gray_is_at_an_end_are_saturated() -> None:
    image = np.random.default_rng(0).integers(50, 200, (64, 80, 3), dtype=np.uint8)
    image[:32, :, 0] = 255  # red alone still shows differences
    image[16:48] = 255
    image[8:56, 10:30] = 7  # at the edge it would be a border, which is masked

    found, _ = ps.check(image, image).saturation
    assert found.bright == pytest.approx(0.5 * 0.75)
    assert found.dark == pytest.approx(0.75 * 0.25)

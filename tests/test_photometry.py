"""Gray levels: gain and gamma are found back, clipped and empty areas are counted."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo import io
from phasestereo._images import as_pair
from phasestereo.rig.photometry import fractions, low_texture, response, saturation
from phasestereo.rig.reduction import reduced
from phasestereo_bench import degradation
from phasestereo_bench.datasets import find_scene

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    Plane = NDArray[np.float32]

FLAT = np.zeros((60, 80), np.float32)


def scene(seed: int = 0) -> Plane:
    """Return smooth grays from 0.05 to 0.9."""
    coarse = np.random.default_rng(seed).uniform(0.05, 0.9, (10, 14))
    return np.kron(coarse, np.ones((16, 16))).astype(np.float32)


def rough(left: Plane, right: Plane) -> Plane:
    """Return disparities as rough as they come: of copies of half the size."""
    halves = reduced(left, 2), reduced(right, 2)
    small = ps.match(*halves, preset="fast", lr_check=1, fill=False).disparity
    rows, cols = small.shape
    disparity = np.full(left.shape, np.nan, np.float32)
    disparity[: 2 * rows, : 2 * cols] = 2 * np.kron(small, np.ones((2, 2), np.float32))
    return disparity


def compared(left: NDArray[Any], right: NDArray[Any]) -> tuple[float, float]:
    gray_left, gray_right, _ = fractions(*as_pair(left, right))
    return response(gray_left, gray_right, rough(gray_left, gray_right))


@pytest.mark.parametrize("gain", [0.4, 1.0])
@pytest.mark.parametrize("gamma", [0.5, 1.0, 2.0])
def test_response_is_found_where_everything_corresponds(gain: float, gamma: float) -> None:
    right = scene()
    found = response((gain * right**gamma).astype(np.float32), right, np.zeros_like(right))
    assert found == pytest.approx((gain, gamma), rel=0.04)


def test_response_takes_disparities_at_their_sign() -> None:
    wide = scene()
    left, right = 0.6 * wide[:, :-24], wide[:, 24:]  # d = 24
    found = response(left, right, np.full(left.shape, 24, np.float32))
    assert found == pytest.approx((0.6, 1), abs=0.02)


def test_outliers_holes_and_clipping_do_not_count() -> None:
    right = scene()
    disparity = np.zeros_like(right)

    noise = np.random.default_rng(1)
    wrong = noise.random(right.shape) < 0.1
    disparity[wrong] = noise.integers(-40, 40, np.count_nonzero(wrong))
    disparity[:40] = np.nan

    left = np.minimum(1.5 * right, 1).astype(np.float32)

    found = response(left, right, disparity)
    assert found == pytest.approx((1.5, 1), abs=0.05)


@pytest.mark.parametrize(
    ("left", "right"),
    [(FLAT, FLAT), (FLAT + 1, FLAT + 1), (FLAT[:5, :5], FLAT[:5, :5]), (FLAT + 1, FLAT + 0.5)],
)
def test_nothing_to_compare_is_no_difference(left: Plane, right: Plane) -> None:
    assert response(left, right, np.zeros_like(left)) == (1.0, 1.0)
    assert response(left, right, np.full_like(left, np.nan)) == (1.0, 1.0)


def test_one_gray_tells_a_gain_and_no_gamma() -> None:
    gain, gamma = response(FLAT + 0.3, FLAT + 0.6, FLAT)
    assert gamma == pytest.approx(1, abs=0.01)
    assert gain * 0.6**gamma == pytest.approx(0.3, rel=0.01)


@pytest.mark.parametrize(("gamma", "gain"), [(1, 1), (2, 1), (0.5, 0.4)])
def test_response_is_found_on_real_pairs_despite_blur(
    data: Path, gamma: float, gain: float
) -> None:
    psf = degradation.disk_psf(8)
    change = degradation.Degradation(psf, gamma=gamma, gain=gain, noise=1)
    for name in ("tsukuba", "cones"):
        pair = find_scene(data / "middlebury", name).load()
        found = compared(change(pair.left), pair.right)
        assert found == pytest.approx((gain, gamma), rel=0.12), name


def test_real_exposure_is_found(data: Path) -> None:
    folder = data / "middlebury/MiddEval3/trainingQ"

    left = io.read_image(folder / "MotorcycleE/im0.png")
    usual = io.read_image(folder / "Motorcycle/im1.png")
    dimmed = io.read_image(folder / "MotorcycleE/im1.png")

    gain, gamma = compared(left, usual)
    assert 0.95 < gain * 0.35 ** (gamma - 1) < 1.1

    gain, gamma = compared(left, dimmed)
    assert 1.5 < gain * 0.35 ** (gamma - 1) < 2.0  # at this gray; its darks differ more


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_integers_are_fractions_of_their_type(dtype: type[np.uint8 | np.uint16]) -> None:
    top = np.iinfo(dtype).max
    image = np.array([[0, top, top // 5]], dtype)
    left, right, length = fractions(*as_pair(image, np.stack([image] * 3, axis=2)))
    np.testing.assert_allclose(left, [[0, 1, 0.2]], atol=1e-6)
    np.testing.assert_allclose(right, left, atol=1e-6)
    assert length == top


@pytest.mark.parametrize(("scale", "offset"), [(1e-3, -7.0), (1e300, 0.0), (1.0, 0.0)])
def test_floats_are_fractions_of_the_range_they_lie_in(scale: float, offset: float) -> None:
    image = np.linspace(0, 1, 10_000).reshape(100, 100) * scale + offset
    left, _, length = fractions(*as_pair(image, image))
    assert length == pytest.approx(0.998 * scale)
    assert (left.min(), left.max()) == (0, 1)
    np.testing.assert_allclose(left.ravel()[5000], 0.5, atol=0.01)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("side", ["left", "right"])
def test_numbers_that_are_none_are_refused(bad: float, side: str) -> None:
    spoilt = FLAT.copy()
    spoilt[3, 3] = bad
    pair = (spoilt, FLAT) if side == "left" else (FLAT, spoilt)
    with pytest.raises(ValueError, match=f"^{side}: got NaN or infinite"):
        fractions(*as_pair(*pair))


def test_saturation_counts_pixels_not_channels() -> None:
    image = np.full((10, 10, 3), 100, np.uint8)
    image[:3, :, 0] = 255
    image[2:4, :, 1] = 255
    image[9, :5] = 7
    found = saturation(image)
    assert found.bright == pytest.approx(0.4)
    assert found.dark == pytest.approx(0.05)


def test_low_texture_is_what_noise_explains() -> None:
    noise = np.random.default_rng(0)

    image = 0.5 + noise.normal(0, 0.01, (80, 160))
    image[:, :80] += np.arange(80) % 2 * 0.2

    plane = image.astype(np.float32)
    assert low_texture(plane, 0.01) == pytest.approx(0.5)
    assert low_texture(plane, 0.0) == 0
    assert low_texture(FLAT, 0.0) == 1
    assert low_texture(FLAT[:7], 0.0) is None

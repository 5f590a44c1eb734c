"""Degradations: kernels and borders by hand, convolution against a direct loop, seeds, areas."""

import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray

from phasestereo_bench import degradation as dg

Plane = NDArray[np.float64]

KERNELS = [
    dg.gaussian_psf(0.7),
    dg.gaussian_psf(2),
    dg.disk_psf(1),
    dg.disk_psf(3.3),
    dg.motion_psf(9),
    dg.motion_psf(6.5, 30),
    dg.motion_psf(2049, 45),
]


def photograph(*shape: int, dtype: type[np.uint8] | type[np.uint16] = np.uint8) -> NDArray[Any]:
    top = np.iinfo(dtype).max
    return np.random.default_rng(5).integers(0, top, shape, dtype=dtype, endpoint=True)


def direct(image: Plane, psf: Plane) -> Plane:
    """Convolve by the definition: one product at a time, every index reflected into the image."""

    def reflect(index: int, size: int) -> int:
        index %= 2 * size
        return index if index < size else 2 * size - 1 - index

    height, width = image.shape
    up, across = psf.shape[0] // 2, psf.shape[1] // 2
    result = np.zeros(image.shape)
    for y, x in np.ndindex(*image.shape):
        for i, j in np.ndindex(*psf.shape):
            row, col = reflect(y - (i - up), height), reflect(x - (j - across), width)
            result[y, x] += psf[i, j] * image[row, col]

    return result


@pytest.mark.parametrize("psf", KERNELS, ids=lambda psf: str(psf.shape[0]))
def test_kernels_are_square_odd_normalized_and_point_symmetric(psf: Plane) -> None:
    assert psf.dtype == np.float64
    assert (psf.shape[0], psf.shape[0] % 2) == (psf.shape[1], 1)
    assert psf.sum() == pytest.approx(1, abs=1e-12)
    assert (psf >= 0).all()
    np.testing.assert_allclose(psf, psf[::-1, ::-1], atol=1e-12)


@pytest.mark.parametrize("psf", [dg.gaussian_psf(0), dg.disk_psf(0), dg.motion_psf(1, 77)])
def test_no_blur_is_the_identity(psf: Plane) -> None:
    np.testing.assert_array_equal(psf, [[1.0]])


def test_gaussian_has_its_ratios_and_ends_at_four_sigma() -> None:
    psf = dg.gaussian_psf(2)
    assert psf.shape == (17, 17)
    assert psf[8, 10] / psf[8, 8] == pytest.approx(np.exp(-0.5))
    assert psf[6, 10] / psf[8, 8] == pytest.approx(np.exp(-1))


def test_disk_taps_are_the_share_of_their_samples_inside() -> None:
    # Radius 1 covers the middle pixel whole, about half of each neighbor, and the corners' tips.
    psf = dg.disk_psf(1)

    edge = sum(
        (0.5 + (i + 0.5) / 8) ** 2 + ((j + 0.5) / 8 - 0.5) ** 2 <= 1
        for i in range(8)
        for j in range(8)
    )
    corner = sum(
        (0.5 + (i + 0.5) / 8) ** 2 + (0.5 + (j + 0.5) / 8) ** 2 <= 1
        for i in range(8)
        for j in range(8)
    )

    expected = np.array([[corner, edge, corner], [edge, 64, edge], [corner, edge, corner]])
    np.testing.assert_allclose(psf, expected / expected.sum())

    assert 20 < edge < 32
    assert 0 < corner < 16


def test_motion_of_two_pixels_by_hand() -> None:
    # 33 samples from -1/2 to 1/2: the side taps get the sum of |x| over one half, 136/32.
    expected = np.array([136 / 32, 33 - 272 / 32, 136 / 32]) / 33
    psf = dg.motion_psf(2)
    np.testing.assert_allclose(psf[1], expected)
    assert not psf[[0, 2]].any()


def test_motion_along_y_is_the_transpose_and_positive_angles_turn_downwards() -> None:
    np.testing.assert_array_equal(dg.motion_psf(9, 90), dg.motion_psf(9).T)
    falling = dg.motion_psf(9, 45)
    assert falling[6, 6] > 0.05
    assert falling[2, 6] == 0


@pytest.mark.parametrize("psf", [*KERNELS[:-1], np.array([[1.0, 2.0, 4.0]])])
@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (3, 2), (9, 7)])
def test_convolution_is_the_direct_loop(psf: Plane, shape: tuple[int, int]) -> None:
    image = photograph(*shape, 2).astype(float)
    expected = np.dstack([direct(channel, psf) for channel in np.moveaxis(image, 2, 0)])
    np.testing.assert_allclose(dg.convolve(image, psf), expected, atol=255e-9)


def test_direct_and_transformed_sums_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    image, psf = photograph(61, 83, 3), dg.disk_psf(6)
    transformed = dg.convolve(image, psf)
    monkeypatch.setattr(dg, "MAX_DIRECT_TAPS", psf.size)
    summed = dg.convolve(image, psf)
    np.testing.assert_allclose(transformed, summed, atol=255e-9)
    assert (transformed != summed).any()  # or one of them was not taken


@pytest.mark.parametrize(("dtype", "white"), [(np.uint8, 255), (np.uint16, 65535)])
def test_contrast_is_the_formula_at_every_level(dtype: type, white: int) -> None:
    levels: NDArray[Any] = (np.arange(256) * (white // 255)).astype(dtype).reshape(16, 16)
    expected = np.rint(white * 0.6 * (levels / white) ** 1.5)
    np.testing.assert_array_equal(dg.Degradation(gamma=1.5, gain=0.6)(levels), expected)
    np.testing.assert_array_equal(
        dg.Degradation(gain=0.6, offset=20)(levels), np.rint(0.6 * levels + 20)
    )


def test_quantize_rounds_to_nearest_and_ties_to_even() -> None:
    values = np.array([-3.0, 0.5, 1.5, 1.6, 254.4, 1e9, np.inf])
    np.testing.assert_array_equal(dg.quantize(values, np.uint8), [0, 0, 2, 2, 254, 255, 255])
    with pytest.raises(ValueError, match="NaN"):
        dg.quantize(np.array([np.nan]), np.uint8)


def test_noise_is_the_generators_and_comes_after_rounding() -> None:
    image = photograph(30, 20, 3)
    grain = np.random.default_rng(7).normal(0.0, 1.5, image.shape)
    blurred = np.rint(dg.convolve(image, dg.disk_psf(2)))
    expected = np.clip(np.rint(blurred + grain), 0, 255)

    degrade = dg.Degradation(dg.disk_psf(2), noise=1.5, seed=7)
    np.testing.assert_array_equal(degrade(image), expected)

    np.testing.assert_array_equal(degrade(image), degrade(image))
    assert (
        dg.Degradation(noise=1.5, seed=8)(image) != dg.Degradation(noise=1.5, seed=7)(image)
    ).any()


def test_blur_comes_before_contrast() -> None:
    image = np.array([[0, 0, 255, 0, 0]], dtype=np.uint8)
    third = np.full((1, 3), 1 / 3)
    bright = round(255 * (1 / 3) ** 2 * 2 + 5)
    result = dg.Degradation(third, gamma=2, gain=2, offset=5)(image)
    np.testing.assert_array_equal(result, [[5, bright, bright, bright, 5]])


def test_negative_lobes_do_not_break_gamma() -> None:
    image = np.array([[0, 255, 0]], dtype=np.uint8)
    sharpen = dg.Degradation(np.array([[-1.0, 3.0, -1.0]]), gamma=0.5)
    np.testing.assert_array_equal(sharpen(image), [[0, 255, 0]])


@given(st.integers(1, 9), st.integers(1, 9), st.sampled_from([(), (1,), (3,)]))
@settings(max_examples=30)
def test_every_degradation_keeps_shape_dtype_and_input(
    height: int, width: int, channels: tuple[int, ...]
) -> None:
    for dtype in (np.uint8, np.uint16):
        image = photograph(height, width, *channels, dtype=dtype)

        before = image.copy()
        degrade = dg.Degradation(dg.motion_psf(11, 20), gamma=1.5, gain=0.6, noise=1)
        result = degrade(image)

        assert result.shape == image.shape
        assert result.dtype == dtype
        assert not np.shares_memory(result, image)
        np.testing.assert_array_equal(image, before)


def test_the_default_is_the_identity_and_can_be_sent() -> None:
    image, degrade = photograph(5, 6), dg.Degradation(np.ones((1, 1)))
    np.testing.assert_array_equal(degrade(image), image)
    np.testing.assert_array_equal(dg.Degradation()(image), image)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(degrade))(image), image)  # noqa: S301 - our own bytes


def test_mixed_is_the_recipe_with_noise_once_over_the_whole() -> None:
    image = photograph(40, 48, 3)
    mixed = dg.suite(noise=1, seed=3)["mixed"](image)

    versions = [
        np.rint(0.6 * image + 20),
        np.rint(dg.convolve(image, dg.motion_psf(11))),
        image,
        np.rint(dg.convolve(image, dg.disk_psf(5))),
    ]

    expected = np.empty(image.shape)
    for i in range(4):
        for j in range(4):
            area = np.s_[10 * i : 10 * i + 10, 12 * j : 12 * j + 12]
            expected[area] = versions[(i + j) % 4][area]

    expected += np.random.default_rng(3).normal(0, 1, image.shape)
    np.testing.assert_array_equal(mixed, np.clip(np.rint(expected), 0, 255))


def test_suite_leaves_sharp_and_contrast_without_noise() -> None:
    image, suite = photograph(24, 24, 3), dg.suite()

    np.testing.assert_array_equal(suite["sharp"](image), image)
    np.testing.assert_array_equal(
        suite["contrast 1.5 0.6"](image), dg.Degradation(gamma=1.5, gain=0.6)(image)
    )

    for name in ("gauss 2", "gauss 4", "disk 3", "disk 6", "motion 9", "motion 15"):
        quiet = dg.suite(noise=0)[name](image).astype(int)
        difference = suite[name](image).astype(int) - quiet
        assert 0.7 < difference.std() < 1.3, name

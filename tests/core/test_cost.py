"""Cost volumes, held to the oracle: eq. 6 by its definition, SAD, NSAD and ZNCC by theirs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from test_descriptor import decoded, decoded_parts

import phasestereo as ps
from support import oracle

if TYPE_CHECKING:
    from numpy.typing import NDArray


@pytest.mark.parametrize("bits", [1, 2, 3, 4])
@given(seed=st.integers(0, 1000), low=st.integers(-9, 9), count=st.integers(1, 8))
def test_popcount_is_the_circular_distance(bits: int, seed: int, low: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    left, right = rng.integers(0, 256, (2, 4, 10), np.uint8)
    volume = ps.cost_volume(left, right, num_disparities=count, min_disparity=low, bits=bits)
    levels = [decoded(ps.descriptor(image, bits=bits), 7, bits) for image in (left, right)]
    expected = oracle.phase_costs(levels[0], levels[1], low, count, bits)
    np.testing.assert_array_equal(volume, expected)


@given(seed=st.integers(0, 1000), low=st.integers(-9, 9), count=st.integers(1, 8))
def test_weak_parts_differ_by_half(seed: int, low: int, count: int) -> None:
    left, right = np.random.default_rng(seed).integers(0, 256, (2, 4, 10), np.uint8)
    noises = (20.0, 60.0)
    volume = ps.cost_volume(
        left,
        right,
        num_disparities=count,
        min_disparity=low,
        noise_threshold=1.0,
        known=ps.Known(noise=noises),
    )

    codes = [
        ps.descriptor(image, noise_threshold=1.0, noise=noise)
        for image, noise in zip((left, right), noises, strict=True)
    ]

    levels = [decoded_parts(each, 7) for each in codes]
    np.testing.assert_array_equal(volume, oracle.weak_costs(levels[0], levels[1], low, count))


@given(
    seed=st.integers(0, 1000),
    channels=st.tuples(st.sampled_from([1, 3]), st.sampled_from([1, 3])),
    low=st.integers(-5, 6),
)
def test_sad_is_in_sixteenths_of_gray_levels(
    seed: int, channels: tuple[int, int], low: int
) -> None:
    rng = np.random.default_rng(seed)
    left, right = (rng.integers(0, 256, (3, 7, c), np.uint8) for c in channels)
    volume = ps.cost_volume(left, right, num_disparities=4, min_disparity=low, cost="sad")

    expected = 16 * oracle.sad_costs(left, right, low, 4)
    # Gray levels of colors are rounded to a sixteenth on either side.
    np.testing.assert_allclose(volume, expected, rtol=0, atol=1 if 3 in channels else 0)


@pytest.mark.parametrize("window", [3, 9, 21])
def test_normalized_sad_is_in_256ths_of_deviations(window: int) -> None:
    rng = np.random.default_rng(1)
    left, right = rng.integers(0, 256, (2, 12, 15, 3), np.uint8)
    volume = ps.cost_volume(left, right, num_disparities=5, cost="nsad", window=window)
    expected = 256 * oracle.nsad_costs(left, right, window, 0, 5)
    # Gray levels are rounded to a sixteenth, and deviations on either side.
    np.testing.assert_allclose(volume, expected, rtol=0, atol=3)


@pytest.mark.parametrize("side", [5, 7])
def test_zncc_is_in_256ths_of_a_correlation(side: int) -> None:
    rng = np.random.default_rng(1)
    left, right = rng.integers(0, 256, (2, 12, 15), np.uint8)
    volume = ps.cost_volume(left, right, num_disparities=5, cost="zncc", neighborhood=side)

    def patches(image: NDArray[np.uint8]) -> NDArray[np.float64]:
        around = np.lib.stride_tricks.sliding_window_view(image.astype(float), (side, side))
        return around.reshape(*around.shape[:2], -1)

    # Disparity d away from the edges, by the correlation coefficient of NumPy.
    sides = patches(left), patches(right)
    for d in range(5):
        columns = sides[0].shape[1] - d
        ends = sides[0][:, d:], sides[1][:, :columns]
        pairs = zip(*(end.reshape(-1, side**2) for end in ends), strict=True)
        expected = [256 * (1 - np.corrcoef(a, b)[0, 1]) for a, b in pairs]
        inside = volume[side // 2 : 12 - side // 2, side // 2 + d : 15 - side // 2, d]
        # One gray level of deviation is added, so that flat areas do not correlate.
        np.testing.assert_allclose(inside.ravel(), expected, rtol=0, atol=1)


def test_zncc_ignores_gain_and_offset_and_sees_inversion() -> None:
    image = np.random.default_rng(2).integers(0, 200, (20, 30), np.uint8)
    brighter = image // 2 + 50
    options: dict[str, Any] = {"num_disparities": 1, "cost": "zncc", "neighborhood": 5}
    assert ps.cost_volume(image, brighter, **options).max() <= 2
    assert ps.cost_volume(image, 255 - image, **options).min() >= 510


def test_the_intensity_range_sets_the_unit_of_sad() -> None:
    left, right = np.full((1, 3), 0.25, np.float32), np.full((1, 3), 0.75, np.float32)
    options: dict[str, Any] = {"cost": "sad", "num_disparities": 1}
    assert (ps.cost_volume(left, right, intensity_range=(0, 1), **options) == 16 * 127.5).all()
    assert (ps.cost_volume(left, right, intensity_range=(0, 255), **options) == 8).all()

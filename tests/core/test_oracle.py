"""The oracle against transforms, noise and the cheapest of all paths there are."""

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray

from support import oracle


def one_row(*rows: list[int]) -> NDArray[np.int64]:
    """Return costs (1, W, N) from one list of N costs per column."""
    return np.array([rows])


# --- images ---


# --- descriptor ---


@pytest.mark.parametrize(("length", "r", "s"), [(3, 1, 1), (5, 2, 1), (7, 3, 2), (9, 1, 4)])
def test_spectrum_is_the_fourier_transform_with_the_center_as_origin(
    length: int, r: int, s: int
) -> None:
    gray = np.random.default_rng(0).uniform(0, 255, (4, 3))

    spectra = oracle.spectrum(gray, length, r, s)

    half = length // 2
    padded = np.pad(gray, half, mode="symmetric")

    for y, x in np.ndindex(gray.shape):
        block = padded[y : y + length, x : x + length]
        transform = np.fft.fft2(np.fft.ifftshift(block))
        expected = [transform[v, u] for u, v in oracle.frequencies(r, s)]
        np.testing.assert_allclose(spectra[y, x], expected, atol=1e-9)


@pytest.mark.parametrize(("k", "u"), [(1, 1), (1, 2)])
def test_weak_thresholds_are_deviations_of_parts_of_noise(k: int, u: int) -> None:
    noise = np.random.default_rng(5).normal(0, 3, (300, 300))
    each = oracle.parts(oracle.spectrum(noise, 5, u, 1), k)
    assert each.std() == pytest.approx(oracle.weak_threshold(3, 1, 5), rel=0.02)


@given(
    st.complex_numbers(min_magnitude=0.1, max_magnitude=10),
    st.floats(0, 2 * np.pi),
    st.sampled_from([1, 2]),
    st.sampled_from([1, 2, 3, 4]),
)
def test_the_level_holds_within_the_boundary_distance(
    center: complex, direction: float, k: int, b: int
) -> None:
    spectra = np.array([center])
    moved = spectra + 0.999 * oracle.boundary_distance(spectra, k, b) * np.exp(1j * direction)
    if oracle.boundary_distance(spectra, k, b)[0] > 1e-9:
        assert oracle.levels(moved, k, b) == oracle.levels(spectra, k, b)


# --- costs ---


# --- aggregation ---


# --- optimization ---


@pytest.mark.parametrize(
    ("costs", "rise", "drop", "expected"),
    [
        pytest.param([[5, 5, 0], [0, 5, 5]], 1, 2, [2, 0], id="any drop at one price"),
        pytest.param([[0, 9, 9], [9, 0, 9], [9, 9, 0]], 1, 9, [0, 1, 2], id="rise step by step"),
        pytest.param([[1, 9, 9], [9, 9, 0]], 0, 0, [2, 2], id="no rise by two"),
        pytest.param([[0, 9, 9], [9, 9, 0]], 1, 1, [0, 0], id="smallest at the end"),
        pytest.param([[0, 1], [9, 0]], 1, 1, [1, 1], id="stay before rise"),
        pytest.param([[1, 0], [0, 9]], 1, 1, [0, 0], id="stay before drop"),
        pytest.param([[0, 9, 0], [9, 0, 9]], 2, 2, [0, 1], id="rise before drop"),
        pytest.param([[9, 0, 0], [0, 9, 9]], 1, 1, [1, 0], id="the nearer of two drops"),
        pytest.param([[0, 9, 0], [9, 0, 9]], 3, 1, [2, 1], id="a dear rise"),
        pytest.param([[0, 9, 0], [9, 0, 9]], 1, 3, [0, 1], id="a dear drop"),
        pytest.param([[4, 2, 3]], 1, 1, [1], id="one column"),
        pytest.param([[4], [2]], 1, 1, [0, 0], id="one candidate"),
    ],
)
def test_scanline_by_hand(
    costs: list[list[int]], rise: int, drop: int, expected: list[int]
) -> None:
    assert oracle.scanline(one_row(*costs), rise, drop).tolist() == [expected]


def path_cost(costs: NDArray[Any], path: tuple[int, ...], rise: int, drop: int) -> float:
    total = float(sum(costs[x, d] for x, d in enumerate(path)))
    for before, after in itertools.pairwise(path):
        if after > before + 1:
            return np.inf
        total += 0 if after == before else rise if after > before else drop
    return total


@given(st.integers(1, 4), st.integers(1, 4), st.data())
def test_scanline_finds_the_cheapest_of_all_paths(width: int, number: int, data: Any) -> None:
    cells = st.lists(st.integers(0, 6), min_size=width * number, max_size=width * number)
    costs = np.array([data.draw(cells), data.draw(cells)]).reshape(2, width, number)

    rise, drop = data.draw(st.integers(0, 5)), data.draw(st.integers(0, 5))

    found = oracle.scanline(costs, rise, drop)

    for row, path in zip(costs, found, strict=True):
        every = itertools.product(range(number), repeat=width)
        least = min(path_cost(row, candidate, rise, drop) for candidate in every)
        assert path_cost(row, tuple(path), rise, drop) == least


# --- paths ---


def free_path_cost(costs: NDArray[Any], path: tuple[int, ...], p1: int, p2: int) -> int:
    changes = [abs(after - before) for before, after in itertools.pairwise(path)]
    return int(
        sum(costs[x, d] for x, d in enumerate(path))
        + sum(0 if apart == 0 else p1 if apart == 1 else p2 for apart in changes)
    )


@given(st.integers(1, 4), st.integers(1, 4), st.data())
def test_totals_are_those_of_the_cheapest_of_all_paths(width: int, number: int, data: Any) -> None:
    """But for the least total of each pixel before, which is the same for all candidates."""
    cells = st.lists(st.integers(0, 6), min_size=width * number, max_size=width * number)
    costs = np.array(data.draw(cells)).reshape(width, 1, number)

    p1 = data.draw(st.integers(0, 5))
    p2 = p1 + data.draw(st.integers(0, 5))

    totals = oracle.path_totals(costs, np.full((width, 1), p2), p1)[-1, 0]

    least = [
        min(
            free_path_cost(costs[:, 0], (*before, last), p1, p2)
            for before in itertools.product(range(number), repeat=width - 1)
        )
        for last in range(number)
    ]

    assert (totals - totals.min()).tolist() == (np.array(least) - min(least)).tolist()


# --- the whole method ---

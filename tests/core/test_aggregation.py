"""Aggregated volumes, held to the oracle."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

import phasestereo as ps
from support import oracle


@given(
    seed=st.integers(0, 1000),
    shape=st.tuples(st.integers(1, 9), st.integers(1, 9), st.integers(1, 4)),
    radius=st.integers(0, 6),
    shiftable=st.booleans(),
)
def test_windows_follow_the_definition(
    seed: int, shape: tuple[int, int, int], radius: int, *, shiftable: bool
) -> None:
    costs = np.random.default_rng(seed).integers(0, 65536, shape, np.uint16)
    window = 2 * radius + 1
    expected = oracle.aggregate(costs.astype(np.int64), window, shiftable=shiftable)
    found = ps.aggregate(costs, window=window, shiftable=shiftable)
    np.testing.assert_array_equal(found, expected)


def test_any_strides_and_byte_order() -> None:
    costs = np.random.default_rng(1).integers(0, 65536, (5, 6, 7), np.uint16)
    expected = ps.aggregate(costs)
    np.testing.assert_array_equal(ps.aggregate(costs.astype(">u2")), expected)
    np.testing.assert_array_equal(ps.aggregate(np.asfortranarray(costs)), expected)


@pytest.mark.parametrize("costs", [np.zeros((2, 2, 2), np.uint8), None, [[1]], "costs"])
def test_costs_of_another_type_are_refused(costs: object) -> None:
    with pytest.raises(TypeError, match="^costs: got"):
        ps.aggregate(costs)  # type: ignore[arg-type]  # that is the point


@pytest.mark.parametrize("shape", [(2, 2), (0, 2, 2), (2, 2, 0), (1, 1, 1, 1), (1, 1, 16385)])
def test_costs_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="^costs: got"):
        ps.aggregate(np.zeros(shape, np.uint16))

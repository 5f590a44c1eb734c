"""Chosen candidates, held to the oracle."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

import phasestereo as ps
from support import oracle

VOLUMES = st.tuples(
    st.integers(0, 1000), st.integers(1, 3), st.integers(1, 12), st.integers(1, 8)
).map(lambda spec: np.random.default_rng(spec[0]).integers(0, 6, spec[1:], np.uint32))


@given(costs=VOLUMES, rise=st.integers(0, 5), drop=st.integers(0, 5))
def test_dynamic_programming_follows_the_definition(
    costs: np.ndarray, rise: int, drop: int
) -> None:
    expected = oracle.scanline(costs.astype(np.int64), rise, drop)
    np.testing.assert_array_equal(ps.optimize(costs, p1=rise, p2=drop), expected)


@given(costs=VOLUMES, p1=st.integers(0, 5), p2=st.integers(0, 5))
def test_scanline_optimization_follows_the_definition(costs: np.ndarray, p1: int, p2: int) -> None:
    expected = oracle.free_scanline(costs.astype(np.int64), p1, p2)
    found = ps.optimize(costs, p1=p1, p2=p2, optimizer="so")
    np.testing.assert_array_equal(found, expected)


@given(costs=VOLUMES)
def test_winner_takes_all_follows_the_definition(costs: np.ndarray) -> None:
    expected = oracle.winner_takes_all(costs.astype(np.int64))
    np.testing.assert_array_equal(ps.optimize(costs, p1=1, p2=1, optimizer="wta"), expected)


@given(costs=VOLUMES, p1=st.integers(0, 5), p2=st.integers(0, 5))
def test_semi_global_matching_follows_the_definition(costs: np.ndarray, p1: int, p2: int) -> None:
    expected = oracle.winner_takes_all(oracle.path_means(costs.astype(np.int64), p1, p2))
    found = ps.optimize(costs, p1=p1, p2=p2, optimizer="sgm")
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("shape", [(64, 5), (65, 16), (81, 64), (150, 7), (5, 65), (70, 230)])
@pytest.mark.parametrize("count", [5, 33])
def test_paths_begin_outside_bands_and_panels(shape: tuple[int, int], count: int) -> None:
    rng = np.random.default_rng(sum(shape))
    costs = rng.integers(0, 30, (*shape, count), np.uint32)

    alone = oracle.winner_takes_all(costs)
    for optimizer, paths in (("so", oracle.row_means), ("sgm", oracle.path_means)):
        expected = oracle.winner_takes_all(paths(costs.astype(np.int64), 2, 6))
        found = ps.optimize(costs, p1=2, p2=6, optimizer=optimizer)  # type: ignore[arg-type]  # it is one
        np.testing.assert_array_equal(found, expected)
        assert (found != alone).any()


def test_no_cost_overflows() -> None:
    costs = np.full((1, 4000, 3), 2**28, np.uint32)
    costs[:, :, 1] -= 1
    for optimizer in ("dp", "so", "wta", "sgm"):
        assert (ps.optimize(costs, p1=2, p2=2**40, optimizer=optimizer) == 1).all()


def test_larger_costs_are_refused() -> None:
    costs = np.array([[[3, 2**28 + 1]]], np.uint32)
    with pytest.raises(ValueError, match="^costs: got 268435457; accepts costs up to 268435456"):
        ps.optimize(costs, p1=1, p2=1)


@pytest.mark.parametrize("name", ["p1", "p2"])
@pytest.mark.parametrize("value", [1.0, "1", None, True, (1, 2), np.array([1, 2])])
def test_penalties_that_are_no_integers_are_refused(name: str, value: object) -> None:
    penalties: dict[str, Any] = {"p1": 1, "p2": 1, name: value}
    with pytest.raises(TypeError, match=f"^{name}: got .*; accepts an integer"):
        ps.optimize(np.zeros((1, 1, 1), np.uint32), **penalties)


@pytest.mark.parametrize("name", ["p1", "p2"])
@pytest.mark.parametrize("value", [-1, 2**40 + 1, 10**30])
def test_penalties_out_of_range_are_refused(name: str, value: int) -> None:
    penalties: dict[str, Any] = {"p1": 1, "p2": 1, name: value}
    with pytest.raises(ValueError, match=f"^{name}: got .*; accepts "):
        ps.optimize(np.zeros((1, 1, 1), np.uint32), **penalties)


def test_an_unknown_optimizer_is_refused() -> None:
    with pytest.raises(ValueError, match="^optimizer: got 'sgd'; accepts 'dp', 'so', 'wta', 'sgm'"):
        ps.optimize(np.zeros((1, 1, 1), np.uint32), p1=1, p2=1, optimizer="sgd")  # type: ignore[arg-type]  # the point

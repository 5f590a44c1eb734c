"""Checks ranges found in constructions; compares matches without a range to matches with one."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any

import numpy as np
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo import SearchRange
from phasestereo.rig.findings import unwarned
from phasestereo_bench.datasets import Pair
from phasestereo_bench.ranges.constructions import Construction
from phasestereo_bench.report.tables import Table

_FAST = ps.PRESETS["fast"]


@dataclass(frozen=True, slots=True)
class Trial:
    """The search range found for a construction.

    Attributes
    ----------
    kind, name
        Kind and name of the construction.
    search
        The range to search when none is given.
    outside
        Whether an end of the true disparities, or an object, lies outside it.
    longer
        Length of the range over the needed length.
    """

    kind: str
    name: str
    search: SearchRange
    outside: bool
    longer: float

    @classmethod
    def of(cls, made: Construction, found: SearchRange) -> "Trial":
        """Judge the range of a construction."""
        first, last = found.min_disparity, found.min_disparity + found.num_disparities - 1

        # A candidate covers half a pixel on either side.
        wanted = made.objects or (made.low, made.high)
        outside = any(not first - 0.5 <= each <= last + 0.5 for each in wanted)
        longer = (last - first + 1) / (made.high - made.low + 1)
        return cls(made.kind, made.name, found, outside, longer)


@dataclass(frozen=True, slots=True)
class Comparison:
    """A scene matched without and with a given range.

    Attributes
    ----------
    name
        Name of the scene.
    bad
        Share of the pixels with a truth that are more than 1 px off, without and with the range.
    seconds
        Times of the matches.
    longer
        Length of the found range over the length of the true range.
    """

    name: str
    bad: tuple[float, float]
    seconds: tuple[float, float]
    longer: float


def search(made: Construction) -> Trial:
    """Search the range of a construction."""
    found = _matched(made.left, made.right, settings=_FAST, align_rows=True).search
    if found is None:
        raise ValueError(f"made: got {made.name}, of which no range was searched")
    return Trial.of(made, found)


def compare(pair: Pair, *, repeats: int = 1) -> Comparison:
    """Match a scene without and with its range: the disparities of its truth and a pixel."""
    truth = pair.known_truth
    known = np.isfinite(truth)
    low, high = float(truth[known].min()), float(truth[known].max())
    alone, slow = _timed(pair, repeats)
    told, fast = _timed(pair, repeats, num_disparities=int(np.ceil(high)) + 2)
    off, off_told = (~(np.abs(one.disparity - truth) <= 1)[known] for one in (alone, told))

    found = alone.search
    longer = 1.0 if found is None else found.num_disparities / (high - min(low, 0) + 1)
    return Comparison(pair.name, (off.mean(), off_told.mean()), (slow, fast), longer)


def _timed(pair: Pair, repeats: int, **given: Any) -> tuple[ps.Result, float]:
    """Match a pair; return the last result and the shortest time."""
    took: list[float] = []
    for _ in range(repeats):
        started = time.perf_counter()
        result = _matched(pair.left, pair.right, **given)
        took.append(time.perf_counter() - started)
    return result, min(took)


def _matched(left: NDArray[Any], right: NDArray[Any], **given: Any) -> ps.Result:
    with unwarned():
        return ps.match(left, right, threads=1, **given)


def found_table(trials: Sequence[Trial]) -> Table:
    """Return the number of constructions of each kind outside the range, and its length."""
    rows = []
    for kind in dict.fromkeys(trial.kind for trial in trials):
        some = [trial for trial in trials if trial.kind == kind]
        longer = [trial.longer for trial in some]
        outside = sum(trial.outside for trial in some)
        said = sum(trial.outside and bool(trial.search.left_out) for trial in some)
        cells = (
            f"{len(some)}",
            f"{outside}",
            f"{said}",
            f"{fmean(longer):.2f}",
            f"{max(longer):.2f}",
        )
        rows.append((kind, *cells))

    header = "kind", "pairs", "outside", "of them said", "length / needed, mean", "worst"
    return Table.of(header, rows)


def compared_table(scenes: Sequence[Comparison]) -> Table:
    """Return the cost of giving no range."""
    rows = [
        (
            scene.name,
            *(f"{100 * bad:.2f}" for bad in scene.bad),
            f"{scene.longer:.2f}",
            f"{scene.seconds[0] / scene.seconds[1]:.2f}",
        )
        for scene in scenes
    ]
    means = (
        *(f"{100 * fmean(scene.bad[side] for scene in scenes):.2f}" for side in (0, 1)),
        f"{fmean(scene.longer for scene in scenes):.2f}",
        f"{fmean(scene.seconds[0] / scene.seconds[1] for scene in scenes):.2f}",
    )
    header = "scene", "bad-1.0, no range given", "given", "length / needed", "time / given"
    return Table.of(header, [*rows, ("mean", *means)])

"""Traits of claims -> the weights by which the core judges maps of other matchers.

The logarithms of the odds are sums of lines through points: a logistic regression with the shares
of two points as inputs, by Newton's method. Where claim and own disparity differ and one of both
is right, which one is a regression of the same kind, from true maps as well: second maps may be
better than any that is learned from. The bars are lines through points that hold 90 % of the
errors, a quantile regression. Every map has the same weight, whatever its size, true ones less.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo.io.drafts import replace_text
from phasestereo.metrics import roc_area
from phasestereo.result import Flag
from phasestereo_bench.confidence.claims import TRUTH, unpacked
from phasestereo_bench.confidence.regression import (
    KNOTS as BAR_KNOTS,
    Numbers,
    between_knots,
    listed,
    quantile,
    rounded,
    sigmoid,
)
from phasestereo_bench.report.tables import Table

TRAITS, KNOTS, CASES = 19, 6, 3
_FOLDS = 3
_GAP = 0.0, 0.5, 1.0, 1.5, 4.0, 20.0  # px; a claim and an own disparity agree within 1
_UNSEEN = Flag.MASKED | Flag.NO_CANDIDATE | Flag.OUTSIDE | Flag.MATCH_MASKED | Flag.OCCLUDED
_PIXELS = 1000.0  # weight of a map
# Part of this weight of a true one. With 1 rather than none a true map of a rendered pair with
# noise 15 leaves 23.2 % wrong, not 25.9 (0.25: 25.7), but HITNet's maps of six scenes under disk 6
# 19.1, not 17.7 (0.25: 17.8).
_TRUTH = 0.25
# Weights of the squares of bends, of steps and of the heights themselves: not swept. Points at
# one place have no step between them.
_BEND, _STEP, _HEIGHT, _SAME = 3.0, 0.1, 0.02, 3e6
_LEAST_ERROR = 0.03  # px


@dataclass(frozen=True, slots=True)
class Claims:
    """Some pixels of a map.

    Attributes
    ----------
    scene, faults, method
        Of which pair it is, and whose.
    errors, own_errors
        (pixels,) How far claims and own disparities are off, pixels.
    cases
        (pixels,) The case of each, as the core has them.
    traits
        (pixels, traits) As the core has them.
    """

    scene: str
    faults: str
    method: str
    errors: Numbers
    own_errors: Numbers
    cases: NDArray[np.int64]
    traits: Numbers


@dataclass(frozen=True, slots=True)
class Weights:
    """What the core has: places of points, what was learned by case, and where both differ."""

    places: Numbers
    heights: Sequence[Numbers]
    bars: Sequence[Numbers]
    ahead: Numbers


def claims_of(records: Iterable[Mapping[str, Any]]) -> list[Claims]:
    """Return the pixels that records of `observe_claims` hold."""
    found = []
    for record in records:
        for method, text in record["maps"].items():
            values = unpacked(text, TRAITS + 3)
            flags, traits = values[:, 2].astype(int), values[:, 3:]
            cases = np.where(flags & _UNSEEN, 2, (traits[:, 0] > 1).astype(int))
            errors = np.nan_to_num(values[:, :2].T, posinf=6e4)
            pair = record["scene"], record["faults"]
            found.append(Claims(*pair, method, errors[0], errors[1], cases, traits))
    return found


def learn(several: Sequence[Claims]) -> Weights:
    """Return the weights that fit these maps best.

    Raises
    ------
    ValueError
        If no map is given.
    """
    matchers = [each for each in several if each.method != TRUTH]
    if not matchers:
        raise ValueError("records: got no map with a pixel that can be scored")
    traits, errors, _, cases, weight = _stacked(matchers)
    places = _places(traits)
    steady = _steady(places)
    ahead = _ahead(several, places, steady)

    heights, bars = [], []
    for case in range(CASES):
        here = cases == case
        design = _design(traits[here], places)
        right = (errors[here] <= 1).astype(np.float64)
        heights.append(_fitted(design, right, weight[here], steady))
        bars.append(_bars(design @ heights[case], errors[here], weight[here]))
    return Weights(places, heights, bars, ahead)


def _stacked(several: Sequence[Claims]) -> tuple[Numbers, ...]:
    """Return traits, errors of claims and own disparities, cases and weights of all pixels."""
    names = "traits", "errors", "own_errors", "cases"
    columns = (np.concatenate([getattr(each, name) for each in several]) for name in names)
    share = [
        _PIXELS * (_TRUTH if each.method == TRUTH else 1) / len(each.cases) for each in several
    ]
    return *columns, np.repeat(share, [len(each.cases) for each in several])


def _ahead(several: Sequence[Claims], places: Numbers, steady: Numbers) -> Numbers:
    """Return the heights by which one of both is right where they differ."""
    traits, errors, own_errors, _, weight = _stacked(several)
    one = (traits[:, 0] > 1) & ((errors <= 1) != (own_errors <= 1))
    right = (errors[one] <= 1).astype(np.float64)
    return _fitted(_design(traits[one], places), right, weight[one], steady)


def odds_of(claims: Claims, weights: Weights) -> Numbers:
    """Compute the logarithms of the odds that claims are right."""
    odds = np.zeros(len(claims.cases))
    for case in range(CASES):
        here = claims.cases == case
        odds[here] = _design(claims.traits[here], weights.places) @ weights.heights[case]
    return odds


def left_out(several: Sequence[Claims]) -> list[list[Numbers]]:
    """Return odds of claims by weights that were learned without their scene, or their matcher."""
    scenes = sorted({each.scene for each in several})
    order = np.random.default_rng(3).permutation(len(scenes))
    fold = {scenes[index]: str(number % _FOLDS) for number, index in enumerate(order)}
    return [
        _odds_without(several, lambda each: fold[each.scene]),
        _odds_without(several, lambda each: each.method.removeprefix("prepared:")),
    ]


def judging_table(several: Sequence[Claims], faults: Sequence[str]) -> Table:
    """Return a table of what confidences are worth, of each matcher and condition.

    Columns: the share of the pixels that is wrong, %; then, learned without the scene and without
    the matcher, the area under the curve and how far the mean confidence is off, in points.
    """
    header = "maps of", "condition", "wrong", "area", "off", "matcher left out: area", "off"
    lines: list[tuple[str, ...]] = []
    scored = [
        [_scores(*pair) for pair in zip(several, odds, strict=True)] for odds in left_out(several)
    ]
    for method in sorted({each.method for each in several} - {TRUTH}):
        for name in (*faults, "others"):
            rows = [
                index
                for index, each in enumerate(several)
                if each.method == method
                and (each.faults if each.faults in faults else "others") == name
            ]
            if not rows:
                continue
            wrong = np.mean([(several[row].errors > 1).mean() for row in rows])
            cells = [f"{100 * wrong:.1f}"]
            for scores in scored:
                area, off = np.nanmean([scores[row] for row in rows], axis=0)
                cells += [f"{area:.3f}", f"{100 * off:.1f}"]
            lines.append((method, name, *cells))
    return Table.of(header, lines, labels=2)


def write_weights(weights: Weights, path: Path) -> None:
    """Write weights as the core has them, a file of Rust.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    cases = "".join(
        _LEARNED.format(odds=_odds(weights.heights[case], 12), bars=listed(weights.bars[case], 3))
        for case in range(CASES)
    )
    ahead = _odds(weights.ahead, 4)
    text = _FILE.format(places=_rows(weights.places, 8), cases=cases, ahead=ahead)
    replace_text(path, text)


_FILE = """//! Learned by `phasestereo bench confidence --of maps`, which writes this file.

use super::{{Learned, Odds, Weights}};

/// The weights.
pub const WEIGHTS: Weights = Weights {{
    places: [
{places}    ],
    cases: [
{cases}    ],
    ahead: {ahead},
}};
"""
_LEARNED = """        Learned {{
            odds: {odds},
            bars: {bars},
        }},
"""
_ODDS = """Odds {{
{space}    offset: {offset},
{space}    lines: [
{lines}{space}    ],
{space}}}"""


def _odds(heights: Numbers, indent: int) -> str:
    lines = _rows(heights[1:].reshape(TRAITS, KNOTS), indent + 8)
    return _ODDS.format(offset=rounded(heights[0], 3), lines=lines, space=" " * indent)


def _rows(rows: Numbers, indent: int) -> str:
    return "".join(f"{' ' * indent}{listed(row, 3)},\n" for row in rows)


def _odds_without(several: Sequence[Claims], part_of: Callable[[Claims], str]) -> list[Numbers]:
    odds: dict[int, Numbers] = {}
    for part in sorted({part_of(each) for each in several}):
        weights = learn([each for each in several if part_of(each) != part])
        for index, each in enumerate(several):
            if part_of(each) == part:
                odds[index] = odds_of(each, weights)
    return [odds[index] for index in range(len(several))]


def _scores(claims: Claims, odds: Numbers) -> tuple[float, float]:
    right = claims.errors <= 1
    off = abs(float(sigmoid(odds).mean() - right.mean()))
    area = roc_area(odds[None], claims.errors[None], np.zeros((1, len(odds))))
    return area, off


def _places(traits: Numbers) -> Numbers:
    """Return the places of the points of each trait: at even shares of the pixels."""
    places = np.quantile(traits, np.linspace(0.01, 0.99, KNOTS), axis=0).T
    for trait, points in enumerate(places):
        if len(np.unique(traits[:, trait])) == 2:
            points[:] = np.linspace(0, 1, KNOTS)
    places[0] = _GAP
    return np.asarray(places.round(3))


def _design(traits: Numbers, places: Numbers) -> NDArray[np.float32]:
    """Return 1, and of each trait the shares of the two points beside it."""
    count = len(traits)
    design = np.zeros((count, 1 + TRAITS * KNOTS), np.float32)
    design[:, 0] = 1
    rows = np.arange(count)
    for trait, points in enumerate(places):
        value = traits[:, trait].clip(points[0], points[-1])
        left = (value[:, None] >= points[None, 1:-1]).sum(axis=1)
        width = points[left + 1] - points[left]
        part = np.where(width > 0, (value - points[left]) / np.where(width > 0, width, 1), 0)
        column = 1 + trait * KNOTS + left
        design[rows, column] = 1 - part.clip(0, 1)
        design[rows, column + 1] += part.clip(0, 1)
    return design


def _steady(places: Numbers) -> Numbers:
    """Return the weights of the squares of heights, steps and bends."""
    steady = np.zeros((1 + TRAITS * KNOTS,) * 2)
    one = np.eye(KNOTS)
    step, bend = np.diff(one, axis=0), np.diff(one, 2, axis=0)
    for trait, points in enumerate(places):
        own = slice(1 + trait * KNOTS, 1 + (trait + 1) * KNOTS)
        weights = np.where(np.diff(points) > 0, _STEP, _SAME)
        steady[own, own] = _HEIGHT * one + (step.T * weights) @ step + _BEND * bend.T @ bend
    return steady


def _fitted(
    design: NDArray[np.float32], right: Numbers, weight: Numbers, steady: Numbers
) -> Numbers:
    """Return the heights of a logistic regression; steps that do not help are halved."""

    def odds_with(heights: Numbers) -> Numbers:
        # Single precision is enough for sums over some hundred columns, and four times as fast.
        return np.asarray(design @ heights.astype(np.float32), np.float64)

    def loss(heights: Numbers) -> float:
        odds = odds_with(heights)
        misfit = (weight * (np.logaddexp(0, odds) - right * odds)).sum()
        return float(misfit + heights @ steady @ heights / 2)

    heights = np.zeros(design.shape[1])
    best = loss(heights)
    for _ in range(30):
        share = sigmoid(odds_with(heights))
        slope = design.T @ (weight * (right - share)).astype(np.float32) - steady @ heights
        bend = np.sqrt(weight * share * (1 - share)).astype(np.float32)
        scaled = design * bend[:, None]
        curve = scaled.T @ scaled + steady
        step = np.linalg.solve(curve + 1e-6 * np.eye(len(heights)), slope)

        part = 1.0
        while (found := loss(heights + part * step)) >= best and part > 1e-3:
            part /= 2
        if found >= best:
            break
        heights, gain, best = heights + part * step, best - found, found
        if gain < 1e-5 * abs(best):
            break
    return heights


def _bars(odds: Numbers, errors: Numbers, weight: Numbers) -> Numbers:
    """Return the points of the logarithm of the bar, which holds 90 % of the errors."""
    size = np.log(errors.clip(_LEAST_ERROR, 80))
    step = np.diff(np.eye(BAR_KNOTS), axis=0)
    smooth = 1e-3 * weight.sum() * step.T @ step
    mean = np.full(BAR_KNOTS, float(np.average(size, weights=weight)))
    return quantile(between_knots(odds), size, weight, smooth, mean)

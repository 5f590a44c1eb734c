"""Counts of errors -> the weights of the core's calibration, and the file of Rust that has them.

The odds are a logistic regression, by Newton's method. The bars are the line through points that
holds 90 % of the errors, a quantile regression, by least squares that are weighted anew until the
absolute values are those that count. Every pair has the same weight, whatever its size.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo.io.drafts import replace_text
from phasestereo_bench.confidence.observation import ERRORS, KINDS, ODDS, PRESETS
from phasestereo_bench.confidence.regression import (
    FIRST_KNOT,
    KNOTS,
    Numbers,
    between_knots,
    listed,
    quantile,
    sigmoid,
)

TRAITS = 8
# The core's names for what these are.
_CERTAIN, _LEAST_OWN, _LOW, _STEPS = 0.004, 0.4, 1.5, 2**20
_NO_NOISE, _NO_SMOOTHING, _NONE_AT_ENDS = 0.3, 0.1, 0.003

# Which weights there are, of each trait: height and slope, what an outline adds to the height, and
# what filled pixels add to both.
_USED = np.array(
    [
        [1, 1, 1, 1, 1],  # 1
        [1, 1, 0, 1, 1],  # odds of the mean raw confidence
        [1, 1, 0, 1, 0],  # how far below LOW
        [1, 0, 0, 1, 0],  # odds of the share that fails
        [1, 1, 0, 1, 0],  # noise
        [1, 1, 0, 1, 0],  # smoothing
        [1, 1, 0, 1, 0],  # blur
        [1, 0, 0, 1, 0],  # at the ends
    ],
    dtype=bool,
)
# The columns of these weights that each kind adds to its height and to its slope, and the line of
# the bars that it uses. The kinds are own disparities, own ones beside an outline, filled ones.
_HEIGHTS, _SLOPES = ((0,), (0, 2), (0, 3)), ((1,), (1,), (1, 4))
_LINES = np.array([0, 0, 1])
_WIDENS = np.array([0, 1, 0, 0, 1, 1, 1, 0], dtype=bool)  # which traits bars depend on
_STEADY = 1e-2  # weight of the squares of the weights, a pair
_SMOOTH = 2e-3  # weight of the squares of the differences of neighboring points
# Faults that nobody has thought of are worse than those that were: so much less of every logarithm
# of the odds. On 21 scenes under seven conditions, after copies and planes, the mean confidence is
# off by 4.1 points with it and without, and 9.6 and 9.9 % of the pixels are trusted and wrong.
_CAUTION = 0.05
_FAILED, _LESS = 0.3, 0.3  # bars of pairs with more wrong pixels count so much
_MIDDLES = np.array([ODDS[0], *((ODDS[1:] + ODDS[:-1]) / 2), ODDS[-1]])
SIZES = np.array([0.03, *np.sqrt(ERRORS[1:] * ERRORS[:-1]), 80.0])


@dataclass(frozen=True, slots=True)
class Weights:
    """What `Weights` of the core has."""

    odds: Numbers
    knots: Numbers
    bars: Numbers


@dataclass(frozen=True)
class Observed:
    """What is known of a match: its traits, and counts by kind, raw confidence and error."""

    scene: str
    faults: tuple[str, ...]
    traits: Numbers
    counts: NDArray[np.int64]

    @cached_property
    def cells(self) -> Numbers:
        """Pixels, and right ones, of every raw confidence."""
        right = self.counts[:, :, : np.searchsorted(ERRORS, 1.0) + 1].sum(axis=2)
        return np.stack([self.counts.sum(axis=2), right]).astype(np.float64)

    @property
    def wrong(self) -> float:
        """The share of the pixels that are off by more than 1 px."""
        pixels, right = self.cells.sum(axis=(1, 2))
        return float(1 - right / pixels)


def observed_of(records: Sequence[Mapping[str, Any]]) -> list[Observed]:
    """Return the records of `observe` for matches that can be scored."""
    shape = KINDS, len(ODDS) + 1, len(ERRORS) + 1
    found = [
        Observed(
            scene=record["scene"],
            faults=tuple(record["faults"].split(" + ")),
            traits=traits(record),
            counts=np.array(record["counts"]).reshape(shape),
        )
        for record in records
    ]
    return [one for one in found if one.counts.any()]


def traits(record: Mapping[str, Any]) -> Numbers:
    """Return the traits of a pair, as the core has them."""
    confidence, own, failed, ends, pixels = record["tally"]
    sure = odds(max(confidence / _STEPS / max(own, 1), _LEAST_OWN))
    return np.array(
        [
            1.0,
            sure,
            max(0.0, _LOW - sure),
            odds(failed / pixels),
            np.log(record["noise"] + _NO_NOISE),
            np.log(record["smoothing"] + _NO_SMOOTHING),
            float(record["blurred"]),
            np.log(ends / pixels + _NONE_AT_ENDS),
        ]
    )


def odds(share: float) -> float:
    """Return the logarithm of the odds of a share."""
    bounded = min(max(share, _CERTAIN), 1 - _CERTAIN)
    return float(np.log(bounded / (1 - bounded)))


def learn(pairs: Sequence[Observed]) -> Weights:
    """Return the weights that fit these matches best."""
    heights = _odds(pairs)
    return Weights(heights, *_bars(pairs, heights))


def log_odds(pair: Observed, heights: Numbers) -> Numbers:
    """Return the logarithms of the calibrated odds of each kind and raw confidence."""
    return np.asarray(_factors() @ (pair.traits @ heights))


def bars_of(pair: Observed, z: Numbers, weights: Weights) -> Numbers:
    """Return the bars, px, of pixels of each kind with these odds."""
    points = np.arange(KNOTS) + FIRST_KNOT
    line = [np.interp(z[k], points, weights.knots[_LINES[k]]) for k in range(KINDS)]
    return np.asarray(np.exp(np.stack(line) + pair.traits @ weights.bars))


def _factors() -> Numbers:
    """Return the factors of the weights, of shape (kinds, raw confidences, weights)."""
    bound = np.clip(_MIDDLES, odds(0), odds(1))
    factors = np.zeros((KINDS, bound.size, _USED.shape[1]))
    for kind in range(KINDS):
        factors[kind][:, _HEIGHTS[kind]] = 1
        factors[kind][:, _SLOPES[kind]] = bound[:, None]
    return factors


def _odds(pairs: Sequence[Observed]) -> Numbers:
    kinds = _factors()
    rows, pixels, right = [], [], []
    for pair in pairs:
        share = pair.cells / pair.cells[0].sum()
        seen = share[0] > 0
        rows.append((pair.traits[:, None] * kinds[seen][:, None, :])[:, _USED])
        pixels.append(share[0][seen])
        right.append(share[1][seen])
    design, weight, hits = np.concatenate(rows), np.concatenate(pixels), np.concatenate(right)

    found = np.zeros(design.shape[1])
    steady = _STEADY * np.eye(found.size)
    for _ in range(30):
        share = sigmoid(design @ found)
        slope = design.T @ (hits - weight * share) - steady @ found
        curve = (design * (weight * share * (1 - share))[:, None]).T @ design + steady
        found += np.linalg.solve(curve, slope)

    heights = np.zeros(_USED.shape)
    heights[_USED] = found
    heights[0, 0] -= _CAUTION
    return heights


def _bars(pairs: Sequence[Observed], heights: Numbers) -> tuple[Numbers, Numbers]:
    rows, sizes, weights = [], [], []
    for pair in pairs:
        kind, raw, size = np.nonzero(pair.counts)
        share = pair.counts[kind, raw, size] / pair.counts.sum()
        rows.append(_design(pair, log_odds(pair, heights)[kind, raw], kind))
        sizes.append(np.log(SIZES[size]))
        weights.append(share * (_LESS if pair.wrong >= _FAILED else 1.0))
    design, error, weight = np.concatenate(rows), np.concatenate(sizes), np.concatenate(weights)

    smooth = _differences(design.shape[1]) * _SMOOTH * len(pairs)
    mean = np.linalg.solve(
        (design * weight[:, None]).T @ design + smooth, design.T @ (weight * error)
    )
    found = quantile(design, error, weight, smooth, mean)

    bars = np.zeros(TRAITS)
    bars[_WIDENS] = found[2 * KNOTS :]
    return found[: 2 * KNOTS].reshape(2, KNOTS), bars


def _design(pair: Observed, z: Numbers, kind: NDArray[np.intp]) -> Numbers:
    """Return the terms of a bar's logarithm: shares of two points, and of traits."""
    of_kinds = [between_knots(z) * (_LINES[kind][:, None] == one) for one in (0, 1)]
    return np.hstack([*of_kinds, np.tile(pair.traits[_WIDENS], (z.size, 1))])


def _differences(count: int) -> Numbers:
    """Return the squares of differences of points, so that those nobody has seen follow others."""
    one, step = np.eye(KNOTS), np.diff(np.eye(KNOTS), axis=0)
    steps = np.block([[step, 0 * step], [0 * step, step], [-0.3 * one, 0.3 * one]])
    squares = 1e-6 * np.eye(count)
    squares[: 2 * KNOTS, : 2 * KNOTS] += steps.T @ steps
    return squares


_FILE = """//! Learned by `phasestereo bench confidence`, which writes this file.

use super::Weights;

/// The weights by how disparities were chosen: by four paths, by two, or by pixels and rows alone.
pub const WEIGHTS: [Weights; 3] = [
{weights}];
"""
_WEIGHTS = """    Weights {{
        odds: [
{odds}        ],
        knots: [
{knots}        ],
        bars: {bars},
    }},
"""


def learned_weights(records: Sequence[Mapping[str, Any]]) -> list[Weights]:
    """Return the weights that fit the records best, those of each preset.

    Raises
    ------
    ValueError
        If none of the matches of a preset can be scored.
    """
    found = []
    for preset in PRESETS:
        pairs = observed_of([record for record in records if record["preset"] == preset])
        if not pairs:
            raise ValueError(f"records: got no match with a pixel that can be scored by {preset}")
        found.append(learn(pairs))
    return found


def write_weights(weights: Sequence[Weights], path: Path) -> None:
    """Write weights as the core has them.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    several = [
        _WEIGHTS.format(
            odds="".join(f"            {listed(row, 4)},\n" for row in one.odds),
            knots="".join(f"            {listed(row, 4)},\n" for row in one.knots),
            bars=listed(one.bars, 4),
        )
        for one in weights
    ]
    text = _FILE.format(weights="".join(several))
    replace_text(path, text)

"""Test the calibration on faults and scenes outside its training data."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from phasestereo_bench.confidence.learning import (
    SIZES,
    Observed,
    Weights,
    bars_of,
    learn,
    log_odds,
)
from phasestereo_bench.confidence.regression import sigmoid
from phasestereo_bench.report.tables import Table

FOLDS = 8
FAILED = 0.3
_TRUSTED = 0.5
_NEAR = 0.88, 0.92


@dataclass(frozen=True, slots=True)
class Verdict:
    """What calibrated confidences are worth on some pairs.

    Parameters
    ----------
    name
        What was left out.
    pairs, failed
        How many matches, and how many with 30 % of wrong pixels or more.
    gap
        Mean over pairs of how far the mean confidence is from the share that is right.
    right
        Share that is right of pixels with a confidence of 0.88 to 0.92.
    covered
        Mean share that lies within the bars.
    trusted_wrong
        Share that is wrong of the pixels of failed pairs with a confidence of 0.5 and more.
    sharp_trusted
        Share of the pixels of sharp pairs with a confidence of 0.5 and more.
    """

    name: str
    pairs: int
    failed: int
    gap: float
    right: float
    covered: float
    trusted_wrong: float
    sharp_trusted: float


def held_out(pairs: Sequence[Observed]) -> list[Verdict]:
    """Learn without one part after another, and judge by what was left out."""
    by_fault = _left_out(pairs, lambda pair: pair.faults)
    by_scene = _left_out(pairs, lambda pair: (pair.scene,))
    whole = learn(pairs)
    return [
        judged("nothing left out", pairs, [whole] * len(pairs)),
        judged("faults left out", pairs, by_fault),
        judged("scenes left out", pairs, by_scene),
    ]


def judged(name: str, pairs: Sequence[Observed], weights: Sequence[Weights]) -> Verdict:
    """Return the scores of weights, those of each pair learned without it."""
    gaps, covered, near, failed, sharp = [], [], np.zeros(2), np.zeros(2), np.zeros(2)
    for pair, learned in zip(pairs, weights, strict=True):
        z = log_odds(pair, learned.odds)
        share = sigmoid(z)
        pixels, right = pair.cells / pair.cells[0].sum()

        gaps.append(abs(float((pixels * share).sum() - right.sum())))
        within = bars_of(pair, z, learned)[:, :, None] >= SIZES
        covered.append(float((pair.counts * within).sum() / pair.counts.sum()))

        is_near = (share > _NEAR[0]) & (share < _NEAR[1])
        near += right[is_near].sum(), pixels[is_near].sum()
        trusted = pixels[share >= _TRUSTED].sum()
        if pair.wrong >= FAILED:
            failed += trusted - right[share >= _TRUSTED].sum(), trusted
        if pair.faults == ("sharp",) and pair.wrong < FAILED:
            sharp += trusted, 1.0

    return Verdict(
        name=name,
        pairs=len(pairs),
        failed=sum(pair.wrong >= FAILED for pair in pairs),
        gap=float(np.mean(gaps)),
        right=float(near[0] / max(near[1], 1e-9)),
        covered=float(np.mean(covered)),
        trusted_wrong=float(failed[0] / max(failed[1], 1e-9)),
        sharp_trusted=float(sharp[0] / max(sharp[1], 1.0)),
    )


def verdict_table(verdicts: Sequence[Verdict]) -> Table:
    """Return the verdicts as a table."""
    header = [
        *("", "pairs", "failed", "gap", "right at 0.9", "in the bars"),
        *("wrong of trusted, failed pairs", "trusted, sharp pairs"),
    ]
    rows = []
    for one in verdicts:
        shares = one.gap, one.right, one.covered, one.trusted_wrong, one.sharp_trusted
        shown = (f"{100 * share:.1f} %" for share in shares)
        rows.append((one.name, str(one.pairs), str(one.failed), *shown))
    return Table.of(header, rows)


def _left_out(
    pairs: Sequence[Observed], parts_of: Callable[[Observed], tuple[str, ...]]
) -> list[Weights]:
    """Return weights for each pair that were learned without anything that has a part of it."""
    names = sorted({name for pair in pairs for name in parts_of(pair)})
    order = np.random.default_rng(3).permutation(len(names))
    fold = {names[index]: number % FOLDS for number, index in enumerate(order)}

    of_pair = [{fold[name] for name in parts_of(pair)} for pair in pairs]
    learned = [
        learn([pair for pair, folds in zip(pairs, of_pair, strict=True) if number not in folds])
        for number in range(min(FOLDS, len(names)))
    ]
    return [learned[min(folds)] for folds in of_pair]

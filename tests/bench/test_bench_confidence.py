"""The benchmark that the calibration is learned by: weights that are put in come out."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from phasestereo.result import Flag
from phasestereo_bench.choices import find_constants
from phasestereo_bench.confidence import (
    claims,
    judging,
    learned_weights,
    observation,
    write_weights,
)
from phasestereo_bench.confidence.learning import (
    SIZES,
    bars_of,
    learn,
    log_odds,
    observed_of,
)
from phasestereo_bench.confidence.observation import (
    ERRORS,
    KINDS,
    ODDS,
    PRESETS,
    confidence_jobs,
    observed,
)
from phasestereo_bench.confidence.regression import sigmoid
from phasestereo_bench.confidence.verdict import judged
from phasestereo_bench.rendering import render_pair

CHOICES = Path("rust/match/src/choices.rs")
WEIGHTS = Path(__file__).parents[2] / "rust/match/src/refinement/calibration" / "weights.rs"


JUDGE = Path(__file__).parents[2] / "rust/core/src/verification/judge" / "weights.rs"


def made_up(seed: int) -> dict[str, object]:
    """Return the record of a pair whose raw confidences are too high, most so where it failed."""
    rng = np.random.default_rng(seed)
    quality = rng.uniform(-1, 3)
    counts = np.zeros((KINDS, len(ODDS) + 1, len(ERRORS) + 1), int)
    for place in range(10, len(ODDS) - 4):
        right = float(sigmoid(np.array(0.5 * ODDS[place] + quality - 1)))
        within = rng.multinomial(round(400 * right), np.full(12, 1 / 12))
        counts[0, place, :12] = within
        counts[0, place, 12:] = rng.multinomial(
            400 - within.sum(), np.full(len(ERRORS) - 11, 1 / (len(ERRORS) - 11))
        )

    own = float(sigmoid(np.array(quality)))
    return {
        "scene": f"scene {seed % 5}",
        "faults": f"fault {seed % 7}",
        "preset": PRESETS[seed % 3],
        "tally": [round(own * 1000 * 2**20), 1000, 100, 0, 1200],
        "noise": 1.0,
        "smoothing": 0.0,
        "blurred": False,
        "counts": counts.ravel().tolist(),
    }


def test_what_is_learned_keeps_its_promises() -> None:
    pairs = observed_of([made_up(seed) for seed in range(16)])
    weights = learn(pairs[:10])

    verdict = judged("unseen", pairs[10:], [weights] * 6)
    assert verdict.gap < 0.03, "a little less is promised than was seen"
    assert verdict.right == pytest.approx(0.9, abs=0.02)
    assert verdict.covered == pytest.approx(0.9, abs=0.04)


def test_counts_are_those_of_the_match() -> None:
    pair = render_pair(0, height=96, width=128, num_disparities=24)
    record = observed(pair, num_disparities=24)
    (one,) = observed_of([{"scene": "rendered", "faults": "sharp", **record}])

    assert one.counts.sum() == pair.left.shape[0] * pair.left.shape[1], "whoever sees the pixel"
    assert (one.counts.sum(axis=(1, 2)) > 0).all(), "own, beside an outline, filled"
    assert 0 < one.wrong < 0.5
    assert (one.traits[0], record["tally"][4]) == (1, pair.left.shape[0] * pair.left.shape[1])


def test_outlines_are_those_of_the_core() -> None:
    constants = find_constants(Path(__file__).parents[2])
    table = {c.name.rpartition(":")[2]: c.value for c in constants if c.path == CHOICES}
    own = observation._JUMP, observation._REACH
    assert (float(table["JUMP"]), int(table["OUTLINE_REACH"])) == own


def test_the_same_matches_are_drawn_again() -> None:
    jobs = confidence_jobs([], every=1)
    assert [job.arguments for job in jobs] == [job.arguments for job in confidence_jobs([])]
    assert len({tuple(job.key.values()) for job in jobs}) > 200
    assert confidence_jobs([], every=7) == jobs[::7]


def test_the_file_of_weights_is_as_the_core_has_it(tmp_path: Path) -> None:
    weights = learned_weights([made_up(seed) for seed in range(8)])
    write_weights(weights, tmp_path / "weights.rs")
    text = (tmp_path / "weights.rs").read_text()
    assert len(weights) == len(PRESETS)

    numbers = re.compile(r"-?\d+\.\d+")
    assert numbers.sub("x", text) == numbers.sub("x", WEIGHTS.read_text())
    written = [float(number) for number in numbers.findall(text)]
    expected = [
        number for one in weights for number in (*one.odds.ravel(), *one.knots.ravel(), *one.bars)
    ]
    np.testing.assert_allclose(written, expected, atol=5e-5)


def test_bars_hold_what_they_are_asked_for() -> None:
    (pair,) = observed_of([made_up(3)])
    weights = learn([pair])
    bars = bars_of(pair, log_odds(pair, weights.odds), weights)

    within = (pair.counts * (bars[:, :, None] >= SIZES)).sum() / pair.counts.sum()
    assert within == pytest.approx(0.9, abs=0.05)


def test_the_judge_learns_which_claims_are_right_and_writes_it_for_the_core(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(5)
    odds = rng.uniform(-3, 3, 6000)
    traits = rng.normal(size=(6000, judging.TRAITS))
    traits[:, 0], traits[:, 1] = rng.choice([0.2, 3.0], 6000), odds
    is_right = rng.random(6000) < sigmoid(odds)
    errors = np.where(is_right, rng.uniform(0, 1, 6000), rng.uniform(1, 9, 6000))
    flags = np.where(rng.random(6000) < 0.2, int(Flag.OCCLUDED), 0)
    both = rng.random(6000) < 0.2  # else one of claim and own disparity is right
    own_errors = np.where(is_right ^ both, 5.0, 0.5)
    columns = np.column_stack([errors, own_errors, flags, traits]).astype(np.float32)
    record = {"scene": "a", "faults": "sharp", "maps": {"fast": claims.packed(columns)}}
    (made,) = judging.claims_of([record])
    assert (np.bincount(made.cases) > 500).all()

    weights = judging.learn([made])
    found = judging.odds_of(made, weights)
    assert np.corrcoef(found, odds)[0, 1] > 0.97
    assert sigmoid(found).mean() == pytest.approx(is_right.mean(), abs=0.01)
    ahead = judging.odds_of(made, replace(weights, heights=[weights.ahead] * judging.CASES))
    differ = traits[:, 0] > 1
    assert np.corrcoef(ahead[differ], odds[differ])[0, 1] > 0.95

    true = replace(made, method=claims.TRUTH, errors=np.zeros_like(errors))
    other = judging.learn([made, true])  # true maps change what is taken, not how surely
    np.testing.assert_array_equal(other.heights, weights.heights)
    more = judging.odds_of(made, replace(other, heights=[other.ahead] * judging.CASES))
    assert more[differ].mean() > ahead[differ].mean() + 0.1

    judging.write_weights(weights, tmp_path / "weights.rs")
    form = re.compile(r"-?\d+\.\d+")
    shapes = [form.sub("0", text.read_text("utf-8")) for text in (tmp_path / "weights.rs", JUDGE)]
    assert shapes[0] == shapes[1]

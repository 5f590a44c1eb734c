"""Spoiled pairs -> how far disparities are off, by their raw confidence.

Every scene is matched as it is, under faults of the suites, under two of them in a row, and with a
range that is too short. Of each match remain the tally and the noise that the core's calibration
looks at, and a table of counts: all pixels with a truth, whether one camera or both see them, by
their kind (own, own beside an outline, filled), their raw confidence and their error.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from phasestereo._core import match_raw
from phasestereo._images import as_pair
from phasestereo.result import Flag
from phasestereo_bench.arrays import Map, Mask
from phasestereo_bench.cases import SUITES, load
from phasestereo_bench.datasets import Pair, Scene
from phasestereo_bench.rendering import render_pair
from phasestereo_bench.rigs import Fault
from phasestereo_bench.runner import Job
from phasestereo_large import pair_statistics

ODDS = np.linspace(-5.6, 5.6, 57)
"""Edges of the logarithm of the odds of a raw confidence."""
_RIGHT = 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 1
_WRONG = 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10, 13, 16, 20, 25, 32, 40, 50, 64
ERRORS = np.array([*_RIGHT, *_WRONG])
"""Edges of the errors, px; smaller and larger ones have a class of their own each."""

KINDS = 3
"""Kinds of disparities: a pixel's own; its own, beside an outline; filled."""
_JUMP, _REACH = 1.0, 8  # px, as the core's: an outline is a jump in the row within reach

PRESETS = "robust", "fast", "paper"
"""Those with weights of their own, in the order in which the core has them."""
_SELDOM = 3  # of the matches of the others, whose maps are simpler, one in this number
SHORT = "range too short"
SHARP = "sharp"
RENDERED = 6  # scenes
_FIRST_SEED = 200
_SCENES_PER_FAULT = 7
_IN_A_ROW = 180
_SHORTENED = 20
_SEED = 5


def faults() -> dict[str, Any]:
    """Return the degradations of pairs: a `Fault`, or a function of one image."""
    blurs = {f"one {name}": recipe for name, recipe in SUITES["one-sided-blur"].items()}
    del blurs[f"one {SHARP}"]
    return {**SUITES["rigs"], **blurs}


def confidence_jobs(scenes: Sequence[Scene], *, every: int = 1) -> list[Job]:
    """Return the matches to count: which faults of which scenes is drawn, always alike.

    Parameters
    ----------
    scenes
        Scenes with a truth; rendered ones are added.
    every
        Run every N-th match.
    """
    rng = np.random.default_rng(_SEED)
    names = [str(scene) for scene in scenes] + [f"rendered/{k}" for k in range(RENDERED)]
    sources: dict[str, Scene | int] = {str(scene): scene for scene in scenes}
    sources |= {f"rendered/{k}": _FIRST_SEED + k for k in range(RENDERED)}

    kinds = [name for name in faults() if name != SHARP]
    drawn: list[tuple[str, tuple[str, ...]]] = [(name, (SHARP,)) for name in names]
    for kind in kinds:
        several = rng.choice(len(names), min(_SCENES_PER_FAULT, len(names)), replace=False)
        drawn += [(names[index], (kind,)) for index in several]
    for _ in range(_IN_A_ROW):
        first, second = rng.choice(len(kinds), 2, replace=False)
        drawn.append((names[rng.integers(len(names))], (kinds[first], kinds[second])))
    for _ in range(_SHORTENED):
        drawn.append((names[rng.integers(len(names))], (kinds[rng.integers(len(kinds))], SHORT)))

    return [
        Job(
            key={
                "suite": "confidence",
                "scene": name,
                "faults": " + ".join(spoiled),
                "preset": preset,
            },
            work=observe,
            arguments={
                "source": sources[name],
                "spoiled": spoiled,
                "seed": number,
                "preset": preset,
            },
        )
        for preset in PRESETS
        for number, (name, spoiled) in enumerate(drawn)
        if preset == PRESETS[0] or number % _SELDOM == 0
    ][::every]


def observe(source: Scene | int, spoiled: Sequence[str], seed: int, preset: str) -> dict[str, Any]:
    """Match a spoiled pair, and return its tally, its noise, and the counts of its errors."""
    pair = load(source) if isinstance(source, Scene) else render_pair(source)
    rng = np.random.default_rng(seed)
    side = ("left", "right")[int(rng.integers(2))]

    known = faults()
    search: dict[str, int] = {}
    for name in spoiled:
        if name == SHORT:
            largest = float(np.nanmax(pair.known_truth))
            search = {"num_disparities": max(8, int(largest * rng.uniform(0.3, 0.8)))}
        else:
            pair = _spoiled(pair, known[name], side)

    return observed(pair, preset=preset, **search)


def observed(pair: Pair, *, preset: str = "robust", **search: Any) -> dict[str, Any]:
    """Match a pair by a preset, with confidences, and return the record of `observe`."""
    size = pair.left.shape[:2]

    def read(first: int, last: int) -> tuple[Any, Any, None, None]:
        return pair.left[first:last], pair.right[first:last], None, None

    options = {"preset": preset, "confidence": True, **search}
    statistics = pair_statistics(read, size, threads=1, **options)
    images = as_pair(np.ascontiguousarray(pair.left), np.ascontiguousarray(pair.right))
    found, _ = match_raw(images, (None, None), statistics, 0, (0, size[0]), 1)
    assert found.confidence is not None  # noqa: S101 - they were asked for

    truth = pair.known_truth
    counted = np.isfinite(truth) & np.isfinite(found.disparity)
    error = np.abs(found.disparity - truth)[counted]
    raw = found.confidence[counted].astype(np.float64).clip(1e-4, 1 - 1e-4)
    own = _beside_outlines(found.disparity).astype(int)
    kind = np.where(found.flags & Flag.FILLED, KINDS - 1, own)[counted]

    compensation = statistics.blur_compensation
    place = np.searchsorted(ODDS, np.log(raw / (1 - raw)))
    counts = np.zeros((KINDS, len(ODDS) + 1, len(ERRORS) + 1), int)
    np.add.at(counts, (kind, place, np.searchsorted(ERRORS, error)), 1)

    return {
        "tally": list(statistics.tally or ()),
        "noise": max(compensation.noise) if compensation else 0.0,
        "smoothing": max(compensation.smoothing) if compensation else 0.0,
        "blurred": compensation is not None
        and any(taps is not None for both in compensation.kernels for taps in both),
        "counts": counts.ravel().tolist(),
    }


def _beside_outlines(disparity: Map) -> Mask:
    """Return the mask of pixels with a jump of the disparities within reach in their row."""
    jumps = np.pad(np.abs(np.diff(disparity, axis=1)) > _JUMP, ((0, 0), (_REACH, _REACH + 1)))
    return np.asarray(sliding_window_view(jumps, 2 * _REACH + 1, axis=1).any(axis=2))


def _spoiled(pair: Pair, fault: Any, side: str) -> Pair:
    if isinstance(fault, Fault):
        return fault(pair, side)
    if side == "left":
        return replace(pair, left=fault(pair.left))
    return replace(pair, right=fault(pair.right))

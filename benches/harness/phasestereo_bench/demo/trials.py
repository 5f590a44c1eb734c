"""A rendered pair, its left image degraded, and how every method fares with and without that."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

from phasestereo.metrics import bad_pixels
from phasestereo_bench.arrays import Image, Map
from phasestereo_bench.datasets import Pair
from phasestereo_bench.degradation import Degradation, disk_psf
from phasestereo_bench.demo.methods import METHODS, DemoMethod
from phasestereo_bench.rendering import render_pair

RADIUS, GAIN, OFFSET, NOISE = 3.0, 0.6, 10.0, 2.0
"""The degradation of the left image: disk of defocus in pixels; then gray levels of 255."""


@dataclass(frozen=True, slots=True, eq=False)
class ScoredMap:
    """What a method made of a pair: disparities in pixels, bad-1.0 in %, wall-clock seconds."""

    disparity: Map
    bad: float
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """A method's trials on the sharp pair and on the one whose left image is degraded."""

    method: DemoMethod
    sharp: ScoredMap
    degraded: ScoredMap


@dataclass(frozen=True, slots=True, eq=False)
class Demo:
    """The scene, its degraded left image, and the outcome of every method, phase codes first."""

    seed: int
    pair: Pair
    degraded: Image
    outcomes: tuple[Comparison, ...]


def run_demo(
    seed: int = 0,
    *,
    height: int = 360,
    width: int = 480,
    num_disparities: int = 64,
    progress: Callable[[int, int], object] | None = None,
) -> Demo:
    """Render a scene, degrade its left image, and match it both ways by every method.

    Parameters
    ----------
    seed, height, width, num_disparities
        As for `phasestereo_bench.rendering.render_pair`; the seed is that of the noise, too.
    progress
        Called as ``progress(done, trials)`` after every trial.

    Returns
    -------
    Demo
        With the outcomes of all `METHODS`.

    Raises
    ------
    TypeError, ValueError
        As `phasestereo_bench.rendering.render_pair`.
    """
    pair = render_pair(seed, height=height, width=width, num_disparities=num_disparities)
    degraded = degradation(seed)(pair.left)

    attempts = [(method, left) for method in METHODS for left in (pair.left, degraded)]
    trials: list[ScoredMap] = []
    for method, left in attempts:
        trials.append(_attempt(method, left, pair))
        if progress is not None:
            progress(len(trials), len(attempts))

    outcomes = tuple(map(Comparison, METHODS, trials[::2], trials[1::2]))
    return Demo(seed, pair, degraded, outcomes)


def degradation(seed: int) -> Degradation:
    """Return the degradation of the left image; the seed is that of the noise."""
    return Degradation(disk_psf(RADIUS), gain=GAIN, offset=OFFSET, noise=NOISE, seed=seed)


def _attempt(method: DemoMethod, left: Image, pair: Pair) -> ScoredMap:
    start = time.perf_counter()
    disparity = method.match(left, pair.right, pair.num_disparities)
    seconds = time.perf_counter() - start

    bad = bad_pixels(disparity, cast("Map", pair.truth), 1.0, pair.masks["nonocc"])
    return ScoredMap(disparity, bad, seconds)


def verdict(demo: Demo) -> str:
    """Say in a sentence what the figures mean."""
    phase = demo.outcomes[0]
    others = [outcome for outcome in demo.outcomes if not outcome.method.is_ours]

    best = min(others, key=lambda outcome: outcome.degraded.bad)
    sharp = min(demo.outcomes, key=lambda outcome: outcome.sharp.bad)
    ratio = best.degraded.bad / max(phase.degraded.bad, 1e-9)

    return (
        f"With its left image out of focus, dim and noisy, phase codes get "
        f"{phase.degraded.bad:.1f} % of the pixels wrong and the best of the others, "
        f"{best.method.name}, {best.degraded.bad:.1f} %, {ratio:.1f} times as many; with both "
        f"images sharp {sharp.method.name} is best with {sharp.sharp.bad:.1f} %."
    )

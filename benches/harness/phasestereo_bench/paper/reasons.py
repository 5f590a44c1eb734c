"""Why phase codes lose or gain little where they do: the likely reasons, from what was measured."""

from __future__ import annotations

from dataclasses import replace
from statistics import fmean
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasestereo_bench.paper.blurs import box_psf
from phasestereo_bench.paper.claims import GAIN, WAYS, case_of
from phasestereo_bench.paper.experiments import AREAS, EXPERIMENTS, GAUSS, MOTION_X, MOTION_Y

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from phasestereo_bench.paper.claims import Case
    from phasestereo_bench.paper.readings import Reading

__all__ = ["Reason", "reasons", "short_levels"]

_SAME = 0.5
"""Percentage points that make no difference."""


class Reason(NamedTuple):
    """Why phase codes fall short of the claims at some levels of a case."""

    levels: list[float]
    text: str


def short_levels(case: Case) -> list[float]:
    """Return the levels where phase codes lose, or gain less than claimed for larger blurs."""
    larger = case.larger_gains
    return [
        level
        for level, gain in case.gains.items()
        if gain <= 0 or (level in larger and gain < GAIN)
    ]


def reasons(case: Case, readings: Sequence[Reading]) -> list[Reason]:
    """Return the likely reasons for all `short_levels`, each of which has one."""
    explained: list[Reason] = []
    rest = short_levels(case)
    for explain in (
        _too_small,
        _along_rows,
        _other_rule,
        _behind_when_sharp,
        _level,
        _half_of_areas,
    ):
        reason = explain(case, readings, rest) if rest else None
        if reason is not None and reason.levels:
            explained.append(reason)
            rest = [level for level in rest if level not in reason.levels]
    if rest:
        explained.append(Reason(rest, "no single reason stands out"))
    return explained


def _too_small(case: Case, readings: Sequence[Reading], levels: list[float]) -> Reason | None:
    """Explain by an L that does not hold the blur, as one chosen on a sharp pair."""
    experiment, rule = case.experiment, case.experiment.rules[0]
    sides = {
        each.level: each.neighborhood
        for each in readings
        if (each.experiment, each.scene) == (experiment.key, case.scene)
        and (each.protocol, each.method) == (case.way.protocol, "phase")
        and each.rule == case.way.rule(experiment)
    }
    small = [
        level for level in levels if (sides[level] or 0) < experiment.neighborhood(level, rule)
    ]
    if not small:
        return None
    beyond = (
        "at the frequencies of the codes next to nothing is left of the image"
        if experiment is GAUSS
        else "the frequencies of the codes lie about or beyond the first zero of the blur's "
        "transform, where the phase is noise"
    )
    return Reason(
        small, f"L = {sides[small[0]]}, the best on the sharp pair, is less than {rule}: {beyond}"
    )


def _other_rule(case: Case, readings: Sequence[Reading], levels: list[float]) -> Reason | None:
    """Explain by a rule for L that is not the best of those tried."""
    mine = dict(zip(case.levels, case.ours, strict=True))
    for way in WAYS:
        rule = way.rule(case.experiment)
        if way.protocol != case.way.protocol or rule == case.way.rule(case.experiment):
            continue
        other = case_of(readings, case.experiment, case.scene, way)
        theirs = dict(zip(other.levels, other.ours, strict=True))
        better = [level for level in levels if theirs[level] < mine[level] - _SAME]
        if better:
            return Reason(
                better,
                f"{_why_not(case, rule, better[-1])}; L = {rule} has {_mean(theirs, better)} % "
                f"wrong there, this one {_mean(mine, better)}",
            )
    return None


def _why_not(case: Case, rule: str, level: float) -> str:
    """Say what is wrong with a case's rule for L where another one does better."""
    experiment = case.experiment
    mine = experiment.neighborhood(level, case.way.rule(experiment))
    other = experiment.neighborhood(level, rule)
    if mine > other:
        return f"L = {case.way.rule(experiment)} is more than this blur needs, and fattens outlines"
    left = [f"{100 * _amplitude(level, 2 / side):.0f} %" for side in (mine, other)]
    return (
        f"the highest frequency of the codes is next to the first zero of the motion's transform: "
        f"{left[0]} of its amplitude are left at {experiment.symbol} = {level:g}, "
        f"{left[1]} with L = {rule}"
    )


def _amplitude(length: float, frequency: float) -> float:
    """Return what a motion leaves of a frequency, cycles per pixel."""
    taps = box_psf(length)[0]
    at = np.arange(taps.size) - taps.size // 2
    return float(abs(taps @ np.cos(2 * np.pi * frequency * at)))


def _along_rows(case: Case, readings: Sequence[Reading], levels: list[float]) -> Reason | None:
    """Explain by a motion that spares what disparities are told by."""
    larger = [level for level in levels if level in case.larger_gains]
    if case.experiment is not MOTION_Y or not larger:
        return None
    across = case_of(readings, MOTION_X, case.scene, case.way)
    here, there = (
        _mean(dict(zip(each.levels, each.theirs, strict=True)), larger) for each in (case, across)
    )
    return Reason(
        larger,
        "motion along y spares the detail along rows, which tells disparities: "
        f"{case.experiment.rival.name} has {here} % wrong, with motion along x {there}; a "
        "neighbourhood that holds the blur fattens outlines all the same",
    )


def _behind_when_sharp(
    case: Case, readings: Sequence[Reading], levels: list[float]
) -> Reason | None:
    """Explain by what phase codes lose on the sharp pair already."""
    sharp = _sharp(case, readings)
    if sharp is None or sharp[0] - sharp[1] <= _SAME:
        return None
    ours, theirs = sharp
    behind = [level for level in levels if case.gains[level] >= theirs - ours - _SAME]
    return Reason(
        behind,
        f"on the sharp pair phase codes are behind already, {ours:.1f} % against {theirs:.1f}: a "
        "code describes a whole neighbourhood, and fattens outlines",
    )


def _sharp(case: Case, readings: Sequence[Reading]) -> tuple[float, float] | None:
    """Return the % of bad pixels of phase codes and of the rival on the sharp pair, if known."""
    for experiment in EXPERIMENTS:
        if experiment.power == case.experiment.power:
            like = replace(experiment, rival=case.experiment.rival)
            sharp = case_of(readings, like, case.scene, case.way).sharp
            if sharp is not None:
                return sharp
    return None


def _level(case: Case, _: Sequence[Reading], levels: list[float]) -> Reason | None:
    """Explain by nothing: there is hardly a difference."""
    tied = [level for level in levels if abs(case.gains[level]) <= _SAME]
    return Reason(tied, f"the two are level, {_SAME:g} points apart at most") if tied else None


def _half_of_areas(case: Case, _: Sequence[Reading], levels: list[float]) -> Reason | None:
    """Explain by the areas that are not blurred."""
    if case.experiment is not AREAS:
        return None
    text = "half of the areas are not blurred: there, an L made for the blur only fattens outlines"
    return Reason(levels, text)


def _mean(values: dict[float, float], levels: Iterable[float]) -> str:
    return f"{fmean(values[level] for level in levels):.1f}"

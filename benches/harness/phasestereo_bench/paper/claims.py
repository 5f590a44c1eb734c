"""The paper's claims beside what was measured, and the likely reasons where they do not hold."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

from phasestereo_bench.paper.cells import SCENES
from phasestereo_bench.paper.experiments import BITS_KEY, EXPERIMENTS, PROTOCOLS
from phasestereo_bench.paper.methods import NSAD, SAD
from phasestereo_bench.paper.readings import curve

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from phasestereo_bench.paper.experiments import Experiment
    from phasestereo_bench.paper.readings import Reading

__all__ = [
    "FLAT",
    "GAIN",
    "WAYS",
    "Case",
    "Flatness",
    "Verdict",
    "Way",
    "better_in_all_cases",
    "case_of",
    "cases",
    "flat_in_bits",
    "flatness",
    "gains_at_larger_blurs",
]

GAIN = 5.0
"""Percentage points which the paper's method gains "in many cases" at the least ("5 to 9")."""

FLAT = 2.0
"""Percentage points over which a "fairly constant" figure may spread."""

_PARTLY = 2 / 3


class Verdict(Enum):
    """Whether a claim holds here."""

    YES = "reproduced"
    PARTLY = "reproduced in part"
    NO = "not reproduced"


class Way(NamedTuple):
    """How the methods are set up: a protocol, and which of an experiment's rules for L."""

    name: str
    protocol: str
    number: int = 0

    def rule(self, experiment: Experiment) -> str:
        """Return the rule for L in an experiment; the only one where it has one; or none."""
        if self.protocol == "fixed":
            return ""
        return experiment.rules[min(self.number, len(experiment.rules) - 1)]


WAYS = (
    Way("tied to the blur, L = 2n + 1", "tied", 0),
    Way("tied to the blur, L = 3n", "tied", 1),
    Way("fixed by the sharp pair", "fixed"),
)


@dataclass(frozen=True, slots=True)
class Case:
    """Phase codes and their rivals in an experiment on a pair, at all levels with any blur.

    Attributes
    ----------
    experiment, scene, way
        Which.
    levels
        The amounts of blur, ascending.
    ours, theirs, best
        % of bad pixels of phase codes, of the rival that the paper names for the experiment, and of
        the better one of both rivals.
    sharp
        % of bad pixels of phase codes and of that rival without any blur, where that is a level.
    """

    experiment: Experiment
    scene: str
    way: Way
    levels: tuple[float, ...]
    ours: tuple[float, ...]
    theirs: tuple[float, ...]
    best: tuple[float, ...]
    sharp: tuple[float, float] | None = None

    @property
    def gains(self) -> dict[float, float]:
        """By how many percentage points phase codes are better, by level."""
        return _gains(self.levels, self.ours, self.theirs)

    @property
    def gains_over_best(self) -> dict[float, float]:
        """By how many percentage points they are better than the better one of both rivals."""
        return _gains(self.levels, self.ours, self.best)

    @property
    def larger_gains(self) -> dict[float, float]:
        """The gains in the upper half of the range of levels."""
        middle = (self.levels[0] + self.levels[-1]) / 2
        return {level: gain for level, gain in self.gains.items() if level >= middle}

    @property
    def is_better_throughout(self) -> bool:
        """Whether phase codes are better at all levels."""
        return min(self.gains.values()) > 0

    @property
    def gains_much(self) -> bool:
        """Whether they gain `GAIN` points or more at half of the larger blurs or more."""
        return _share(gain >= GAIN for gain in self.larger_gains.values()) >= 0.5


class Flatness(NamedTuple):
    """How the error depends on the bits b of the phase, by the settings of a protocol.

    Attributes
    ----------
    protocol, scene, sigma
        Where.
    bad
        % of bad pixels by b.
    """

    protocol: str
    scene: str
    sigma: float
    bad: dict[int, float]

    @property
    def spread(self) -> float:
        """Largest less smallest, percentage points."""
        return max(self.bad.values()) - min(self.bad.values())

    @property
    def spread_from_two(self) -> float:
        """The same without b = 1."""
        values = [value for bits, value in self.bad.items() if bits > 1]
        return max(values) - min(values)


def cases(readings: Sequence[Reading], way: Way) -> list[Case]:
    """Return all the cases that the claims are about, for one way to set the methods up."""
    return [
        case_of(readings, experiment, scene, way) for experiment in EXPERIMENTS for scene in SCENES
    ]


def case_of(readings: Sequence[Reading], experiment: Experiment, scene: str, way: Way) -> Case:
    """Return one of the `cases`."""

    def line(method: str, rule: str = "") -> dict[float, float]:
        where = {"experiment": experiment.key, "scene": scene, "protocol": way.protocol}
        return curve(readings, **where, method=method, rule=rule)

    ours = line("phase", way.rule(experiment))
    rivals = {method.cost: line(method.cost) for method in (SAD, NSAD)}
    theirs = rivals[experiment.rival.cost]
    sharp = [level for level in ours if experiment.is_sharp(level)]
    levels = tuple(sorted(level for level in ours if level not in sharp))
    return Case(
        experiment=experiment,
        scene=scene,
        way=way,
        levels=levels,
        ours=tuple(ours[level] for level in levels),
        theirs=tuple(theirs[level] for level in levels),
        best=tuple(min(line[level] for line in rivals.values()) for level in levels),
        sharp=(ours[sharp[0]], theirs[sharp[0]]) if sharp else None,
    )


def flatness(readings: Sequence[Reading]) -> list[Flatness]:
    """Return the lines of Figure 3."""
    found = []
    for protocol in PROTOCOLS:
        for scene in SCENES:
            points = [
                each
                for each in readings
                if (each.experiment, each.protocol, each.scene) == (BITS_KEY, protocol, scene)
            ]
            for sigma in sorted({point.level for point in points}):
                bad = {point.bits: point.nonocc for point in points if point.level == sigma}
                found.append(Flatness(protocol, scene, sigma, {b: v for b, v in bad.items() if b}))
    return found


def better_in_all_cases(found: Iterable[Case]) -> Verdict:
    """Judge "in all the cases considered the proposed method performed relatively better".

    Reproduced if phase codes are better at every level of every case, in part if they are at two
    thirds of all levels.
    """
    return _verdict([gain > 0 for case in found for gain in case.gains.values()], enough=1.0)


def gains_at_larger_blurs(found: Iterable[Case]) -> Verdict:
    """Judge "in many cases error percentages between 5 and 9 percent better" at larger blurs.

    Reproduced if it is 5 points or more at half of the levels in the upper half of the range, in
    part if at a third.
    """
    much = [gain >= GAIN for case in found for gain in case.larger_gains.values()]
    return _verdict(much, enough=0.5)


def flat_in_bits(found: Iterable[Flatness]) -> Verdict:
    """Judge "the percentage of bad pixels is fairly constant" over the bits of the phase.

    Reproduced if no line spreads over more than 2 points, in part if two thirds of them do not.
    """
    return _verdict([each.spread <= FLAT for each in found], enough=1.0)


def _gains(
    levels: tuple[float, ...], ours: tuple[float, ...], theirs: tuple[float, ...]
) -> dict[float, float]:
    return {level: their - our for level, our, their in zip(levels, ours, theirs, strict=True)}


def _share(flags: Iterable[bool]) -> float:
    every = list(flags)
    return sum(every) / len(every)


def _verdict(flags: Sequence[bool], *, enough: float) -> Verdict:
    share = _share(flags)
    if share >= enough:
        return Verdict.YES
    return Verdict.PARTLY if share >= _PARTLY * enough else Verdict.NO

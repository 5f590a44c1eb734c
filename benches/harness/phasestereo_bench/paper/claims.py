"""Judges the paper's claims by our measurements, and makes the tables behind the verdicts."""

from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

from phasestereo_bench.paper.experiments import (
    BITS_KEY,
    EXPERIMENTS,
    NSAD,
    PROTOCOLS,
    SAD,
    Experiment,
)
from phasestereo_bench.paper.study import SCENES, Reading, Study, curve
from phasestereo_bench.report.tables import MISSING, Table

_GAIN = 5.0  # points that the paper's method gains at least "in many cases"
_FLAT = 2.0  # points over which a "fairly constant" figure may spread
_PARTLY = 2 / 3  # a claim is reproduced in part if this share of its conditions holds

BETTER, GAINS, CONSTANT = (
    "better in all cases",
    f"{_GAIN:g} to 9 points in many cases at larger blurs",
    "flat in b",
)
CLAIMS = {
    BETTER: "In all the cases considered the proposed method performed relatively better",
    GAINS: "significant improvements in quality occurred mostly for larger amounts of blur, when "
    "our method produced in many cases error percentages between 5 and 9 percent better than SAD",
    CONSTANT: "the percentage of bad pixels in the final depth-maps is fairly constant, and this "
    "justifies the use of the smallest values for b",
}
"""The claims in short, and in the paper's words."""


class ClaimVerdict(Enum):
    """Whether a claim holds here."""

    YES = "reproduced"
    PARTLY = "reproduced in part"
    NO = "not reproduced"


class Setup(NamedTuple):
    """A setup of the methods: a protocol, and one of an experiment's rules for L."""

    name: str
    protocol: str
    number: int = 0

    def rule(self, experiment: Experiment) -> str:
        """Return the rule for L in an experiment; the only one if it has one; or no rule."""
        if self.protocol == "fixed":
            return ""
        return experiment.rules[min(self.number, len(experiment.rules) - 1)]


SETUPS = (
    Setup("tied to the blur, L = 2n + 1", "tied", 0),
    Setup("tied to the blur, L = 3n", "tied", 1),
    Setup("fixed by the sharp pair", "fixed"),
)
_SETUPS_OF_GAUSS = {"tied": "tied to the blur, L = 4 sigma + 1", "fixed": "fixed by the sharp pair"}


class ClaimCase(NamedTuple):
    """An experiment on a pair, and the points by which phase codes are better there.

    Attributes
    ----------
    gains, over_best
        Points of phase codes over the rival that the paper names, and over the better one of both
        rivals, one per level with any blur, ascending.
    """

    experiment: Experiment
    scene: str
    gains: dict[float, float]
    over_best: dict[float, float]

    @property
    def larger_gains(self) -> list[float]:
        """Gains in the upper half of the range of levels."""
        middle = (min(self.gains) + max(self.gains)) / 2
        return [gain for level, gain in self.gains.items() if level >= middle]


class BitsLine(NamedTuple):
    """A line of Figure 3: % of bad pixels by the bits b, under a Gaussian blur of sigma."""

    protocol: str
    scene: str
    sigma: float
    bad: dict[int, float]

    @property
    def spread(self) -> float:
        """Difference between the largest and the smallest figure, percentage points."""
        return max(self.bad.values()) - min(self.bad.values())


class ClaimResult(NamedTuple):
    """The verdict on a claim, the settings behind it, and where the claim holds."""

    claim: str
    setup: str
    verdict: ClaimVerdict
    holds_at: str


def judge_claims(readings: Sequence[Reading]) -> list[ClaimResult]:
    """Judge the claims.

    Phase codes must be better at every level of every case; better by 5 points at half of the
    levels in the upper halves of the ranges ("in many cases"); and every line of Figure 3 must
    spread over no more than 2 points. If two thirds of that hold, a claim is reproduced in part.
    """
    found = {setup.name: cases(readings, setup) for setup in SETUPS}

    better = {
        name: [gain > 0 for case in each for gain in case.gains.values()]
        for name, each in found.items()
    }
    much = {
        name: [gain >= _GAIN for case in each for gain in case.larger_gains]
        for name, each in found.items()
    }
    flat = {
        name: [each.spread <= _FLAT for each in lines(readings) if each.protocol == protocol]
        for protocol, name in _SETUPS_OF_GAUSS.items()
    }

    return [
        *(_judge(BETTER, setup, flags, "levels") for setup, flags in better.items()),
        *(_judge(GAINS, setup, flags, "levels", enough=0.5) for setup, flags in much.items()),
        *(_judge(CONSTANT, setup, flags, "lines") for setup, flags in flat.items()),
    ]


def _judge(
    claim: str, setup: str, flags: Sequence[bool], what: str, *, enough: float = 1.0
) -> ClaimResult:
    share = sum(flags) / len(flags)
    in_part = ClaimVerdict.PARTLY if share >= _PARTLY * enough else ClaimVerdict.NO
    verdict = ClaimVerdict.YES if share >= enough else in_part

    return ClaimResult(claim, setup, verdict, f"{sum(flags)} of {len(flags)} {what}")


def cases(readings: Sequence[Reading], setup: Setup) -> list[ClaimCase]:
    """Return all cases that the claims cover, for one setup of the methods."""
    return [_case(readings, each, scene, setup) for each in EXPERIMENTS for scene in SCENES]


def _case(
    readings: Sequence[Reading], experiment: Experiment, scene: str, setup: Setup
) -> ClaimCase:
    def line(method: str, rule: str = "") -> dict[float, float]:
        where = {"experiment": experiment.key, "scene": scene, "protocol": setup.protocol}
        return curve(readings, **where, method=method, rule=rule)

    ours = line("phase", setup.rule(experiment))
    rivals = {method.cost: line(method.cost) for method in (SAD, NSAD)}
    levels = sorted(level for level in ours if not experiment.is_sharp(level))
    theirs = rivals[experiment.rival.cost]

    return ClaimCase(
        experiment,
        scene,
        gains={level: theirs[level] - ours[level] for level in levels},
        over_best={
            level: min(rival[level] for rival in rivals.values()) - ours[level] for level in levels
        },
    )


def lines(readings: Sequence[Reading]) -> list[BitsLine]:
    """Return the lines of Figure 3."""
    found = []
    for protocol in PROTOCOLS:
        for scene in SCENES:
            where = (BITS_KEY, protocol, scene)
            points = [r for r in readings if (r.experiment, r.protocol, r.scene) == where]
            for sigma in sorted({point.level for point in points}):
                bad = {p.bits: p.nonocc for p in points if p.level == sigma}
                found.append(BitsLine(protocol, scene, sigma, bad))

    return found


# Tables


def claims_table(found: Sequence[ClaimResult]) -> Table:
    """Return the table of verdicts."""
    rows = ((each.claim, each.setup, each.verdict.value, each.holds_at) for each in found)
    return Table.of(("claim", "settings", "verdict", "holds at"), rows, labels=3)


def cases_table(found: Sequence[ClaimCase]) -> Table:
    """Return the results of phase codes in every case of one setup of the methods."""
    header = (
        *("pair", "left image", "the paper's rival", "better at", "better than both at"),
        *("gain at the larger blurs, points", f"{_GAIN:g} points or more at"),
    )

    rows = (
        (
            case.scene.title(),
            case.experiment.title,
            case.experiment.rival.name,
            f"{sum(gain > 0 for gain in case.gains.values())} of {len(case.gains)}",
            f"{sum(gain > 0 for gain in case.over_best.values())} of {len(case.gains)}",
            f"{min(case.larger_gains):+.1f} to {max(case.larger_gains):+.1f}",
            f"{sum(gain >= _GAIN for gain in case.larger_gains)} of {len(case.larger_gains)}",
        )
        for case in found
    )

    return Table.of(header, rows, labels=3)


def bits_table(found: Sequence[BitsLine]) -> Table:
    """Return the figures of Figure 3."""
    header = ("settings", "pair", "sigma", *(f"b = {b}" for b in found[0].bad), "spread")

    rows = (
        (
            *(line.protocol, line.scene.title(), f"{line.sigma:g}"),
            *(f"{value:.1f}" for value in (*line.bad.values(), line.spread)),
        )
        for line in found
    )

    return Table.of(header, rows, labels=2)


def settings_table(study: Study) -> Table:
    """Return the settings chosen on the sharp pairs."""
    header = (
        *("pair", "method", "unit of the penalty", "fixed: L", "fixed: window", "fixed: penalty"),
        *("fixed: bad, %", "tied: penalty", "tied: bad, %"),
    )

    rows = []
    for task, choice in study.choices.items():
        is_phase = task.method.cost == "phase"
        rows.append(
            (
                task.scene.title(),
                task.method.name + (f", k = {task.power}" if is_phase else ""),
                task.method.unit,
                str(choice.fixed.neighborhood) if is_phase else MISSING,
                str(choice.fixed.window),
                f"{choice.fixed.p1:g}",
                f"{choice.fixed_bad:.1f}",
                f"{choice.penalty:g}",
                f"{choice.penalty_bad:.1f}",
            )
        )

    return Table.of(header, rows, labels=3)

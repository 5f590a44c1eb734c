"""The settings of every method, chosen on the sharp pairs, and what the protocols make of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, cast

from phasestereo_bench.paper.cells import SCENES, Cell
from phasestereo_bench.paper.experiments import EXPERIMENTS, SHARP, SMALLEST
from phasestereo_bench.paper.methods import METHODS, PHASE, Grid

if TYPE_CHECKING:
    from collections.abc import Mapping

    from phasestereo.settings import Settings
    from phasestereo_bench.paper.experiments import Experiment, Series
    from phasestereo_bench.paper.methods import Method

__all__ = [
    "FULL_GRID",
    "QUICK_GRID",
    "Candidates",
    "Choice",
    "candidates",
    "candidates_for",
    "choose",
    "settings_at",
]

_ANY_POWER = 1  # for methods that have none

FULL_GRID = Grid()
QUICK_GRID = Grid(windows=(SMALLEST,), neighborhoods=(SMALLEST,))


class Candidates(NamedTuple):
    """Whose settings are chosen: those of a method for a pair, and for a power k of the codes."""

    scene: str
    method: Method
    power: int

    @property
    def tied(self) -> list[Settings]:
        """What the protocol "tied" chooses its penalty from."""
        return self.method.candidates(Grid((SMALLEST,), (SMALLEST,)), self.power)

    def cells(self, grid: Grid) -> list[Cell]:
        """Return all that has to be measured to choose."""
        wanted = [*self.method.candidates(grid, self.power), *self.tied]
        return [Cell(self.scene, SHARP, settings) for settings in dict.fromkeys(wanted)]


@dataclass(frozen=True, slots=True)
class Choice:
    """What was chosen.

    Attributes
    ----------
    fixed, fixed_bad
        The settings that are the best on the sharp pair, and their % of bad pixels there.
    penalty, penalty_bad
        The best penalty for the smallest window and neighbourhood, and likewise.
    """

    fixed: Settings
    fixed_bad: float
    penalty: float
    penalty_bad: float


def candidates() -> list[Candidates]:
    """Return whose settings have to be chosen."""
    found = [
        candidates_for(scene, method, experiment)
        for scene in SCENES
        for method in METHODS
        for experiment in EXPERIMENTS
    ]
    return list(dict.fromkeys(found))


def candidates_for(scene: str, method: Method, experiment: Experiment) -> Candidates:
    """Return those that an experiment takes its settings from."""
    return Candidates(scene, method, experiment.power if method is PHASE else _ANY_POWER)


def choose(whose: Candidates, grid: Grid, bad: Mapping[Cell, float]) -> Choice:
    """Return the best settings, the first of them where several are equally good.

    Parameters
    ----------
    whose
        Of these.
    grid
        What there is to choose from.
    bad
        The % of bad pixels of all `Candidates.cells`.
    """

    def badness(settings: Settings) -> float:
        return bad[Cell(whose.scene, SHARP, settings)]

    fixed = min(whose.method.candidates(grid, whose.power), key=badness)
    tied = min(whose.tied, key=badness)
    return Choice(fixed, badness(fixed), cast("float", tied.penalty), badness(tied))


def settings_at(series: Series, experiment: Experiment, level: float, choice: Choice) -> Settings:
    """Return the settings of a line of a figure at a level of the blur."""
    if series.protocol == "fixed":
        return choice.fixed
    side = experiment.neighborhood(level, series.rule) if series.rule else None
    return series.method.settings(
        window=experiment.window(level),
        penalty=choice.penalty,
        neighborhood=side,
        power=experiment.power,
    )

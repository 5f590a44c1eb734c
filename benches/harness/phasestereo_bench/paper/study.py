"""Runs the experiments: settings are chosen on the sharp pairs, then everything is measured."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

from phasestereo_bench.paper.cells import SCENES, Cell, measure
from phasestereo_bench.paper.choices import (
    FULL_GRID,
    QUICK_GRID,
    candidates,
    candidates_for,
    choose,
    settings_at,
)
from phasestereo_bench.paper.experiments import (
    BITS,
    BITS_KEY,
    BITS_SIGMAS,
    EXPERIMENTS,
    GAUSS,
    PROTOCOLS,
    QUICK_BITS_SIGMAS,
)
from phasestereo_bench.paper.methods import recoded
from phasestereo_bench.paper.prototype import figures
from phasestereo_bench.paper.readings import reading

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from contextlib import AbstractContextManager
    from pathlib import Path

    from phasestereo_bench.paper.cells import Pairs, Scores
    from phasestereo_bench.paper.choices import Candidates, Choice
    from phasestereo_bench.paper.experiments import Experiment, Series
    from phasestereo_bench.paper.methods import Grid
    from phasestereo_bench.paper.prototype import Figure
    from phasestereo_bench.paper.readings import Reading

    Choices = Mapping[Candidates, Choice]
    Progress = Callable[[int, int], object] | None
    Watch = Callable[[str], AbstractContextManager[Progress]]

__all__ = ["Again", "Point", "Study", "cell_at", "levels_of", "run_study"]


class Point(NamedTuple):
    """A point of a figure: the cell that it shows, and where."""

    experiment: str
    series: Series
    level: float
    cell: Cell


class Again(NamedTuple):
    """A figure of the prototype and what was measured: likewise, and by the suite's recipe."""

    figure: Figure
    measured: float
    suite: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """All that was measured.

    Attributes
    ----------
    quick
        Whether these are the few levels of a trial.
    grid
        What there was to choose from.
    choices
        What was chosen.
    readings
        The points of Figures 2 and 3.
    prototype
        The prototype's figures, measured again.
    """

    quick: bool
    grid: Grid
    choices: Choices
    readings: list[Reading]
    prototype: list[Again]


def run_study(
    pairs: Pairs,
    store: Path,
    *,
    quick: bool = False,
    workers: int | None = None,
    watch: Watch = lambda _: nullcontext(),
) -> Study:
    """Run the experiments, but for what a store has of them already.

    Parameters
    ----------
    pairs
        As of `load_pairs`.
    store, workers
        As for `phasestereo_bench.run`.
    quick
        Whether a few levels and settings are enough.
    watch
        Called with the name of a stage, it returns a context manager for the callable that is told
        of the progress of the stage, or for None.

    Raises
    ------
    OSError, RuntimeError, TypeError, ValueError, KeyboardInterrupt
        As `phasestereo_bench.paper.cells.measure`.
    """
    grid = QUICK_GRID if quick else FULL_GRID
    with watch("Choosing settings on the sharp pairs") as progress:
        choices = _choose(grid, pairs, store, workers=workers, progress=progress)
    points = [*_points(choices, quick=quick), *_bits_points(choices, quick=quick)]
    known = [each for each in figures() if each.level in levels_of(each.experiment, quick=quick)]
    cells = [point.cell for point in points]
    cells += [cell for figure in known for cell in (figure.cell, figure.suite_cell)]
    with watch("Running the experiments") as progress:
        scores = measure(cells, pairs, store, workers=workers, progress=progress)
    return Study(
        quick=quick,
        grid=grid,
        choices=choices,
        readings=[_reading(point, scores[point.cell]) for point in points],
        prototype=[
            Again(figure, scores[figure.cell].nonocc, scores[figure.suite_cell].nonocc)
            for figure in known
        ],
    )


def cell_at(
    series: Series, experiment: Experiment, scene: str, level: float, choices: Choices
) -> Cell:
    """Return what a line of a figure shows of a pair at a level of the blur."""
    choice = choices[candidates_for(scene, series.method, experiment)]
    settings = settings_at(series, experiment, level, choice)
    return Cell(scene, experiment.blur(level), settings)


def _choose(
    grid: Grid, pairs: Pairs, store: Path, *, workers: int | None, progress: Progress
) -> Choices:
    whose = candidates()
    cells = [cell for each in whose for cell in each.cells(grid)]
    scores = measure(cells, pairs, store, workers=workers, progress=progress)
    bad = {cell: score.nonocc for cell, score in scores.items()}
    return {each: choose(each, grid, bad) for each in whose}


def levels_of(experiment: Experiment, *, quick: bool) -> tuple[float, ...]:
    """Return the levels of an experiment that are measured."""
    return experiment.quick_levels if quick else experiment.levels


def _points(choices: Choices, *, quick: bool) -> list[Point]:
    """Return the points of Figure 2."""
    return [
        Point(experiment.key, series, level, cell_at(series, experiment, scene, level, choices))
        for experiment in EXPERIMENTS
        for scene in SCENES
        for protocol in PROTOCOLS
        for series in experiment.series(protocol)
        for level in levels_of(experiment, quick=quick)
    ]


def _bits_points(choices: Choices, *, quick: bool) -> list[Point]:
    """Return the points of Figure 3: the settings of the second experiment, but for the bits."""
    points = []
    for scene in SCENES:
        for protocol in PROTOCOLS:
            series = GAUSS.series(protocol)[0]
            for sigma in QUICK_BITS_SIGMAS if quick else BITS_SIGMAS:
                cell = cell_at(series, GAUSS, scene, sigma, choices)
                points += [
                    Point(
                        BITS_KEY,
                        series,
                        sigma,
                        replace(cell, settings=recoded(cell.settings, bits)),
                    )
                    for bits in BITS
                ]
    return points


def _reading(point: Point, scores: Scores) -> Reading:
    return reading(
        point.cell,
        scores,
        experiment=point.experiment,
        protocol=point.series.protocol,
        rule=point.series.rule,
        level=point.level,
    )

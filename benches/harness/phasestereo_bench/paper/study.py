"""Runs the experiments: chooses settings on the sharp pairs, then measures everything."""

import hashlib
import os
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

import phasestereo
from phasestereo.matching import match
from phasestereo.metrics import middlebury_v2
from phasestereo.settings import Settings
from phasestereo_bench.datasets import Pair, find_scene
from phasestereo_bench.paper.experiments import (
    BITS,
    BITS_KEY,
    BITS_SIGMAS,
    EXPERIMENTS,
    FULL_GRID,
    GAUSS,
    METHODS,
    PHASE,
    PROTOCOLS,
    QUICK_BITS_SIGMAS,
    QUICK_GRID,
    SHARP,
    Experiment,
    Grid,
    MatchingCost,
    PaperBlur,
    Series,
    recoded,
)
from phasestereo_bench.runner import Job, run_jobs

Progress = Callable[[int, int], object] | None
Watch = Callable[[str], AbstractContextManager[Progress]]


SCENES = {"cones": "scenes2003/cones", "tsukuba": "scenes2001/tsukuba"}
"""The paper's pairs, in the order of its columns, and their paths in Middlebury's folders."""


# Pairs


@dataclass(frozen=True, slots=True)
class Pairs:
    """The folder of the pairs, and digests that distinguish them from others of the same names."""

    folder: Path
    digests: dict[str, str]


def load_pairs(folder: str | os.PathLike[str]) -> Pairs:
    """Find the paper's pairs in a Middlebury folder tree, and check that they can be scored.

    Raises
    ------
    OSError
        If the folder or a file in it cannot be read.
    ValueError
        If a pair is missing, or has no truth or no mask of the pixels that both images see.
    """
    root = Path(folder).absolute()
    return Pairs(root, {scene: _digest(load_pair(str(root), scene)) for scene in SCENES})


@lru_cache(maxsize=len(SCENES))
def load_pair(folder: str, scene: str) -> Pair:
    """Return a pair that can be scored; raise the same errors as `load_pairs`."""
    found = find_scene(folder, SCENES[scene])
    pair = found.load()

    if pair.truth is None or "nonocc" not in pair.masks:
        raise ValueError(
            f"{found.folder}: has no truth with a mask of the pixels that both images see "
            f"({found.layout.truth} and mask_nonocc.png, or the truth of either image)"
        )

    return pair


def _digest(pair: Pair) -> str:
    content = hashlib.sha256()
    for array in (pair.left, pair.right, pair.truth, pair.masks["nonocc"]):
        content.update(cast("NDArray[np.float32]", array).tobytes())
    return content.hexdigest()[:12]


# Cells


@dataclass(frozen=True, slots=True)
class PaperCell:
    """One measurement, which several figures and tables may show."""

    scene: str
    blur: PaperBlur
    settings: Settings

    def job(self, pairs: Pairs) -> Job:
        """Return the job that measures the cell.

        The key holds a digest of the pair and the version of this package: another pair under the
        same name, or another matcher, is another cell.
        """
        # Fields that only phase codes use are None for other costs.
        names = ("power", "bits", "neighborhood")
        phase = self.settings.cost == "phase"
        key = {
            "kind": "paper",
            "version": phasestereo.__version__,
            "scene": self.scene,
            "pair": pairs.digests[self.scene],
            "degradation": self.blur.kind,
            "amount": float(self.blur.amount),
            "method": self.settings.cost,
            **{name: getattr(self.settings, name) if phase else None for name in names},
            "window": self.settings.window,
            "penalty": self.settings.p1,
        }
        return Job(key, score_cell, {"folder": str(pairs.folder), "cell": self})


def score_cell(folder: str, cell: PaperCell) -> dict[str, Any]:
    """Match; return the % of pixels off by more than 1, by region; None if its mask is missing."""
    pair = load_pair(folder, cell.scene)
    left, count = degraded(folder, cell.scene, cell.blur), pair.num_disparities
    found = match(left, pair.right, num_disparities=count, settings=cell.settings, threads=1)

    scores = middlebury_v2(found.disparity, pair)
    return {"nonocc": scores.nonocc, "all": scores.all, "disc": scores.disc}


@lru_cache(maxsize=4)
def degraded(folder: str, scene: str, blur: PaperBlur) -> NDArray[np.uint8]:
    """Return the degraded left image of a pair; cells of one image are measured in a row."""
    image: NDArray[np.uint8] = blur(load_pair(folder, scene).left)
    image.flags.writeable = False
    return image


def measure(
    cells: Iterable[PaperCell],
    pairs: Pairs,
    store: Path,
    *,
    workers: int | None = None,
    progress: Progress = None,
) -> dict[PaperCell, float]:
    """Measure the % of non-occluded pixels that are off by more than 1, for each cell.

    Skip cells that the store already has; a cell may appear more than once.

    Raises
    ------
    RuntimeError
        If a cell failed; the others are in the store.
    OSError, TypeError, ValueError, KeyboardInterrupt
        As `phasestereo_bench.run_jobs`, which takes the other arguments.
    """
    # One image after another: a process keeps the last few that it degraded.
    ordered = sorted(dict.fromkeys(cells), key=lambda cell: (cell.scene, str(cell.blur)))
    jobs = [cell.job(pairs) for cell in ordered]
    records = run_jobs(jobs, store, workers=workers, progress=progress)

    failed = [record for record in records if record["status"] != "ok"]
    if failed:
        raise RuntimeError(
            f"{len(failed)} of {len(records)} cells failed, the first with: {failed[0]['error']}; "
            f"the others are kept in {store}"
        )

    return dict(zip(ordered, (record["nonocc"] for record in records), strict=True))


# Choices


class TuningTask(NamedTuple):
    """A choice to make: the settings of a method for a pair and a power k of the codes."""

    scene: str
    method: MatchingCost
    power: int

    def candidates(self, grid: Grid) -> list[Settings]:
        """Return the choices of the protocol "fixed"."""
        return self.method.candidates(grid, self.power)

    @property
    def tied(self) -> list[Settings]:
        """Settings from which the protocol "tied" chooses its penalty."""
        return self.candidates(QUICK_GRID)

    def cells(self, grid: Grid) -> list[PaperCell]:
        """Return all cells to measure before the choice."""
        wanted = dict.fromkeys([*self.candidates(grid), *self.tied])
        return [PaperCell(self.scene, SHARP, settings) for settings in wanted]


class ChosenSettings(NamedTuple):
    """The settings chosen on the sharp pair, and the % of bad pixels there.

    Attributes
    ----------
    fixed, fixed_bad
        The best settings of all.
    penalty, penalty_bad
        The best penalty for the smallest window and neighborhood.
    """

    fixed: Settings
    fixed_bad: float
    penalty: float
    penalty_bad: float


def tuning_task(scene: str, method: MatchingCost, experiment: Experiment) -> TuningTask:
    """Return the task that sets up an experiment; only phase codes have a power k."""
    return TuningTask(scene, method, experiment.power if method is PHASE else 1)


def tuning_tasks() -> list[TuningTask]:
    """Return all the tasks, each once."""
    found = (tuning_task(s, m, e) for s in SCENES for m in METHODS for e in EXPERIMENTS)
    return list(dict.fromkeys(found))


def choose(one: TuningTask, grid: Grid, bad: Mapping[PaperCell, float]) -> ChosenSettings:
    """Return the best settings, or the first of them if several are equally good."""

    def badness(settings: Settings) -> float:
        return bad[PaperCell(one.scene, SHARP, settings)]

    fixed, tied = min(one.candidates(grid), key=badness), min(one.tied, key=badness)
    return ChosenSettings(fixed, badness(fixed), tied.p1, badness(tied))


# The study


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """One point of a figure.

    Attributes
    ----------
    experiment, scene, protocol, method, rule, level
        The point: keys of an experiment ("bits" for Figure 3) and of a pair, "tied" or "fixed", the
        cost, the rule for L (empty elsewhere), and the amount of blur.
    bits
        Bits of a phase.
    nonocc
        % of the pixels seen by both images that are off by more than 1 pixel.
    """

    experiment: str
    scene: str
    protocol: str
    method: str
    rule: str
    level: float
    bits: int
    nonocc: float


def curve(readings: Iterable[Reading], **wanted: str | float) -> dict[float, float]:
    """Return the % of bad non-occluded pixels by level, for the points with these attributes."""
    return {
        each.level: each.nonocc
        for each in readings
        if all(getattr(each, name) == value for name, value in wanted.items())
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """All measurements of the experiments.

    Attributes
    ----------
    quick
        Whether the study has only the few levels of a trial.
    choices
        The chosen settings.
    readings
        The points of Figures 2 and 3.
    """

    quick: bool
    choices: Mapping[TuningTask, ChosenSettings]
    readings: list[Reading]


class _Point(NamedTuple):
    experiment: str
    series: Series
    level: float
    cell: PaperCell


def run_study(
    pairs: Pairs,
    store: Path,
    *,
    quick: bool = False,
    workers: int | None = None,
    watch: Watch = lambda _: nullcontext(),
) -> Study:
    """Run the experiments; skip the cells that a store already has.

    Parameters
    ----------
    pairs
        The result of `load_pairs`.
    store, workers
        As for `phasestereo_bench.run_jobs`.
    quick
        Whether a few levels and settings are enough.
    watch
        A function from the name of a stage to a context manager, which yields the callable that
        gets the progress of the stage, or None.

    Raises
    ------
    OSError, RuntimeError, TypeError, ValueError, KeyboardInterrupt
        As `measure`.
    """
    grid = QUICK_GRID if quick else FULL_GRID
    asked = [cell for one in tuning_tasks() for cell in one.cells(grid)]
    with watch("Choosing settings on the sharp pairs") as progress:
        bad = measure(asked, pairs, store, workers=workers, progress=progress)

    choices = {one: choose(one, grid, bad) for one in tuning_tasks()}

    points = [*_points(choices, quick=quick), *_bits_points(choices, quick=quick)]
    cells = [point.cell for point in points]
    with watch("Running the experiments") as progress:
        bad = measure(cells, pairs, store, workers=workers, progress=progress)

    return Study(
        quick=quick,
        choices=choices,
        readings=[
            Reading(
                experiment=point.experiment,
                scene=point.cell.scene,
                protocol=point.series.protocol,
                method=point.series.method.cost,
                rule=point.series.rule,
                level=point.level,
                bits=point.cell.settings.bits,
                nonocc=bad[point.cell],
            )
            for point in points
        ],
    )


def _cell_at(
    series: Series,
    experiment: Experiment,
    scene: str,
    level: float,
    choices: Mapping[TuningTask, ChosenSettings],
) -> PaperCell:
    """Return the cell of a line for a pair at a level of the blur."""
    choice = choices[tuning_task(scene, series.method, experiment)]
    settings = choice.fixed

    if series.protocol == "tied":
        settings = series.method.settings(
            window=experiment.window(level),
            penalty=choice.penalty,
            neighborhood=experiment.neighborhood(level, series.rule) if series.rule else None,
            power=experiment.power,
        )

    return PaperCell(scene, experiment.blur(level), settings)


def _points(choices: Mapping[TuningTask, ChosenSettings], *, quick: bool) -> list[_Point]:
    """Return the points of Figure 2."""
    return [
        _Point(experiment.key, series, level, _cell_at(series, experiment, scene, level, choices))
        for experiment in EXPERIMENTS
        for scene in SCENES
        for protocol in PROTOCOLS
        for series in experiment.series(protocol)
        for level in (experiment.quick_levels if quick else experiment.levels)
    ]


def _bits_points(choices: Mapping[TuningTask, ChosenSettings], *, quick: bool) -> list[_Point]:
    """Return the points of Figure 3: settings of the second experiment with other bits."""
    points = []
    for scene in SCENES:
        for protocol in PROTOCOLS:
            series = GAUSS.series(protocol)[0]
            for sigma in QUICK_BITS_SIGMAS if quick else BITS_SIGMAS:
                cell = _cell_at(series, GAUSS, scene, sigma, choices)
                for bits in BITS:
                    other = replace(cell, settings=recoded(cell.settings, bits))
                    points.append(_Point(BITS_KEY, series, sigma, other))

    return points

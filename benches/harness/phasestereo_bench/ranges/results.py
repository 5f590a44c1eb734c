"""What was found, as tables."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean

from phasestereo_bench.ranges.trials import Comparison, Trial
from phasestereo_bench.report.tables import Table


def found_table(trials: Sequence[Trial]) -> Table:
    """Return the number of constructions of each kind outside the range, and its length."""
    rows = []
    for kind in dict.fromkeys(trial.kind for trial in trials):
        some = [trial for trial in trials if trial.kind == kind]
        longer = [trial.longer for trial in some]
        outside = sum(trial.outside for trial in some)
        said = sum(trial.outside and bool(trial.search.left_out) for trial in some)
        cells = (
            f"{len(some)}",
            f"{outside}",
            f"{said}",
            f"{fmean(longer):.2f}",
            f"{max(longer):.2f}",
        )
        rows.append((kind, *cells))

    header = "kind", "pairs", "outside", "of them said", "length / needed, mean", "worst"
    return Table.of(header, rows)


def compared_table(scenes: Sequence[Comparison]) -> Table:
    """Return the cost of giving no range."""
    rows = [
        (
            scene.name,
            *(f"{100 * bad:.2f}" for bad in scene.bad),
            f"{scene.longer:.2f}",
            f"{scene.seconds[0] / scene.seconds[1]:.2f}",
        )
        for scene in scenes
    ]
    means = (
        *(f"{100 * fmean(scene.bad[side] for scene in scenes):.2f}" for side in (0, 1)),
        f"{fmean(scene.longer for scene in scenes):.2f}",
        f"{fmean(scene.seconds[0] / scene.seconds[1] for scene in scenes):.2f}",
    )
    header = "scene", "bad-1.0, no range given", "given", "length / needed", "time / given"
    return Table.of(header, [*rows, ("mean", *means)])

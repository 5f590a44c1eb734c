"""The page: everything that results come to, in a folder, as HTML and plots."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from phasestereo.io.drafts import replacing
from phasestereo.views.templating import render_page
from phasestereo_bench.report.cells import METRICS
from phasestereo_bench.report.origin import commands, explain, origin
from phasestereo_bench.report.plots import RIVAL, draw_duel, draw_means, leader, save_plot
from phasestereo_bench.report.results import knows_blur
from phasestereo_bench.report.sharp import sharp_tables
from phasestereo_bench.report.tables import (
    blurs,
    cost_table,
    environment_table,
    failure_table,
    mean_table,
    overall,
    scene_table,
    settings_table,
)

if TYPE_CHECKING:
    import os

    from phasestereo_bench.report.results import Results
    from phasestereo_bench.report.tables import Table

__all__ = ["write_report"]

_PLOTS = ("means", "scenes")


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A part of the page: a heading, then as much of text, plot and table as there is.

    Attributes
    ----------
    title
        The heading.
    text
        What to know about the plot and the table.
    plot
        Name of the plot's files without their suffix.
    table
        The table.
    """

    title: str
    text: str = ""
    plot: str = ""
    table: Table | None = None


def write_report(
    results: Results, folder: str | os.PathLike[str], *, metric: str = "v2.nonocc"
) -> list[Path]:
    """Write a page about results into a folder, in place of an earlier one.

    Parameters
    ----------
    results
        What to write about.
    folder
        Where to; made if need be.
    metric
        Which number, a name in `METRICS`.

    Returns
    -------
    list of Path
        What was written: plots (``means.svg`` and, if there is another method to compare ours
        with, ``scenes.svg``) and, last, ``report.html``.

    Raises
    ------
    ValueError
        If there is no number of the metric.
    OSError
        If the folder cannot be made or a file not written.
    """
    results.require_metric(metric)
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)

    figures = {"means": draw_means(results, metric)}
    duel = _duel(results, metric)
    if duel is not None:
        figures["scenes"] = draw_duel(results, metric, duel)

    written = [target / f"{name}.svg" for name in figures]
    for path in written:
        save_plot(figures[path.stem], path)

    # An earlier report may have had plots that this one lacks.
    earlier = {target / f"{name}.svg" for name in _PLOTS}
    for path in earlier.difference(written):
        path.unlink(missing_ok=True)

    text = render_page(
        "bench_report.html.j2",
        package="phasestereo_bench",
        sections=_sections(results, metric, duel),
        folder=target,
        title=f"Benchmark {results.suite}",
        lead=_lead(results),
        verdict=_verdict(results, metric),
        commands=commands(results, metric),
    )
    written.append(target / "report.html")
    with replacing(written[-1]) as file:
        file.write(text.encode())

    return written


def _duel(results: Results, metric: str) -> tuple[str, str] | None:
    """Return our best method and StereoSGBM, or where that is missing the best of the others."""
    ours = leader(results, metric, results.ours)
    others = [method for method in results.methods if method not in results.ours]
    rival = leader(results, metric, [RIVAL]) or leader(results, metric, others)

    return None if ours is None or rival is None else (ours, rival)


def _sections(results: Results, metric: str, duel: tuple[str, str] | None) -> list[Section]:
    """Return the parts of the page, without the commands."""
    made = origin(results)

    parts = [
        Section(
            title="Means over the scenes",
            text=f"{explain(results, metric)} {made}",
            plot="means",
            table=mean_table(results, metric),
        ),
        Section(title="Scene by scene", text=made, table=scene_table(results, metric)),
        Section(
            title="Time and memory",
            text="Medians over the scenes that all methods have. A cell is one call of the method "
            "on one pair, in a process that is held to one thread; its memory is how far the call "
            f"raises the resident memory of its process. {made}",
            table=cost_table(results),
        ),
        Section(title="Settings", table=settings_table(results)),
        Section(title="Environments", table=environment_table(results)),
    ]

    if duel is not None:
        ours, rival = duel
        text = f"Of the methods that compare phase codes, {ours} has the best {_span(results)}."
        title = f"{ours} against {rival}"
        parts.insert(1, Section(title=title, text=text, plot="scenes"))

    parts[1:1] = [
        Section(title=title, text=f"{text} {made}", table=table)
        for title, (text, table) in sharp_tables(results).items()
    ]

    if results.failures:
        parts.insert(-2, Section(title="Failed cells", table=failure_table(results)))

    return parts


def _lead(results: Results) -> str:
    failed = f"{len(results.failures)} cells failed" if results.failures else "no cell failed"
    return (
        f"{len(results.methods)} methods on {len(results.places)} scenes, {results.state}: "
        f"{len(results.cells)} cells with a result, {failed}."
    )


def _verdict(results: Results, metric: str) -> str:
    """List the methods from the best to the worst, those that know the blur apart."""
    scenes, values = overall(results, metric)
    ranked = sorted(values, key=lambda method: METRICS[metric].rank(values[method]))
    unit = METRICS[metric].unit
    texts = {m: f"{m} {METRICS[metric].format(values[m])} {unit}".strip() for m in ranked}

    given = [texts[method] for method in ranked if knows_blur(method)]
    others = [texts[method] for method in ranked if not knows_blur(method)]
    parts = [", ".join(others), *([f"told the blur: {', '.join(given)}"] if given else [])]

    title = f"{METRICS[metric].title}, {_span(results)} of {scenes} scenes"
    return f"{title[0].upper()}{title[1:]}: {'; '.join(filter(None, parts))}."


def _span(results: Results) -> str:
    return "mean over the blurs" if blurs(results) else "mean over all degradations"

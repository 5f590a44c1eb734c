"""``phasestereo bench report``: records -> tables, a plot, and the tables of documents."""

# No `from __future__ import annotations`: the command line is made of these annotations.

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, TypeAlias

from cyclopts import Parameter
from rich.console import Group

from phasestereo.cli.errors import refusals
from phasestereo.cli.terminal import printable
from phasestereo_bench.blur import read_blur
from phasestereo_bench.blur.document import MARKER as BLUR
from phasestereo_bench.blur.document import blur_text
from phasestereo_bench.cli.bench_tables import blur_screen, filled, screen, speed_screen
from phasestereo_bench.report import fill_document, read_results
from phasestereo_bench.report.cells import KIND, METRICS
from phasestereo_bench.report.documents import fill_places, render_document
from phasestereo_bench.report.origin import explain, origin
from phasestereo_bench.report.plots import draw_means, save_plot
from phasestereo_bench.report.results import Results
from phasestereo_bench.report.sharp import sharp_tables
from phasestereo_bench.report.tables import cost_table, mean_table
from phasestereo_bench.speed import read_speed
from phasestereo_bench.speed.document import MARKER as SPEED
from phasestereo_bench.speed.document import speed_text
from phasestereo_bench.store import read_store

Shown: TypeAlias = tuple[Group, Callable[[Path], None]]
"""What to print, and what fills a document."""

_OPTIONS = {"metric", "method", "suite", "side", "output"}
_SEVERAL = Parameter(consume_multiple=True, show_default=False)


def report(
    *results: Path,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    readme: Annotated[tuple[Path, ...], _SEVERAL] = (),
    metric: str = "v2.nonocc",
    method: Annotated[tuple[str, ...], _SEVERAL] = (),
    suite: str | None = None,
    side: str | None = None,
) -> None:
    """Report on ``bench middlebury``, ``speed`` or ``blur``: tables, and a plot.

    Prints the means over the scenes, the times, or what was found, and writes whatever else is
    asked for; of ``speed`` and ``blur`` there is no plot. For example:

    ```
    phasestereo bench report results.jsonl -o means.svg
    phasestereo bench report results.jsonl --readme README.md --method paper opencv:sgbm
    ```

    Parameters
    ----------
    results
        Files of records. Of several records of one cell the last counts.
    output
        File for a plot of the means, .svg or .png.
    readme
        Markdown files whose tables are to be replaced: what is between the comments
        ``<!-- bench:NAME -->`` and ``<!-- /bench:NAME -->``, NAME being one-sided-blur-means,
        one-sided-blur-scenes, sharp, sharp-v2, sharp-v3, speed, blur, or those of rigs and rigs-2,
        as rigs-rows.
    metric
        Which number: v2.nonocc, v2.all, v2.disc, v3.bad_0_5, v3.bad_1, v3.bad_2, v3.bad_4,
        v3.invalid, v3.avgerr, v3.rms, v3.a50, v3.a90, v3.a95, v3.a99, d1, epe or roc.
    method
        Only these methods, in this order, each as a table names it.
    suite
        Only this suite; needed where there are results of several.
    side
        Only cells with this image degraded, left or right; needed where there are both.
    """
    with refusals(options=_OPTIONS):
        if not results:
            raise ValueError("no file of records given")

        for benchmark, shown in (("speed", _speed(results)), ("blur", _blur(results))):
            if shown is not None:
                others = {"output": output, "method": method, "suite": suite, "side": side}
                asked = [name for name, value in others.items() if value]
                if asked:
                    raise ValueError(
                        f"{asked[0]}: results of bench {benchmark} have no choice of it"
                    )
                _show(shown, readme)
                return

        loaded = read_results(results, suite=suite, side=side, methods=method)
        loaded.require_metric(metric)

        for document in readme:  # refused before anything is written
            render_document(document, loaded, metric=metric)

        written = [] if output is None else [output]
        for path in written:
            save_plot(draw_means(loaded, metric), path)
        for document in readme:
            fill_document(document, loaded, metric=metric)

    rest = ", ".join(
        sorted({r["kind"] for path in results for r in read_store(path)} - {KIND, "environment"})
    )
    further = [f"Left out, records of other benchmarks: {rest}"] if rest else []
    show(loaded, metric, [*further, *(f"Wrote {path}" for path in (*written, *readme))])


def show(results: Results, metric: str, further: Sequence[str]) -> None:
    """Print tables, what they are and were made with, what failed, and further lines."""
    console = screen()
    console.print(filled(METRICS[metric].label, mean_table(results, metric)))
    for title, (_, table) in sharp_tables(results).items():
        console.print(filled(title, table))
    console.print(filled("One pair, one thread", cost_table(results)))

    failed = [f"{c.place}, {c.degradation}, {c.method} failed: {c.error}" for c in results.failures]
    for line in (explain(results, metric), origin(results), *failed, *further):
        console.print(printable(line), markup=False, soft_wrap=True)


def _speed(results: tuple[Path, ...]) -> Shown | None:
    loaded = read_speed(results)
    if loaded is None:
        return None
    return speed_screen(loaded), lambda document: fill_places(document, {SPEED: speed_text(loaded)})


def _blur(results: tuple[Path, ...]) -> Shown | None:
    loaded = read_blur(results)
    if loaded is None:
        return None
    return blur_screen(loaded), lambda document: fill_places(document, {BLUR: blur_text(loaded)})


def _show(shown: Shown, readme: tuple[Path, ...]) -> None:
    tables, fill = shown
    for document in readme:
        fill(document)

    console = screen()
    console.print(tables)
    for document in readme:
        console.print(printable(f"Wrote {document}"), markup=False, soft_wrap=True)

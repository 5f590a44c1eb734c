"""``phasestereo bench report``: records -> tables, plots, a page, and the tables of documents."""

# No `from __future__ import annotations`: the command line is made of these annotations.

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich import box
from rich.console import Console
from rich.table import Table as Screen
from rich.text import Text

from phasestereo.bench.methods import TRUE_BLUR
from phasestereo.bench.report import fill_document, read_results, write_report
from phasestereo.bench.report.documents import render_document
from phasestereo.bench.report.origin import explain
from phasestereo.bench.report.tables import Table, mean_table
from phasestereo.bench.speed import SpeedResults, fill_speed, read_speed
from phasestereo.cli.bench_tables import speed_screen
from phasestereo.cli.errors import refusals

_OPTIONS = {"metric", "method", "suite", "side", "output"}
_SEVERAL = Parameter(consume_multiple=True, show_default=False)
_PIPED_WIDTH = 120


def report(
    *results: Path,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    readme: Annotated[tuple[Path, ...], _SEVERAL] = (),
    metric: str = "v2.nonocc",
    method: Annotated[tuple[str, ...], _SEVERAL] = (),
    suite: str | None = None,
    side: str | None = None,
) -> None:
    """Tell what came out of ``bench middlebury`` or ``bench speed``: tables, plots, a page.

    Prints the means over the scenes, or the times, and writes whatever else is asked for; of times
    there is no page. For example:

    ```
    phasestereo bench report results.jsonl -o report
    phasestereo bench report results.jsonl --readme README.md --method paper opencv:sgbm
    ```

    Parameters
    ----------
    results
        Files of records. Of several records of one cell the last counts.
    output
        Folder for report.html, report.md, tables.csv and the plots; made if need be. Those of an
        earlier report in it are replaced.
    readme
        Markdown files whose tables are to be replaced: what is between the comments
        ``<!-- bench:NAME -->`` and ``<!-- /bench:NAME -->``, NAME being one-sided-blur-means,
        one-sided-blur-scenes, sharp or speed.
    metric
        Which number: v2.nonocc, v2.all, v2.disc, v3.bad_0_5, v3.bad_1, v3.bad_2, v3.bad_4,
        v3.invalid, v3.avgerr, v3.rms, v3.a50, v3.a90, v3.a95, v3.a99, d1 or epe.
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
        speed = read_speed(results)
        if speed is not None:
            others = {"output": output, "method": method, "suite": suite, "side": side}
            _report_speed(speed, readme, [name for name, value in others.items() if value])
            return
        told = read_results(results, suite=suite, side=side, methods=method)
        told.require_metric(metric)
        for document in readme:  # refused before anything is written
            render_document(document, told, metric=metric)
        written = [] if output is None else write_report(told, output, metric=metric)[-1:]
        for document in readme:
            fill_document(document, told, metric=metric)
    console = Console(highlight=False, width=None if sys.stdout.isatty() else _PIPED_WIDTH)
    console.print(_screen(mean_table(told, metric)))
    for line in (explain(told, metric), *(f"Wrote {path}" for path in (*written, *readme))):
        console.print(line, markup=False, soft_wrap=True)


def _report_speed(told: SpeedResults, readme: tuple[Path, ...], others: list[str]) -> None:
    if others:
        raise ValueError(f"{others[0]}: results of bench speed have no choice of it")
    for document in readme:
        fill_speed(document, told)
    console = Console(highlight=False, width=None if sys.stdout.isatty() else _PIPED_WIDTH)
    console.print(speed_screen(told))
    for document in readme:
        console.print(f"Wrote {document}", markup=False, soft_wrap=True)


def _screen(table: Table) -> Screen:
    """Return a table for the terminal, narrow headings over numbers."""
    screen = Screen(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    first, *others = table.header
    screen.add_column(first, overflow="fold")
    for heading in others:
        screen.add_column(heading.replace(" ", "\n"), justify="right")
    for name, *row in table.rows:
        texts = [Text(entry.text, "bold" if entry.best else "") for entry in row]
        screen.add_row(Text(name.text.replace(TRUE_BLUR, f"\n{TRUE_BLUR}")), *texts)
    return screen

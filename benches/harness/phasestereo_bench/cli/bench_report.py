"""``phasestereo bench report``: records -> tables, and a plot."""

# No `from __future__ import annotations`: the command line is made of these annotations.

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from phasestereo.cli.errors import refusals
from phasestereo_bench.cli.bench_tables import show
from phasestereo_bench.cli.parameters import Names
from phasestereo_bench.report import read_results
from phasestereo_bench.report.cells import KIND, METRICS
from phasestereo_bench.report.origin import explain, origin
from phasestereo_bench.report.plots import draw_means, save_plot
from phasestereo_bench.report.results import Results
from phasestereo_bench.report.sharp import sharp_tables
from phasestereo_bench.report.tables import cost_table, mean_table
from phasestereo_bench.store import read_store

_OPTIONS = {"metric", "method", "suite", "side", "output"}


def report(
    *results: Path,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    metric: str = "v2.nonocc",
    method: Names = (),
    suite: str | None = None,
    side: str | None = None,
) -> None:
    """Report on what ``bench middlebury`` left behind: tables, and a plot.

    Prints the means over the scenes. Other benchmarks print their tables again when their command
    is given again. For example:

    ```
    phasestereo bench report results.jsonl -o means.svg
    phasestereo bench report results.jsonl --metric v3.bad_2 --method paper opencv:sgbm
    ```

    Parameters
    ----------
    results
        Files of records. Of several records of one cell the last counts.
    output
        File for a plot of the means, .svg or .png.
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

        loaded = read_results(results, suite=suite, side=side, methods=method)
        loaded.require_metric(metric)

        if output is not None:
            save_plot(draw_means(loaded, metric), output)

    kinds = {record["kind"] for path in results for record in read_store(path)}
    rest = ", ".join(sorted(kinds - {KIND, "environment"}))
    further = [f"Left out, records of other benchmarks: {rest}"] if rest else []
    further += [] if output is None else [f"Wrote {output}"]
    show_results(loaded, metric, further)


def show_results(results: Results, metric: str, further: Sequence[str]) -> None:
    """Print tables, what they are and were made with, what failed, and further lines."""
    failed = [f"{c.place}, {c.degradation}, {c.method} failed: {c.error}" for c in results.failures]
    show(
        {
            METRICS[metric].label: mean_table(results, metric),
            **{title: table for title, (_, table) in sharp_tables(results).items()},
            "One pair, one thread": cost_table(results),
        },
        *(explain(results, metric), origin(results), *failed, *further),
    )

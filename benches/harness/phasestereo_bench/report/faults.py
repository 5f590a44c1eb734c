"""Faults of rigs: a table for each group of them, faults down and methods across."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from phasestereo_bench.report.cells import METRICS
from phasestereo_bench.report.origin import left_out
from phasestereo_bench.report.results import Results
from phasestereo_bench.report.tables import Entry, Table, figures, means
from phasestereo_bench.rigs import RIGS


def fault_table(results: Results, metric: str, *, group: str) -> Table:
    """Return faults of a group x methods: means over the scenes that all methods have."""
    rows = [
        (Entry(name), *figures(results.methods, values, METRICS[metric]))
        for name in results.degradations
        if RIGS[results.suite][name].group == group
        for values in [means(results, metric, (name,)).values]
    ]
    return Table(("fault", *results.methods), tuple(rows))


def explain_faults(results: Results, metric: str) -> str:
    """Say what the figures of `fault_table` are."""
    count = min(means(results, metric, (name,)).scenes for name in results.degradations)
    title = METRICS[metric].label

    return (
        f"{title[0].upper()}{title[1:]}: {METRICS[metric].better}. Means over {count} scenes, "
        f"{results.state}. Bold: the best.{left_out(results, metric)}"
    )


FAULT_TABLES: Mapping[str, tuple[str, Callable[[Results, str], Table]]] = {
    f"rigs-{fault.group}": (suite, partial(fault_table, group=fault.group))
    for suite, faults in RIGS.items()
    for fault in faults.values()
    if fault.group != "sharp"
}
"""The suites and the makers of the tables by the names of their markers."""

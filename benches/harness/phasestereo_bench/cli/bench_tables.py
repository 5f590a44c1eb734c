"""What ``phasestereo bench`` prints of its records."""

from __future__ import annotations

from statistics import mean
from typing import TYPE_CHECKING, Any, Literal

from rich import box
from rich.console import Group
from rich.table import Table
from rich.text import Text

from phasestereo_bench.blur import blur_table, explain_blur
from phasestereo_bench.methods import TRUE_BLUR
from phasestereo_bench.report.cells import read_cell
from phasestereo_bench.report.origin import made_with
from phasestereo_bench.report.sizes import SIZES, size_of, size_table
from phasestereo_bench.report.tables import MOST_COLUMNS
from phasestereo_bench.rigs import ALTERNATING
from phasestereo_bench.speed import explain_speed, memory_table, time_table

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from phasestereo_bench.blur import BlurResults
    from phasestereo_bench.report.tables import Table as Contents
    from phasestereo_bench.speed import SpeedResults

    Record = Mapping[str, Any]


def means_tables(records: Sequence[Record]) -> list[Table]:
    """Return a table of means for each size of the pairs, and one that compares these sizes."""
    by_size: dict[str, list[Record]] = {}
    for record in records:
        size = size_of(record["collection"]) or "Q"
        by_size.setdefault(size, []).append(record)

    tables = [
        _means_table(by_size[size], "" if size == "Q" else f" of {known.name} size")
        for size, known in SIZES.items()
        if size in by_size
    ]
    compared = size_table(map(read_cell, records))
    if compared is not None:
        tables.append(filled("The sizes of MiddEval3, sharp pairs", compared))
    return tables


def _means_table(records: Sequence[Record], of_size: str) -> Table:
    """Return means over the scenes: methods down, degradations across, or if many the other way."""
    scenes = {(record["collection"], record["scene"]) for record in records}
    title = "More than 1 px off, % of the non-occluded pixels, mean of"
    table = _table(f"{title} {len(scenes)} scenes{of_size}")

    degradations = list(dict.fromkeys(record["degradation"] for record in records))
    rows = {
        name: [_mean_bad([r for r in row if r["degradation"] == each]) for each in degradations]
        for name, row in _by_method(records).items()
    }

    # Rows and columns change places where that many columns do not fit the screen.
    across, down = degradations, list(rows.items())
    if len(degradations) > MOST_COLUMNS:
        table.columns[0].header = "degradation"
        across, down = (
            list(rows),
            [
                (each, [row[number] for row in rows.values()])
                for number, each in enumerate(degradations)
            ],
        )

    for heading in across:
        table.add_column(heading.replace(" ", "\n"), justify="right")
    for name, cells in down:
        table.add_row(name, *cells)

    if not all(map(_is_good, records)):
        table.caption = "* without the scenes on which the method failed"

    return table


def costs_table(records: Sequence[Record]) -> Table:
    """Return what a pair takes each method."""
    table = _table("One pair, on one thread")
    for heading in ("mean seconds", "peak MB"):
        table.add_column(heading, justify="right")

    for name, row in _by_method(records).items():
        done = list(filter(_is_good, row))
        peaks = [record["peak_bytes"] for record in done if record["peak_bytes"] is not None]
        seconds = f"{mean(record['seconds'] for record in done):.3f}" if done else "-"
        table.add_row(name, seconds, f"{max(peaks) / 1e6:.0f}" if peaks else "-")
    return table


def speed_screen(results: SpeedResults) -> Group:
    """Return times and memory, and what they are."""
    below = f"{explain_speed(results)} {made_with(results.environments.values())}"
    times = filled("Times: ours, and the rivals' divided by ours", time_table(results))
    memory = filled("Memory, MB", memory_table(results))
    return Group(times, "", memory, "", Text(below))


def blur_screen(results: BlurResults) -> Group:
    """Return how much of the blur was found, and what that is."""
    below = explain_blur(results)
    return Group(filled("Blur that was found", blur_table(results)), "", Text(below))


def name_of(record: Record) -> str:
    """Return the method's name, with its ending and the image that was degraded if not the left."""
    side = "" if record["side"] in ("left", ALTERNATING) else f"\n({record['side']} degraded)"
    return f"{record['method']}{TRUE_BLUR * record['true_blur']}{side}"


def filled(title: str, contents: Contents) -> Table:
    """Return a table of a report as the screen shows it."""
    table = _table(title, contents.header[0])

    for number, heading in enumerate(contents.header[1:], start=1):
        justify: Literal["left", "right"] = "left" if number < contents.labels else "right"
        table.add_column(heading.replace(" ", "\n", 1), justify=justify)

    for row in contents.rows:
        table.add_row(*(entry.text for entry in row))

    return table


def _table(title: str, first: str = "method") -> Table:
    table = Table(
        title=title,
        title_justify="left",
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        show_edge=False,
    )

    table.add_column(first, overflow="fold")
    return table


def _by_method(records: Sequence[Record]) -> dict[str, list[Record]]:
    rows: dict[str, list[Record]] = {}
    for record in records:
        rows.setdefault(name_of(record).replace(TRUE_BLUR, f"\n{TRUE_BLUR}"), []).append(record)
    return rows


def _mean_bad(records: Sequence[Record]) -> str:
    """Return the mean of the good records, with a mark if there are others."""
    bad = [record["v2"]["nonocc"] for record in records if _is_good(record)]
    known = [value for value in bad if value is not None]

    mark = "*" if len(bad) < len(records) else ""
    return (f"{mean(known):.1f}" if known else "-") + mark


def _is_good(record: Record) -> bool:
    return bool(record["status"] == "ok")

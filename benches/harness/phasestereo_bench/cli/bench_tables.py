"""What ``phasestereo bench`` prints of its records."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, Literal

from rich import box
from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from phasestereo_bench.blur import blur_table, explain_blur
from phasestereo_bench.report.origin import made_with
from phasestereo_bench.speed import explain_speed, memory_table, time_table

if TYPE_CHECKING:
    from collections.abc import Mapping

    from phasestereo_bench.blur import BlurResults
    from phasestereo_bench.report.tables import Table as Contents
    from phasestereo_bench.speed import SpeedResults

    Record = Mapping[str, Any]


_PIPED_WIDTH = 200


def screen() -> Console:
    """Return the terminal, or what is as wide as any table where output is piped."""
    return Console(highlight=False, width=None if sys.stdout.isatty() else _PIPED_WIDTH)


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


def filled(title: str, contents: Contents) -> Table:
    """Return a table of a report as the screen shows it."""
    table = Table(
        title=title,
        title_justify="left",
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        show_edge=False,
    )
    table.add_column(contents.header[0], overflow="fold")

    for number, heading in enumerate(contents.header[1:], start=1):
        justify: Literal["left", "right"] = "left" if number < contents.labels else "right"
        table.add_column(heading.replace(" ", "\n", 1), justify=justify)

    for row in contents.rows:
        table.add_row(*(Text(entry.text, "bold" if entry.best else "") for entry in row))

    return table

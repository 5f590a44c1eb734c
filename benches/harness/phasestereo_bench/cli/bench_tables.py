"""What ``phasestereo bench`` prints of its records."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Literal

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from phasestereo_bench.report.tables import Table as Contents

_PIPED_WIDTH = 200


def screen() -> Console:
    """Return the terminal, or what is as wide as any table where output is piped."""
    return Console(highlight=False, width=None if sys.stdout.isatty() else _PIPED_WIDTH)


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

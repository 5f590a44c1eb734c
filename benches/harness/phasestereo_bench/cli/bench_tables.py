"""Prints the tables of ``phasestereo bench`` from its records."""

import sys
from collections.abc import Mapping
from typing import Literal

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from phasestereo.cli.terminal import printable
from phasestereo_bench.report.tables import Table as Contents

_PIPED_WIDTH = 200


def show(tables: Mapping[str, Contents | None], *lines: str) -> None:
    """Print the available tables by their titles, and lines below them.

    If output is piped, a line is as wide as any table.
    """
    console = Console(highlight=False, width=None if sys.stdout.isatty() else _PIPED_WIDTH)
    for title, contents in tables.items():
        if contents is not None:
            console.print(_filled(title, contents))
    for line in lines:
        console.print(printable(line), markup=False, soft_wrap=True)


def _filled(title: str, contents: Contents) -> Table:
    table = Table(
        title=title,
        title_justify="left",
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        show_edge=False,
    )
    for number, heading in enumerate(contents.header):
        justify: Literal["left", "right"] = "left" if number < contents.labels else "right"
        words = heading.replace(" ", "\n", 1) if number else heading
        table.add_column(words, justify=justify, overflow="fold" if not number else "ellipsis")

    for row in contents.rows:
        table.add_row(*(Text(entry.text, "bold" if entry.best else "") for entry in row))

    return table

"""The output of a run, and its progress on a terminal."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn


def printable(text: object) -> str:
    """Return a text with only printable characters; escape the others.

    File names may hold characters that move the cursor, hide lines or type into the terminal.
    """
    return "".join(
        each if each.isprintable() else each.encode("unicode_escape").decode("ascii")
        for each in str(text)
    )


def print_json(record: object) -> None:
    """Print an object as JSON on standard output."""
    sys.stdout.write(json.dumps(record, indent=2, allow_nan=False) + "\n")


def print_lines(lines: Iterable[str]) -> None:
    """Print lines on standard output."""
    sys.stdout.writelines(f"{printable(line)}\n" for line in lines)


def say(line: str) -> None:
    """Print a line on standard error."""
    sys.stderr.write(f"phasestereo: {printable(line)}\n")


@contextmanager
def progress_bar(task: str) -> Iterator[Callable[[int, int], None] | None]:
    """Show a bar on standard error during the block, if standard error is a terminal.

    Yields
    ------
    callable or None
        Call it as ``progress(done, total)``; None without a terminal.
    """
    if not sys.stderr.isatty():
        yield None
        return

    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn()
    with Progress(
        *columns, TimeRemainingColumn(), console=Console(stderr=True), transient=True
    ) as bar:
        number = bar.add_task(task, total=None)
        yield lambda done, total: bar.update(number, completed=done, total=total)

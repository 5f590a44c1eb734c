"""Reads and appends files of results: an environment, then records, one JSON object a line."""

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from phasestereo_large.records import Appender, decode, read_lines

Record = dict[str, Any]

_CELL = (
    *("kind", "row", "recording", "frame", "rectified", "pair", "preset", "threads", "seed"),
    *("suite", "collection", "scene", "degradation", "side", "method"),
    *("family", "size", "angle", "noise"),
)
"""The fields that identify a record of any kind."""


def read_store(path: str | os.PathLike[str]) -> list[dict[str, Any]]:
    """Read all lines of a store: environments and records, in order of their writing.

    A cell that failed and ran again has several records; the last one counts. If the end of a run
    cut the last line, it is left out.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is not a store, or damaged before its last line; the message names the line.
    """
    lines = []
    for number, line in read_lines(Path(path)):
        record = decode(line)
        # The first line of a store distinguishes it from files that must not be touched.
        if number == 1 and (record is None or record.get("kind") != "environment"):
            raise ValueError(f"{path}: not a file of benchmark results")
        if record is None:
            raise ValueError(f"{path}: line {number} is not a JSON object")
        lines.append(record)
    return lines


def read_good(path: str | os.PathLike[str]) -> tuple[list[Record], list[Record]]:
    """Return the good records of a store, the last of each cell, and their environments.

    Raises
    ------
    OSError, ValueError
        As `read_store`.
    """
    lines = read_store(path)
    good = {
        tuple(str(line.get(name)) for name in _CELL): line
        for line in lines
        if line.get("status") == "ok"
    }
    ran = {line["environment"] for line in good.values()}
    return list(good.values()), [line for line in lines if line.get("id") in ran]


@contextmanager
def appending(
    path: str | os.PathLike[str],
) -> Iterator[tuple[list[dict[str, Any]], Callable[[Mapping[str, Any]], None]]]:
    """Open a store to continue it, or begin one.

    Yields
    ------
    lines
        The lines that it holds, as `read_store` returns them.
    append
        A function that writes one more line; the line is in the file when the call returns.

    Raises
    ------
    OSError
        If the file cannot be read or written.
    ValueError
        As `read_store`.
    """
    lines = read_store(path) if Path(path).exists() else []
    with closing(Appender(Path(path))) as appender:
        yield lines, appender.add

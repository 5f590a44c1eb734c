"""Files of results: an environment, then records, one JSON object a line; appended to."""

from __future__ import annotations

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
"""The fields that identify a record, of whatever kind it is."""


def read_store(path: str | os.PathLike[str]) -> list[dict[str, Any]]:
    """Read all lines of a store: environments and records, in order of their writing.

    A cell that failed and was tried again has several records, the last of which counts. A last
    line which the end of a run has torn is left out.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is not a store, or damaged other than in its last line; the message names the line.
    """
    lines = []
    for number, line in read_lines(Path(path)):
        record = decode(line)
        # What a store begins with distinguishes it from files that must not be touched.
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
    """Open a store to go on with it, or begin one.

    Yields
    ------
    lines
        Those it holds, as of `read_store`.
    append
        Writes one more; it is in the file when the call returns.

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

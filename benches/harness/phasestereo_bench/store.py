"""Files of records, one JSON object a line: appended to, never rewritten, sound after any end."""

from __future__ import annotations

import json
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterator, Mapping

_OPENING = '{"kind": "environment"'
"""What every store begins with, which distinguishes it from files that must not be touched."""


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
    return _parse(Path(path), Path(path).read_bytes())[0]


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
    target = Path(path)
    content = target.read_bytes() if target.exists() else b""
    lines, whole = _parse(target, content)

    with target.open("ab", buffering=0) as file:
        file.truncate(whole)
        if content[:whole] and not content[:whole].endswith(b"\n"):
            file.write(b"\n")  # an editor took the last one away

        def append(line: Mapping[str, Any]) -> None:
            file.write(json.dumps(line, allow_nan=False).encode() + b"\n")

        yield lines, append


def _parse(path: Path, content: bytes) -> tuple[list[dict[str, Any]], int]:
    """Return the lines, and of how many bytes they consist without a torn last one."""
    lines: list[dict[str, Any]] = []
    whole = 0
    for number, raw in enumerate(content.splitlines(keepends=True), start=1):
        line = _line(raw)
        if number == 1 and not _begins(raw):
            raise ValueError(f"{path}: not a file of benchmark results")
        if line is None and whole + len(raw) < len(content):
            raise ValueError(f"{path}: line {number} is no JSON object")
        if line is not None:
            lines.append(line)
            whole += len(raw)

    return lines, whole


def _line(raw: bytes) -> dict[str, Any] | None:
    try:
        line = json.loads(raw)
    except ValueError:
        return None
    return line if isinstance(line, dict) else None


def _begins(raw: bytes) -> bool:
    """Return whether a file's first line is that of a store, or the beginning of one."""
    opening = _OPENING.encode()
    return opening.startswith(raw[: len(opening)])

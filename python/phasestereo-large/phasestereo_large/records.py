"""Append records to files, one JSON object per line, that survive any end of a process.

A record is in its file when `Appender.add` returns. If the end of a process tears a line, only
that line is lost: readers leave it out, and the next appender cuts it off.
"""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from functools import cache, partial
from itertools import repeat
from pathlib import Path
from types import MappingProxyType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from phasestereo.io.files import decoding

_LONGEST = 2**20  # bytes of a line
_MOST = 2**24  # lines

_hints = cache(get_type_hints)


def read_lines(path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield the lines of a file with their numbers from 1, except a torn last one.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it has too long a line, or too many lines.
    """
    with decoding(path) as file:
        for number in range(1, _MOST + 1):
            line = file.readline(_LONGEST)
            if len(line) == _LONGEST:
                raise ValueError(
                    f"line {number} has {_LONGEST} bytes or more: not a file of records"
                )
            is_torn = _is_torn(line) and (number > 1 or line.startswith(b"{"))
            if not line or is_torn:  # a first line with another beginning is from another program
                return
            yield number, line.rstrip(b"\r\n")
    raise ValueError(f"{path}: has more than {_MOST} lines: not a file of records")


class Appender:
    """Appends records to a file, and makes it if it does not exist.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    OSError
        If it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = path.open("ab", buffering=0)

        last = _last_line(path)
        if _is_torn(last):
            self._file.truncate(path.stat().st_size - len(last))
        elif last and not last.endswith(b"\n"):  # an editor may leave it like this
            self._file.write(b"\n")

    def add(self, record: Mapping[str, Any]) -> None:
        """Append a record.

        Raises
        ------
        OSError
            If the disk is full.
        """
        line = encode(record)
        if self._file.write(line) < len(line):  # else the next record would continue a torn line
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._path))

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def encode(record: Mapping[str, Any]) -> bytes:
    """Return a record as a line of JSON."""
    return json.dumps(record, allow_nan=False).encode() + b"\n"


def decode(line: bytes) -> dict[str, Any] | None:
    """Return the record of a line, or None if it is invalid."""
    try:
        record = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return record if isinstance(record, dict) else None


def decoded(  # noqa: C901, PLR0911 -- a step for each kind of type
    kind: Any,
    value: Any,
    name: str = "record",
    arrays: Mapping[str, NDArray[Any]] = MappingProxyType({}),
    others: Mapping[Any, Mapping[str, Any]] = MappingProxyType({}),
) -> Any:
    """Convert a JSON value to a type: a dataclass with exactly its fields.

    Parameters
    ----------
    kind
        The type: a dataclass, or a possible type of a field.
    value
        The value.
    name
        Its name in messages.
    arrays
        The arrays, under the names that replace them in the value.
    others
        Types of some fields of dataclasses, in place of the declared ones.

    Raises
    ------
    ValueError
        If it does not have this type; the message begins with the name.
    """
    origin, members = get_origin(kind), get_args(kind)
    again = partial(decoded, arrays=arrays, others=others)
    if origin in (Union, UnionType):
        return None if value is None else again(members[0], value, name)

    if origin is tuple and isinstance(value, list):
        kinds = members[:1] * len(value) if members[-1] is ... else members
        if len(kinds) == len(value):
            return tuple(map(again, kinds, value, repeat(name)))
    if origin is dict and isinstance(value, dict):
        return {key: again(members[1], each, name) for key, each in value.items()}

    if is_dataclass(kind) and isinstance(value, dict):
        make: Any = kind
        hints = {**_hints(make), **others.get(kind, {})}
        if value.keys() == hints.keys():
            return make(**{each: again(hints[each], value[each], each) for each in hints})

    array = arrays.get(value) if origin is np.ndarray and isinstance(value, str) else None
    if array is not None and (array.dtype,) == get_args(members[1]):
        return array
    if origin is Literal and isinstance(value, str) and value in members:
        return value
    if kind is float and type(value) in (int, float):
        return float(value)
    if type(value) is kind:
        return value
    accepts = getattr(kind, "__name__", "") if not members else str(kind)
    raise ValueError(f"{name}: got {value!r:.60}; accepts {accepts}")


def check_ranges(ranges: Mapping[str, bool]) -> None:
    """Refuse a value out of its range: the first name with the value False.

    Raises
    ------
    ValueError
        If one is False.
    """
    for name, is_right in ranges.items():
        if not is_right:
            raise ValueError(f"{name}: got what is out of its range")


def _is_torn(line: bytes) -> bool:
    return bool(line) and not line.endswith(b"\n") and decode(line) is None


def _last_line(path: Path) -> bytes:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _LONGEST))
        return file.read().splitlines(keepends=True)[-1] if path.stat().st_size else b""

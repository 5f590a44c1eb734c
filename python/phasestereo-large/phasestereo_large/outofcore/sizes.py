"""Convert sizes of memory and storage between words and numbers of bytes."""

from __future__ import annotations

import re

_POWERS = {"": 0, "k": 1, "m": 2, "g": 3, "t": 4}
_SIZE = re.compile(r"\s*(\d+(?:\.\d+)?)\s*([kmgt]?)(i?)b?\s*", re.IGNORECASE)
_ACCEPTED = "a number of bytes, or one with a unit: 800MB, 2GB, 1.5GiB"


def as_bytes(size: int | str, name: str) -> int:
    """Return the number of bytes that a size means: a MB has 10^6, a MiB 2^20.

    Raises
    ------
    TypeError
        If it is neither an integer nor a string.
    ValueError
        If it is not a size, or less than one byte; the message names the argument.
    """
    if isinstance(size, bool) or not isinstance(size, int | str):
        raise TypeError(f"{name}: got {type(size).__name__}; accepts {_ACCEPTED}")

    found = _SIZE.fullmatch(str(size))
    if not found:
        raise ValueError(f"{name}: got {size!r}; accepts {_ACCEPTED}")

    number, unit, binary = found.groups()
    count = int(float(number) * (1024 if binary else 1000) ** _POWERS[unit.lower()])

    if count < 1:
        raise ValueError(f"{name}: got {size!r}; accepts 1 byte or more")
    return count


def format_bytes(count: int) -> str:
    """Return a number of bytes in words, with the last digit rounded up to suffice."""
    for unit, size in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if count >= size:
            tenths = -(-count * 10 // size)
            return f"{tenths / 10:g} {unit}" if tenths < 1000 else f"{-(-count // size)} {unit}"
    return f"{count} bytes"

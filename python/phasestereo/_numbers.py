"""Whole numbers as arguments: refused by name if they are none, or out of range."""

from __future__ import annotations

from numbers import Integral


def as_integer(
    name: str, value: object, *, least: int | None = None, most: int | None = None
) -> int:
    """Return an argument as a plain integer.

    Parameters
    ----------
    name
        What messages call it.
    value
        The argument: an integer of Python or NumPy, and no bool.
    least, most
        The smallest and the largest one that is accepted; None: any. There is no `most` alone.

    Raises
    ------
    TypeError
        If it is no integer.
    ValueError
        If it is out of range.
    """
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"{name}: got {type(value).__name__}; accepts an integer")
    number = int(value)
    if least is not None and (number < least or (most is not None and number > most)):
        end = "or more" if most is None else f"to {most}"
        raise ValueError(f"{name}: got {number}; accepts {least} {end}")
    return number

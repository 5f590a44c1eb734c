"""Number arguments: invalid or out-of-range ones are refused by name. Also numbers for JSON."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from numbers import Integral, Real
from typing import Any

import numpy as np

_PRINTED_BITS = 64


def accept(name: str, value: object, known: Collection[str]) -> None:
    """Refuse an argument that is not one of the known words.

    Raises
    ------
    ValueError
        If it is not.
    """
    if value not in known:
        raise ValueError(f"{name}: got {value!r}; accepts {', '.join(map(repr, known))}")


def as_integer(
    name: str, value: object, *, least: int | None = None, most: int | None = None
) -> int:
    """Return an argument as a plain integer.

    Parameters
    ----------
    name
        The name that messages use.
    value
        The argument: an integer of Python or NumPy, not a bool.
    least, most
        The smallest and the largest accepted value; None: any. `most` needs `least`.

    Raises
    ------
    TypeError
        If it is not an integer.
    ValueError
        If it is out of range.
    """
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"{name}: got {type(value).__name__}; accepts an integer")
    number = int(value)

    if least is not None and (number < least or (most is not None and number > most)):
        end = "or more" if most is None else f"to {most}"
        # Python may refuse to print a huge integer: `sys.set_int_max_str_digits`.
        got = number if number.bit_length() <= _PRINTED_BITS else "a huge integer"
        raise ValueError(f"{name}: got {got}; accepts {least} {end}")
    return number


def as_number(
    name: str,
    value: object,
    *,
    least: float | None = None,
    most: float | None = None,
    positive: bool = False,
) -> float:
    """Return an argument as a plain, finite number.

    Parameters
    ----------
    name
        The name that messages use.
    value
        The argument: a real number of Python or NumPy, not a bool.
    least, most
        The smallest and the largest accepted value; None: any. `most` needs `least`.
    positive
        Whether it must be above 0.

    Raises
    ------
    TypeError
        If it is not a number.
    ValueError
        If it is NaN, infinite or out of range.
    """
    if not isinstance(value, Real) or isinstance(value, bool):
        raise TypeError(f"{name}: got {type(value).__name__}; accepts a number")
    try:
        number = float(value)
    except OverflowError:  # also for an integer that Python may refuse to print
        number, value = math.inf, "a huge number"

    is_low = (positive and number <= 0) or (least is not None and number < least)
    if is_low or not math.isfinite(number) or (most is not None and number > most):
        kind = "a positive, finite number" if positive else "a finite number"
        end = "or more" if most is None else f"to {most:g}"
        span = "" if least is None else f", {least:g} {end}"
        raise ValueError(f"{name}: got {value}; accepts {kind}{span}")
    return number


def check_type(name: str, value: object, kind: Any, accepts: str) -> None:
    """Refuse an argument of the wrong type by its name.

    Raises
    ------
    TypeError
        If it is not an instance of the type, or of one of the types.
    """
    if not isinstance(value, kind):
        raise TypeError(f"{name}: got {type(value).__name__}; accepts {accepts}")


def check_callable(name: str, value: object) -> None:
    """Refuse an argument that is neither callable nor None.

    Raises
    ------
    TypeError
        If it is something else.
    """
    check_type(name, value, (Callable, type(None)), "a callable or None")


def as_json(value: Any) -> Any:
    """Return nested records for JSON: None for non-finite numbers, lists for tuples."""
    match value:
        case np.generic():
            return as_json(value.item())
        case Mapping():
            return {name: as_json(inner) for name, inner in value.items()}
        case list() | tuple():
            return [as_json(inner) for inner in value]
        case float() if not math.isfinite(value):
            return None
    return value

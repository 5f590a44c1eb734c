"""The fields of `Settings` as options: their names, types and help are those of the class.

But for the defaults: the class has those of one preset, and ``--preset`` may name another.
"""

from __future__ import annotations

import re
from inspect import cleandoc
from types import UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    TypedDict,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from cyclopts import Parameter

from phasestereo.settings import Settings

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cyclopts import Token

    Overrides = dict[str, Any]
    """The fields that were given, by name."""


def _numbers(_hint: Any, tokens: Sequence[Token]) -> float | tuple[float, ...]:
    """Read ``2`` as a number and ``0.5,2`` as a pair of them."""
    word = tokens[0].value
    try:
        values = tuple(float(part) for part in word.split(","))
    except ValueError:
        raise ValueError(f"got {word}; accepts a number, or a pair as one word: 0.5,2") from None
    return values if len(values) > 1 else values[0]


def _whole_numbers(_hint: Any, tokens: Sequence[Token]) -> tuple[int, ...]:
    """Read ``3,2,1`` as three numbers."""
    word = tokens[0].value
    try:
        return tuple(int(part) for part in word.split(","))
    except ValueError:
        raise ValueError(f"got {word}; accepts whole numbers as one word: 3,2,1") from None


def _count(_hint: Any, tokens: Sequence[Token]) -> int | None:
    """Read ``auto`` as None, and a number as itself."""
    word = tokens[0].value
    if word == "auto":
        return None
    try:
        return int(word)
    except ValueError:
        raise ValueError(f"got {word}; accepts a whole number, or auto") from None


Count = Annotated[int | None, Parameter(converter=_count, n_tokens=1)]
"""A number of disparities, or ``auto``."""

Bands = Annotated[tuple[int, ...], Parameter(converter=_whole_numbers, n_tokens=1)]
"""Whole numbers within one word of the command line."""


def _as_option(hint: Any) -> Any:
    """Return the type hint of a field as an option takes it.

    One number or else a pair can only be told apart within one word of the command line.
    """
    return Annotated[float, Parameter(converter=_numbers)] if _may_be_pair(hint) else hint


def _may_be_pair(hint: Any) -> bool:
    kinds = get_args(hint) if get_origin(hint) in (Union, UnionType) else ()
    return float in kinds and any(get_origin(kind) is tuple for kind in kinds)


PAIRS = frozenset(name for name, hint in get_type_hints(Settings).items() if _may_be_pair(hint))
"""Fields that are a number or a pair of them."""


if not TYPE_CHECKING:
    # One key a field, none of them required: those that were given are the overrides.
    Overrides = TypedDict(
        "Overrides",
        {name: _as_option(hint) for name, hint in get_type_hints(Settings).items()},
        total=False,
    )
    Overrides.__doc__ = re.sub(
        r"Default\s+.+?\.$",
        "Default: by the preset.",
        cleandoc(Settings.__doc__),
        flags=re.MULTILINE,
    )

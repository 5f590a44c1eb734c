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
    values = tuple(float(part) for part in tokens[0].value.split(","))
    return values if len(values) > 1 else values[0]


def _whole_numbers(_hint: Any, tokens: Sequence[Token]) -> tuple[int, ...]:
    """Read ``3,2,1`` as three numbers."""
    return tuple(int(part) for part in tokens[0].value.split(","))


def _count(_hint: Any, tokens: Sequence[Token]) -> int | None:
    """Read ``auto`` as None, and a number as itself."""
    word = tokens[0].value
    return None if word == "auto" else int(word)


Count = Annotated[int | None, Parameter(converter=_count, n_tokens=1)]
"""A number of disparities, or ``auto``."""

Bands = Annotated[tuple[int, ...], Parameter(converter=_whole_numbers, n_tokens=1)]
"""Whole numbers within one word of the command line."""


def _as_option(hint: Any) -> Any:
    """Return the type hint of a field as an option takes it.

    One number or else a pair can only be told apart within one word of the command line.
    """
    kinds = get_args(hint) if get_origin(hint) in (Union, UnionType) else ()
    if float in kinds and any(get_origin(kind) is tuple for kind in kinds):
        return Annotated[float, Parameter(converter=_numbers)]
    return hint


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

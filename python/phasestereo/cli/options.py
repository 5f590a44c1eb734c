"""The fields of `Settings` as options, with the core's descriptions.

They show no defaults: the class has those of one preset, and ``--preset`` may name another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Annotated, Any, TypedDict, get_type_hints

from cyclopts import Parameter, Token, validators

from phasestereo import _core
from phasestereo.settings import PRESETS, Settings


def as_word(read: Callable[[str], Any], accepted: str) -> Parameter:
    """Return a parameter that reads one word of the command line.

    Parameters
    ----------
    read
        Turns the word into the value; a ValueError refuses it.
    accepted
        The accepted words, for the error message.
    """

    def convert(_hint: Any, tokens: Sequence[Token]) -> Any:
        word = tokens[0].value
        try:
            return read(word)
        except ValueError:
            raise ValueError(f"got {word}; accepts {accepted}") from None

    return Parameter(converter=convert, n_tokens=1)


AT_LEAST_ONE = validators.Number(gte=1, lt=2**31)
POSITIVE = validators.Number(gt=0)
NOT_NEGATIVE = validators.Number(gte=0, lt=2**31)
REASONABLE = validators.Number(gte=-(2**31), lt=2**31)

Count = Annotated[
    int | None,
    as_word(lambda word: None if word == "auto" else int(word), "a whole number, or auto"),
]
"""A number of disparities, or ``auto``."""

Bands = Annotated[
    tuple[int, ...],
    as_word(lambda word: tuple(map(int, word.split(","))), "whole numbers as one word: 3,2,1"),
]
"""Whole numbers in one word of the command line."""

Threads = Annotated[int | None, Parameter(validator=AT_LEAST_ONE)]
"""A number of threads; the core refuses too many."""

PRESET_HELP = f"Settings to start from: {', '.join(PRESETS)}."
SETTINGS_HELP = "Each takes the place of the preset's."


def _help(setting: _core.Setting) -> str:
    """Return the core's description of a setting and its values in the presets, in Markdown."""
    listed = [f'- `"{word}"`: {meaning}' for word, meaning in setting.choices]
    usual, *others = ((name, getattr(PRESETS[name], setting.name)) for name in PRESETS)
    names: dict[str, list[str]] = {}
    for name, value in others:
        if value != usual[1]:
            names.setdefault(_word(value), []).append(name)
    differ = [f"{word} with {' and '.join(presets)}" for word, presets in names.items()]
    default = "; ".join([f"Default: {_word(usual[1])}", *differ])
    return "\n".join([f"{setting.text} {default}.", "", *listed])


def _word(value: object) -> str:
    """Return a value in the command line's form."""
    if isinstance(value, tuple):
        return " ".join(map(str, value))
    return "none" if value is None else str(value)


if TYPE_CHECKING:
    Overrides = dict[str, Any]
    """The fields that were given, by name."""
else:
    # One optional key per field: the given keys are the overrides.
    _TYPES = get_type_hints(Settings)
    Overrides = TypedDict(
        "Overrides",
        {
            setting.name: Annotated[_TYPES[setting.name], Parameter(help=_help(setting))]
            for setting in _core.SETTINGS
        },
        total=False,
    )

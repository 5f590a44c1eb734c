"""Commands of a distribution that is not installed: they say which it is."""

# No `from __future__ import annotations`: the command line is made of these annotations.

from collections.abc import Callable
from typing import Annotated

from cyclopts import Parameter

from phasestereo.cli.errors import CommandError

_ANYTHING = Parameter(allow_leading_hyphen=True, show=False)


def missing(requirement: str) -> Callable[..., None]:
    """Return a command that refuses, whatever follows it, and says what pip is to install."""

    def refuse(*_: Annotated[str, _ANYTHING]) -> None:
        raise CommandError(
            f"this command is not installed; it comes with: pip install {requirement}"
        )

    return refuse

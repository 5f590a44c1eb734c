"""Commands of a distribution that is not installed: they say which it is."""

# No `from __future__ import annotations`: the command line is made of these annotations.

from typing import Annotated

from cyclopts import Parameter

from phasestereo.cli.errors import CommandError

_ANYTHING = Parameter(allow_leading_hyphen=True, show=False)


def missing(*_: Annotated[str, _ANYTHING]) -> None:
    """Refuse, whatever follows the command, and say what installs it."""
    raise CommandError(
        "this command is not installed; it comes with: pip install phasestereo-bench"
    )

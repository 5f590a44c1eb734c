"""Reports on a match, or a pair, that is not reliable."""

from __future__ import annotations

from collections.abc import Iterable

from phasestereo.cli.errors import UNTRUSTED, CommandError
from phasestereo.cli.terminal import say
from phasestereo.rig.findings import Finding, untrusted


def show_findings(found: Iterable[Finding]) -> None:
    """Print a line for each on standard error."""
    for one in found:
        say(f"{one.severity}: {one.sentence}")


def refuse_warnings(found: Iterable[Finding]) -> None:
    """End with the exit code of what is not to be trusted, and with the first warning, if any.

    Raises
    ------
    CommandError
        If there is one.
    """
    for one in found:
        if one.severity == "warning":
            raise CommandError(one.sentence, UNTRUSTED)


def refuse_untrusted(found: Iterable[Finding]) -> None:
    """End with the exit code of what is not to be trusted, if anything says so.

    Raises
    ------
    CommandError
        If so.
    """
    grave = untrusted(found)
    if grave:
        raise CommandError("not to be trusted, for what the warnings say", UNTRUSTED)

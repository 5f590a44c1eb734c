"""What was found out about a pair or about its match, in plain words: the core's sentences."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

from phasestereo._core import DECISIVE_TOPICS

Severity = Literal["ok", "note", "warning"]


class MatchWarning(UserWarning):
    """A match as a whole is not to be trusted: what `phasestereo.match` warns of.

    Examples
    --------
    >>> import warnings
    >>> warnings.simplefilter("error", ps.MatchWarning)  # unreliable matches raise
    """


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that there is to say about a pair, or about a match.

    Parameters
    ----------
    topic
        "match", "swap", "range", "alignment", "blur", "contrast", "noise", "coding", "saturation",
        "texture", "repetition", "interlacing", "border", or "map" of a map that was verified, or of
        a second one.
    severity
        "ok", "note" (worth knowing) or "warning" (to be fixed).
    sentence
        Plain words, with numbers.

    Examples
    --------
    >>> for found in ps.match(left, right).findings:
    ...     print(found.severity, found.sentence)
    """

    topic: str
    severity: Severity
    sentence: str


def untrusted(found: Iterable[Finding]) -> list[Finding]:
    """Return those for which a match as a whole is not to be trusted."""
    return [one for one in found if one.severity == "warning" and one.topic in DECISIVE_TOPICS]


def warn(found: tuple[Finding, ...]) -> None:
    """Warn of a match that is not to be trusted as a whole."""
    grave = [one.sentence for one in untrusted(found)]
    if grave:
        warnings.warn("; ".join(grave), MatchWarning, stacklevel=3)


@contextmanager
def unwarned() -> Iterator[None]:
    """Ignore the warnings of matches in this block: findings report them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MatchWarning)
        yield

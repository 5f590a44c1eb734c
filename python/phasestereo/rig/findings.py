"""Findings about a pair or its match, in plain words: the core's sentences."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

from phasestereo._core import DECISIVE_TOPICS, NO_DEPTH

Severity = Literal["ok", "note", "warning"]


class MatchWarning(UserWarning):
    """The warning of `phasestereo.match` that a match as a whole is not to be trusted.

    Examples
    --------
    >>> import warnings
    >>> warnings.simplefilter("error", ps.MatchWarning)  # unreliable matches raise
    """


@dataclass(frozen=True, slots=True)
class Finding:
    """One fact about a pair, or about a match.

    Parameters
    ----------
    topic
        "match", "swap", "range", "alignment", "blur", "contrast", "noise", "coding", "saturation",
        "texture", "repetition", "interlacing", "border", or "map" for a verified map or a second
        one.
    severity
        "ok", "note" (worth knowing) or "warning" (to be fixed).
    sentence
        A plain sentence with numbers.

    Examples
    --------
    >>> for found in ps.match(left, right).findings:
    ...     print(found.severity, found.sentence)
    """

    topic: str
    severity: Severity
    sentence: str


def untrusted(found: Iterable[Finding]) -> list[Finding]:
    """Return the findings that distrust the match as a whole."""
    return [one for one in found if one.severity == "warning" and one.topic in DECISIVE_TOPICS]


def denies_depths(found: Iterable[Finding]) -> bool:
    """Return whether a finding says that disparities of the pair are not a depth."""
    return any(NO_DEPTH in one.sentence for one in found)


def warn(found: tuple[Finding, ...]) -> None:
    """Warn if the match as a whole is not to be trusted."""
    grave = [one.sentence for one in untrusted(found)]
    if grave:
        warnings.warn("; ".join(grave), MatchWarning, stacklevel=3)


@contextmanager
def unwarned() -> Iterator[None]:
    """Ignore the warnings of matches in this block: findings report them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MatchWarning)
        yield

"""Markdown: tables as text, and the places in a document that are kept up to date by them.

A document marks such a place by two comments, ``<!-- bench:NAME -->`` and ``<!-- /bench:NAME -->``.
What is between them is replaced, so that no figure is ever typed.
"""

from __future__ import annotations

import re
from html import escape
from itertools import zip_longest
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from phasestereo_bench.report.tables import Entry, Table

__all__ = ["fill_markers", "markdown_table", "markdown_text", "marked"]

_MARKER = re.compile(r"<!--[ \t]*(?P<end>/?)bench:(?P<name>.*?)[ \t]*-->")


def markdown_text(text: str) -> str:
    """Return text such that Markdown shows just that, in one line, in a table or out of one."""
    line = escape(" ".join(text.split()), quote=False)
    return re.sub(r"([\\`*_\[\]|])", r"\\\1", line)


def markdown_table(table: Table) -> str:
    """Return a table as Markdown, the best entries bold; no line end after the last row."""
    lines = [
        [markdown_text(heading) for heading in table.header],
        ["---"] * table.labels + ["---:"] * (len(table.header) - table.labels),
        *([_entry(entry) for entry in row] for row in table.rows),
    ]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def fill_markers(document: str, texts: Mapping[str, str], *, others: Collection[str] = ()) -> str:
    """Replace what is between the markers of a document.

    Parameters
    ----------
    document
        Markdown with at least one marker of a name in `texts`; a name may come more than once.
    texts
        What to put there, by name.
    others
        Names that are known, too, but whose places stay as they are.

    Returns
    -------
    str
        The document; filling it again with the same texts changes nothing.

    Raises
    ------
    ValueError
        If a marker has an unknown name or no counterpart, or there is none to be filled.
    """
    newline = "\r\n" if "\r\n" in document else "\n"
    parts, done = [], 0

    for start, end in _places(document, (*texts, *others)):
        if start["name"] in texts:
            text = texts[start["name"]].replace("\n", newline)
            # Markdown needs the empty lines: a comment would take the table for its own.
            parts += [document[done : start.end()], newline * 2, text, newline * 2]
            done = end.start()

    if not parts:
        names = ", ".join(f"<!-- bench:{name} -->" for name in texts)
        raise ValueError(f"no marker to fill; accepts {names}, each with its end")

    return "".join([*parts, document[done:]])


def marked(document: str) -> set[str]:
    """Return the names of the markers that a document has."""
    return {marker["name"] for marker in _MARKER.finditer(document)}


def _places(document: str, known: Collection[str]) -> list[tuple[re.Match[str], re.Match[str]]]:
    """Return the markers in pairs, each start with its end."""
    markers = list(_MARKER.finditer(document))
    for marker in markers:
        if marker["name"] not in known:
            raise ValueError(f"unknown marker {marker[0]}; accepts the names {', '.join(known)}")

    pairs = list(zip_longest(markers[::2], markers[1::2]))
    for start, end in pairs:
        if start["end"] or end is None or not end["end"] or end["name"] != start["name"]:
            what = "has no start" if start["end"] else "has no end"
            raise ValueError(f"marker {start[0]} {what}")

    return pairs


def _entry(entry: Entry) -> str:
    text = markdown_text(entry.text)
    return f"**{text}**" if entry.best else text

"""Writes tables as Markdown, and keeps the marked places of a document up to date.

A document marks such a place by two comments, ``<!-- bench:NAME -->`` and ``<!-- /bench:NAME -->``.
The harness replaces the text between them, so nobody ever types a figure.
"""

import re
from collections.abc import Mapping
from html import escape

from phasestereo_bench.report.tables import Entry, Table

_MARKER = re.compile(r"<!--[ \t]*/?bench:.*?-->")
_PLACE = re.compile(
    r"(?P<start><!--[ \t]*bench:(?P<name>\S+)[ \t]*-->)(?:(?!<!--[ \t]*/?bench:).)*"
    r"(?P<end><!--[ \t]*/bench:(?P=name)[ \t]*-->)",
    re.DOTALL,
)


def markdown_text(text: str) -> str:
    """Return text that Markdown shows as it is, in one line, inside or outside a table."""
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


def fill_markers(document: str, texts: Mapping[str, str]) -> str:
    """Replace the text between the markers of a document; markers with other names stay.

    Parameters
    ----------
    document
        Markdown with at least one marker whose name is in `texts`; a name may come more than once.
    texts
        The texts to insert, by name.

    Returns
    -------
    str
        The document; filling it again with the same texts changes nothing.

    Raises
    ------
    ValueError
        If a marker is missing its counterpart, or the document has no marker to fill.
    """
    newline = "\r\n" if "\r\n" in document else "\n"

    def filled(place: re.Match[str]) -> str:
        if place["name"] not in texts:
            return place[0]
        # Markdown needs the empty lines: without them a comment would swallow the table.
        text = texts[place["name"]].replace("\n", newline)
        return f"{place['start']}{newline * 2}{text}{newline * 2}{place['end']}"

    alone = _MARKER.search(_PLACE.sub("", document))
    if alone is not None:
        raise ValueError(f"marker {alone[0]} has no counterpart")
    if not texts.keys() & marked(document):
        names = ", ".join(f"<!-- bench:{name} -->" for name in texts)
        raise ValueError(f"no marker to fill; accepts {names}, each with its end")
    return _PLACE.sub(filled, document)


def marked(document: str) -> set[str]:
    """Return the names of the places in a document."""
    return {place["name"] for place in _PLACE.finditer(document)}


def _entry(entry: Entry) -> str:
    text = markdown_text(entry.text)
    return f"**{text}**" if entry.best else text

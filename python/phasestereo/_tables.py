"""Text tables for notebooks: HTML in the colors of the page."""

from __future__ import annotations

from collections.abc import Iterable

BLOCK = "max-width:980px;line-height:1.4;"
"""The style of all tables; inline, since untrusted notebooks drop any other."""

_TABLE = "border-collapse:collapse;margin:6px 0;"
_CELL = "text-align:left;vertical-align:top;padding:2px 16px 2px 0;"


def as_html(
    name: str,
    words: str,
    heads: tuple[str, ...],
    rows: Iterable[tuple[str, ...]],
    *,
    bold: str | None = None,
) -> str:
    """Return a table below a name and a caption; rows with the text ``bold`` are bold."""
    from html import escape  # noqa: PLC0415 - its entities would take 6 % of `import phasestereo`

    head = "".join(f'<th style="{_CELL}">{escape(text)}</th>' for text in heads)
    lines = [
        "".join(
            f'<td style="{_CELL}">{f"<b>{escape(text)}</b>" if bold in row else escape(text)}</td>'
            for text in row
        )
        for row in rows
    ]

    body = "".join(f"<tr>{line}</tr>" for line in (head, *lines))
    table = f'<table style="{_TABLE}">{body}</table>'
    return f'<div style="{BLOCK}"><b>phasestereo.{name}</b> {escape(words)}{table}</div>'

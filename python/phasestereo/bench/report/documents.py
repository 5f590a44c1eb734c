"""Documents: their tables, rendered from results between the markers that ask for them."""

from __future__ import annotations

from pathlib import Path
from textwrap import fill
from types import MappingProxyType
from typing import TYPE_CHECKING

from phasestereo.bench.report.markdown import fill_markers, markdown_table, markdown_text
from phasestereo.bench.report.origin import explain, origin
from phasestereo.bench.report.tables import mean_table, scene_table
from phasestereo.io.files import replacing

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Mapping

    from phasestereo.bench.report.results import Results
    from phasestereo.bench.report.tables import Table

    Maker = Callable[[Results, str], Table]

__all__ = ["MARKERS", "fill_document", "render_document"]

MARKERS: Mapping[str, tuple[str, Maker]] = MappingProxyType(
    {
        "one-sided-blur-means": ("one-sided-blur", mean_table),
        "one-sided-blur-scenes": ("one-sided-blur", scene_table),
        "sharp": ("sharp", scene_table),
    }
)
"""The names that markers can have: the suite whose results they show, and in which table."""

_WIDTH = 110


def fill_document(
    path: str | os.PathLike[str], results: Results, *, metric: str = "v2.nonocc"
) -> None:
    """Replace the tables between the markers of a document by those of these results.

    Places of other suites stay as they are. The file is replaced as a whole or not at all, and not
    touched if nothing changes.

    Parameters
    ----------
    path
        A Markdown file, with ``<!-- bench:NAME --><!-- /bench:NAME -->`` where a table is to be;
        the names are those of `MARKERS`.
    results
        What to show.
    metric
        Which number, a name in `METRICS`.

    Raises
    ------
    ValueError
        If a marker has an unknown name or no counterpart, if there is none for this suite, if the
        file is not UTF-8, or if there is no number of the metric.
    OSError
        If the file cannot be read or written.
    """
    document = render_document(path, results, metric=metric).encode()
    if document != Path(path).read_bytes():
        with replacing(path) as file:
            file.write(document)


def render_document(
    path: str | os.PathLike[str], results: Results, *, metric: str = "v2.nonocc"
) -> str:
    """Return what `fill_document` would write; parameters and errors are the same."""
    results.require_metric(metric)
    small_print = fill(
        markdown_text(f"{explain(results, metric)} {origin(results)}"),
        _WIDTH,
        break_on_hyphens=False,
    )
    texts = {
        name: f"{markdown_table(table(results, metric))}\n\n{small_print}"
        for name, (suite, table) in MARKERS.items()
        if suite == results.suite
    }
    try:
        document = Path(path).read_bytes().decode()
        return fill_markers(document, texts, others=[name for name in MARKERS if name not in texts])
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error

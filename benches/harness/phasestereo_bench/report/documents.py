"""Fills documents with tables of results, between the markers that ask for them."""

import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from textwrap import fill

from phasestereo.io.drafts import replacing
from phasestereo_bench.report.cells import METRIC
from phasestereo_bench.report.markdown import fill_markers, markdown_table, markdown_text
from phasestereo_bench.report.origin import explain, explain_faults
from phasestereo_bench.report.results import Results
from phasestereo_bench.report.sharp import explain_v2, explain_v3, two_table, v2_table, v3_table
from phasestereo_bench.report.tables import Table, fault_table, mean_table, scene_table
from phasestereo_bench.rigs import RIGS

Maker = Callable[[Results, str], Table]
Words = Callable[[Results, str], str]


MARKERS: Mapping[str, tuple[str, Maker, Words]] = {
    "one-sided-blur-means": ("one-sided-blur", mean_table, explain),
    "one-sided-blur-scenes": ("one-sided-blur", scene_table, explain),
    "sharp": ("sharp", scene_table, explain),
    "sharp-means": ("sharp", two_table, explain),
    "sharp-v2": ("sharp", v2_table, explain_v2),
    "sharp-v3": ("sharp", v3_table, explain_v3),
    **{
        f"rigs-{fault.group}": (suite, partial(fault_table, group=fault.group), explain_faults)
        for suite, faults in RIGS.items()
        for fault in faults.values()
        if fault.group != "sharp"
    },
}
"""The names that markers can have: the suite whose results they show, the table, and its footer."""

_WIDTH = 110


def fill_places(path: str | os.PathLike[str], texts: Mapping[str, str]) -> None:
    """Replace the text between ``<!-- bench:NAME -->`` and ``<!-- /bench:NAME -->`` in a document.

    Places with other names stay as they are. The file is replaced as a whole or not at all, and it
    is not touched if nothing changes.

    Parameters
    ----------
    path
        A Markdown file.
    texts
        The texts to insert, by name.

    Raises
    ------
    ValueError
        If a marker has no counterpart, a name is missing, or the file is not UTF-8.
    OSError
        If the file cannot be read or written.
    """
    content = Path(path).read_bytes()
    try:
        filled = fill_markers(content.decode(), texts).encode()
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    if filled != content:
        with replacing(path) as file:
            file.write(filled)


def small_print(text: str) -> str:
    """Return the text below a table as lines of Markdown."""
    return fill(markdown_text(text), _WIDTH, break_on_hyphens=False)


def document_texts(results: Results) -> dict[str, str]:
    """Return the tables of these results as Markdown, by the names of their markers.

    Raises
    ------
    ValueError
        If the results have no number of `METRIC`.
    """
    results.require_metric(METRIC)

    texts: dict[str, str] = {}
    for name, (suite, table, words) in MARKERS.items():
        if suite == results.suite:
            texts[name] = markdown_table(table(results, METRIC))
            # One page has all tables of faults, and explains them once.
            if words is not explain_faults or len(texts) == 1:
                texts[name] += f"\n\n{small_print(words(results, METRIC))}"
    return texts

"""The sizes of MiddEval3 side by side: quarter, half and full resolution of the training pairs.

The official figure counts errors in pixels of the full size: its bad-2.0 is bad-1.0 at half and
bad-0.5 at a quarter of that, as the evaluation's own programs say.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import fmean
from typing import NamedTuple

from phasestereo_bench.report.cells import METRICS, Cell
from phasestereo_bench.report.tables import MISSING, Entry, Table


class Size(NamedTuple):
    """One size of the pairs: what to call it, and its metric that is the official bad-2.0."""

    name: str
    official: str


SIZES = {
    "Q": Size("quarter", "v3.bad_0_5"),
    "H": Size("half", "v3.bad_1"),
    "F": Size("full", "v3.bad_2"),
}
"""The sizes by the last letter of the collection's name."""

_COLLECTIONS = {f"MiddEval3/training{letter}": letter for letter in SIZES}
_OWN = {
    "v3.bad_0_5": "bad-0.5",
    "v3.bad_1": "bad-1.0",
    "v3.bad_2": "bad-2.0",
    "v3.bad_4": "bad-4.0",
}
_HEADER = "size", "method", "scenes", "official bad-2.0", *_OWN.values(), "mean error", "seconds"


def size_table(cells: Iterable[Cell]) -> Table | None:
    """Return sizes and methods down, errors across; None if no cell is of half or full size.

    Means are over the scenes that all methods of a size have. Degraded pairs are left out.
    """
    groups: dict[str, dict[str, list[Cell]]] = {}
    for cell in cells:
        size = _COLLECTIONS.get(cell.place.collection)
        if size is not None and cell.degradation == "sharp" and cell.metrics:
            groups.setdefault(size, {}).setdefault(cell.method, []).append(cell)

    if not set(groups) - {"Q"}:
        return None
    rows = [row for size in SIZES if size in groups for row in _rows(SIZES[size], groups[size])]
    return Table(_HEADER, tuple(rows), labels=2)


def explain_sizes() -> str:
    """Say what the figures of `size_table` are."""
    return (
        "MiddEval3, non-occluded pixels, means over the scenes that all methods of a size have. "
        "Official: more than 2 px off in pixels of the full size, %. Bad-T in %, and the mean "
        "error, are in pixels of the images; less is better."
    )


def _rows(size: Size, methods: dict[str, list[Cell]]) -> list[tuple[Entry, ...]]:
    shared = set.intersection(*({cell.place for cell in cells} for cells in methods.values()))
    return [
        _row(size, method, [cell for cell in cells if cell.place in shared])
        for method, cells in methods.items()
    ]


def _row(size: Size, method: str, cells: Sequence[Cell]) -> tuple[Entry, ...]:
    def mean(metric: str) -> str:
        values = [cell.metrics[metric] for cell in cells if metric in cell.metrics]
        return METRICS[metric].format(fmean(values)) if values else MISSING

    seconds = [cell.seconds for cell in cells if cell.seconds is not None]
    texts = (
        size.name,
        method,
        str(len(cells)),
        *(mean(metric) for metric in (size.official, *_OWN, "v3.avgerr")),
        f"{fmean(seconds):.1f}" if seconds else MISSING,
    )
    return tuple(map(Entry, texts))

"""Makes tables of sharp pairs like those of the Middlebury evaluations, versions 2 and 3.

Version 2 ranked methods by the percentages of three regions of each of its scenes; version 3
measures how far disparities are off. Means are those of `tables`: over the scenes that all methods
have.

The sizes of MiddEval3 are side by side: quarter, half and full resolution of the training pairs.
The official figure counts errors in pixels of the full size: its bad-2.0 is bad-1.0 at half and
bad-0.5 at a quarter of that size, as the evaluation's own programs show.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from statistics import fmean
from typing import NamedTuple

from phasestereo_bench.report.cells import METRICS, Cell
from phasestereo_bench.report.results import Results
from phasestereo_bench.report.tables import MISSING, Entry, Table, figures, means, place_names

_V2_SCENES = ("scenes2001/tsukuba", "scenes2001/venus", "scenes2003/teddy", "scenes2003/cones")
_REGIONS = ("v2.nonocc", "v2.all", "v2.disc")
_V3 = {
    "v3.bad_0_5": "bad-0.5",
    "v3.bad_1": "bad-1.0",
    "v3.bad_2": "bad-2.0",
    "v3.bad_4": "bad-4.0",
    "v3.invalid": "missing",
    "v3.avgerr": "mean error",
    "v3.rms": "rms",
    "v3.a50": "A50",
    "v3.a90": "A90",
    "v3.a95": "A95",
    "v3.a99": "A99",
    "roc": "ROC area",
}


def sharp_tables(results: Results) -> dict[str, Table]:
    """Return the tables by title; no table for another suite."""
    if results.suite != "sharp":
        return {}
    tables = {
        "As in version 2 of the Middlebury evaluation": v2_table(results),
        "As in version 3": v3_table(results),
        "The sizes of version 3": size_table(results.cells.values()),
    }
    return {title: table for title, table in tables.items() if table and table.header[1:]}


def v2_table(results: Results, _metric: str = "") -> Table:
    """Return methods x regions of the scenes of version 2, and last the mean of all regions.

    Regions without any number are left out. Only methods with all other regions have a mean.
    """
    chosen = _of_v2(results, wanted=True)
    names = place_names(chosen.places)
    columns = {
        f"{names[place]} {region.partition('.')[2]}": _means(
            replace(chosen, places=(place,)), region
        )
        for place in chosen.places
        for region in _REGIONS
    }

    columns = {heading: values for heading, values in columns.items() if values}
    if columns:
        whole = set.intersection(*(set(values) for values in columns.values()))
        columns["mean"] = {m: fmean(values[m] for values in columns.values()) for m in whole}

    return _table(results, {name: (values, _REGIONS[0]) for name, values in columns.items()})


def v3_table(results: Results, _metric: str = "") -> Table:
    """Return methods x metrics of version 3 and the ROC area: means over all other scenes."""
    chosen = _of_v2(results, wanted=False)
    columns = {title: (_means(chosen, name), name) for name, title in _V3.items()}
    return _table(results, {title: column for title, column in columns.items() if column[0]})


def two_table(results: Results, _metric: str = "") -> Table:
    """Return methods x bad-1.0 and bad-2.0: means over all scenes."""
    columns = {"bad-1.0": "v2.nonocc", "bad-2.0": "v3.bad_2"}
    return _table(results, {title: (_means(results, m), m) for title, m in columns.items()})


def explain_v2(_results: Results, _metric: str = "") -> str:
    """Explain the figures of `v2_table`."""
    return (
        "Bad-1.0, %: of non-occluded pixels, of all, and of those near a depth jump, as version 2 "
        "of the Middlebury evaluation had them; less is better. Bold: the best."
    )


def explain_v3(results: Results, _metric: str = "") -> str:
    """Explain the figures of `v3_table`."""
    count = len(_of_v2(results, wanted=False).counted)
    return (
        f"Non-occluded pixels, means over the other {count} scenes, as in version 3 of the "
        "Middlebury evaluation: bad-T and missing estimates in %, errors and their quantiles in "
        "px; less is better. ROC area: how well the confidence separates errors within 1 px from "
        "others; more is better. Bold: the best."
    )


def _of_v2(results: Results, *, wanted: bool) -> Results:
    """Return the results of the scenes of version 2, or of all others."""
    places = [place for place in results.places if (str(place) in _V2_SCENES) == wanted]
    return replace(results, places=tuple(places))


def _means(results: Results, metric: str) -> Mapping[str, float]:
    return means(results, metric, results.degradations).values


def _table(results: Results, columns: Mapping[str, tuple[Mapping[str, float], str]]) -> Table:
    """Return methods x columns; each column has its values by method, and their metric."""
    entries = [
        figures(results.methods, values, METRICS[metric]) for values, metric in columns.values()
    ]
    labels = [Entry(method) for method in results.methods]
    return Table(("method", *columns), tuple(zip(labels, *entries, strict=True)))


class Size(NamedTuple):
    """One size of the pairs: its name, and the metric that is the official bad-2.0."""

    name: str
    official: str


SIZES = {
    "Q": Size("quarter", "v3.bad_0_5"),
    "H": Size("half", "v3.bad_1"),
    "F": Size("full", "v3.bad_2"),
}
"""The sizes by the last letter of the collection's name."""

_COLLECTIONS = {f"MiddEval3/training{letter}": letter for letter in SIZES}
_OWN = {name: title for name, title in _V3.items() if name.startswith("v3.bad")}
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

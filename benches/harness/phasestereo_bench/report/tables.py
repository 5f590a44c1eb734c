"""Arranges results in rows and columns.

A mean covers only the scenes that all methods have, so no method gains by leaving one out. The best
figure of each degradation is marked. Methods that know the blur show what is possible, and do not
compete with the others.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from statistics import fmean
from typing import NamedTuple

from phasestereo_bench.cases import SUITE_SCENES, SUITES
from phasestereo_bench.report.cells import METRICS, Metric, Place
from phasestereo_bench.report.results import Results, knows_blur
from phasestereo_bench.rigs import RIGS

MISSING = "-"

MOST_COLUMNS = 12
"""The most degradations that a table has side by side; with more, they go down."""


class Entry(NamedTuple):
    """An entry of a table, and whether it is the best of its competitors."""

    text: str
    best: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """Text in rows and columns.

    Attributes
    ----------
    header
        Titles of the columns.
    rows
        Rows with one entry per column.
    labels
        Number of columns with text, from the left; the others hold numbers.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[Entry, ...], ...]
    labels: int = 1

    @classmethod
    def of(
        cls, header: Iterable[str], rows: Iterable[Iterable[str | Entry]], labels: int = 1
    ) -> "Table":
        """Return a table of texts, or of entries if some are marked."""
        entries = ([Entry(c) if isinstance(c, str) else c for c in row] for row in rows)
        return cls(tuple(header), tuple(map(tuple, entries)), labels)


class Means(NamedTuple):
    """Means of methods by name, over this many scenes that all of them have."""

    scenes: int
    values: Mapping[str, float]


def means(results: Results, metric: str, degradations: Sequence[str]) -> Means:
    """Return every method's mean over scenes and degradations.

    Parameters
    ----------
    results
        The results to average.
    metric
        The number to average, a name in `METRICS`.
    degradations
        The degradations to average over, at least one; a method has a scene if it has the number
        for all of them.

    Returns
    -------
    Means
        Means of the methods that have any scene, over the scenes that all of these have; if the
        suite names its scenes, over no others.
    """
    by_method = {}
    for method in results.methods:
        rows = [results.values(metric, method, degradation) for degradation in degradations]
        whole = set.intersection(set(results.counted), *rows)
        if whole:
            by_method[method] = {place: fmean(row[place] for row in rows) for place in whole}

    shared = _shared(results.counted, by_method.values())
    if not shared:
        return Means(0, {})

    averages = {m: fmean(row[place] for place in shared) for m, row in by_method.items()}
    return Means(len(shared), averages)


def blurs(results: Results) -> tuple[str, ...]:
    """Return the degradations of the suite with a kernel, if the results have all of these."""
    kernels = tuple(
        name
        for name, degradation in SUITES.get(results.suite, {}).items()
        if getattr(degradation, "psf", None) is not None
    )
    return kernels if set(kernels) <= set(results.degradations) else ()


def groups(results: Results) -> dict[str, tuple[str, ...]]:
    """Return the degradations of each average, by the name of the average."""
    single: dict[str, tuple[str, ...]] = {row: (row,) for row in results.degradations}
    return single | ({"mean of the blurs": blurs(results)} if blurs(results) else {})


def overall(results: Results, metric: str) -> Means:
    """Return the means over the blurs if all of them have results, else over all degradations."""
    return means(results, metric, blurs(results) or results.degradations)


def mean_table(results: Results, metric: str) -> Table:
    """Return methods x degradations: means over scenes, and last that over all blurs.

    If the means cover different numbers of scenes, another row shows the numbers. With more than 12
    degradations, these go down and methods across.
    """
    columns = []
    for degradations in groups(results).values():
        count, values = means(results, metric, degradations)
        column = figures(results.methods, values, METRICS[metric])
        columns.append((*column, Entry(_share(results, count))))

    *rows, counts = zip(*columns, strict=True)
    names = [*results.methods, "scenes"] if len(set(counts)) > 1 else results.methods
    labeled = [(Entry(name), *row) for name, row in zip(names, [*rows, counts], strict=False)]

    if len(columns) <= MOST_COLUMNS:
        return Table(("method", *groups(results)), tuple(labeled))

    turned = zip(map(Entry, groups(results)), *(row[1:] for row in labeled), strict=True)
    return Table(("degradation", *names), tuple(turned))


def scene_count(results: Results, metric: str) -> str:
    """Return in words the number of scenes that all means cover; nothing if the numbers differ."""
    counts = {means(results, metric, group).scenes for group in groups(results).values()}
    return f"{_share(results, counts.pop())} scenes" if len(counts) == 1 else ""


def scene_table(results: Results, metric: str) -> Table:
    """Return scenes x methods, by degradation if there are several, else with the mean below."""
    names = place_names(results.places)
    several = len(results.degradations) > 1
    rows = []

    for place, degradation in product(results.places, results.degradations):
        found = {m: results.values(metric, m, degradation).get(place) for m in results.methods}
        values = {method: value for method, value in found.items() if value is not None}
        if values:
            labels = [Entry(names[place]), *[Entry(degradation)] * several]
            rows.append((*labels, *figures(results.methods, values, METRICS[metric])))

    if not several:
        count, averages = means(results, metric, results.degradations)
        last = figures(results.methods, averages, METRICS[metric])
        rows.append((Entry(f"mean of {_share(results, count)}"), *last))

    header = ("scene", *[f"{results.side} image"] * several, *results.methods)
    return Table(header, tuple(rows), labels=1 + several)


def fault_table(results: Results, metric: str, *, group: str) -> Table:
    """Return faults of a group x methods: means over the scenes that all methods have."""
    rows = [
        (Entry(name), *figures(results.methods, values, METRICS[metric]))
        for name in results.degradations
        if RIGS[results.suite][name].group == group
        for values in [means(results, metric, (name,)).values]
    ]
    return Table(("fault", *results.methods), tuple(rows))


def place_names(places: Sequence[Place]) -> dict[Place, str]:
    """Return labels of the scenes: their names if these are unique."""
    scenes = [place.scene for place in places]
    return {
        place: place.scene if scenes.count(place.scene) == 1 else str(place) for place in places
    }


def cost_table(results: Results) -> Table:
    """Return the cost of a pair by method: mean seconds, and peak memory in MB."""
    rows = []
    for method in results.methods:
        own = [cell for cell in results.cells.values() if cell.method == method]
        seconds = fmean(cell.seconds for cell in own if cell.seconds is not None)
        peaks = [cell.peak_bytes for cell in own if cell.peak_bytes is not None]
        peak = f"{max(peaks) / 1e6:.0f}" if peaks else MISSING
        rows.append((Entry(method), Entry(f"{seconds:.3f}"), Entry(peak)))
    return Table(("method", "mean seconds", "peak MB"), tuple(rows))


def figures(
    methods: Iterable[str], values: Mapping[str, float], metric: Metric
) -> tuple[Entry, ...]:
    """Return the figures of methods; mark the best if several compete."""
    texts = {method: metric.format(value) for method, value in values.items()}
    rivals = [method for method in values if not knows_blur(method)]
    ranked = sorted(rivals, key=lambda method: metric.rank(values[method]))
    best = texts[ranked[0]] if len(ranked) > 1 else None

    return tuple(
        Entry(texts.get(method, MISSING), best=method in rivals and texts[method] == best)
        for method in methods
    )


def _share(results: Results, scenes: int) -> str:
    """Return the number of scenes, "of" the number in the suite if it has more."""
    whole = len(SUITE_SCENES.get(results.suite, ()))
    return f"{scenes} of {whole}" if scenes < whole else str(scenes)


def _shared(places: Iterable[Place], holders: Iterable[Iterable[Place]]) -> list[Place]:
    """Return the places that all holders have, in order; none if there is no holder."""
    sets = [set(holder) for holder in holders]
    return [place for place in places if sets and all(place in holder for holder in sets)]

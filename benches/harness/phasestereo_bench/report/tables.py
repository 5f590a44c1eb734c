"""Tables: the results in rows and columns.

A mean covers only the scenes that all methods have, so no method gains by leaving one out. The best
figure of each degradation is marked; methods that know the blur show what could be had, and do not
compete with the others.
"""

from __future__ import annotations

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
"""Degradations that a table has side by side; more of them go down."""


class Entry(NamedTuple):
    """What a table has in one place, and whether it is the best of those it competes with."""

    text: str
    best: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """Text in rows and columns.

    Attributes
    ----------
    header
        Of the columns.
    rows
        As many entries each.
    labels
        How many of the columns, from the left, are text; the others are numbers.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[Entry, ...], ...]
    labels: int = 1

    @classmethod
    def of(
        cls, header: Iterable[str], rows: Iterable[Iterable[str | Entry]], labels: int = 1
    ) -> Table:
        """Return a table of texts, or of entries where some are marked."""
        entries = ([Entry(c) if isinstance(c, str) else c for c in row] for row in rows)
        return cls(tuple(header), tuple(map(tuple, entries)), labels)


class Means(NamedTuple):
    """Means of methods by name, over this many scenes that all of these have."""

    scenes: int
    values: Mapping[str, float]


def means(results: Results, metric: str, degradations: Sequence[str]) -> Means:
    """Return every method's mean over scenes and degradations.

    Parameters
    ----------
    results
        What to average.
    metric
        Which number, a name in `METRICS`.
    degradations
        Over which, at least one; a method has a scene if it has the number for all of them.

    Returns
    -------
    Means
        Of the methods that have any scene, over the scenes that all of these have; where the suite
        names its scenes, over no others.
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
    """Return the degradations of the suite which have a kernel, if all of these are there."""
    kernels = tuple(
        name
        for name, degradation in SUITES.get(results.suite, {}).items()
        if getattr(degradation, "psf", None) is not None
    )
    return kernels if set(kernels) <= set(results.degradations) else ()


def groups(results: Results) -> dict[str, tuple[str, ...]]:
    """Return the degradations that are averaged over, by what the average is called."""
    single: dict[str, tuple[str, ...]] = {row: (row,) for row in results.degradations}
    return single | ({"mean of the blurs": blurs(results)} if blurs(results) else {})


def overall(results: Results, metric: str) -> Means:
    """Return the means over the blurs if all of them are there, else over all degradations."""
    return means(results, metric, blurs(results) or results.degradations)


def mean_table(results: Results, metric: str) -> Table:
    """Return methods x degradations: means over scenes, and last that over all blurs.

    Where the means are over different numbers of scenes, a further row says how many. Of more than
    12 degradations these go down and methods across.
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
    """Say how many scenes all means are over, in words; nothing if they differ in that."""
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
    """Return labels of the scenes: their names where these are unique."""
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
    """Return the figures of methods; the best is marked where several compete."""
    texts = {method: metric.format(value) for method, value in values.items()}
    rivals = [method for method in values if not knows_blur(method)]
    ranked = sorted(rivals, key=lambda method: metric.rank(values[method]))
    best = texts[ranked[0]] if len(ranked) > 1 else None

    return tuple(
        Entry(texts.get(method, MISSING), best=method in rivals and texts[method] == best)
        for method in methods
    )


def _share(results: Results, scenes: int) -> str:
    """Say how many scenes there are, and of how many if the suite has more."""
    whole = len(SUITE_SCENES.get(results.suite, ()))
    return f"{scenes} of {whole}" if scenes < whole else str(scenes)


def _shared(places: Iterable[Place], holders: Iterable[Iterable[Place]]) -> list[Place]:
    """Return the places that all holders have, in order; none if there is no holder."""
    sets = [set(holder) for holder in holders]
    return [place for place in places if sets and all(place in holder for holder in sets)]

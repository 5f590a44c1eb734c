"""Reads the cells of a benchmark run back from its stores.

This module chooses the cells and their order; `tables` and `plots` average and show them.
"""

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from phasestereo_bench.cases import SUITE_SCENES, SUITES
from phasestereo_bench.datasets import LAYOUTS
from phasestereo_bench.methods import TRUE_BLUR
from phasestereo_bench.report.cells import KIND, METRICS, Cell, Place, read_cell
from phasestereo_bench.rigs import ALTERNATING
from phasestereo_bench.store import read_store

Environments = Mapping[str, Mapping[str, Any]]
Natural = list[tuple[int, str]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Results:
    """The cells of one suite and one degraded image, and the environments they ran in.

    Attributes
    ----------
    suite, side
        The name of the suite, and the degraded image.
    methods, places, degradations
        Methods, places and degradations of the cells, in the order of the tables.
    cells
        Cells with metrics, at least one, by place, degradation and method, in that order.
    failures
        Cells without metrics.
    environments
        The environments in which the cells ran, by name.
    """

    suite: str
    side: str
    methods: tuple[str, ...]
    places: tuple[Place, ...]
    degradations: tuple[str, ...]
    cells: Mapping[tuple[Place, str, str], Cell]
    failures: tuple[Cell, ...]
    environments: Environments

    @property
    def state(self) -> str:
        """State of the pairs, in words."""
        if set(self.degradations) == {"sharp"}:
            return "both images sharp"
        if self.side == ALTERNATING:
            return "the worse image alternating between left and right"
        return f"{self.side} image degraded"

    @property
    def counted(self) -> tuple[Place, ...]:
        """Places that means cover: those that the suite names, or else all."""
        named = SUITE_SCENES.get(self.suite, frozenset())
        return tuple(place for place in self.places if str(place) in named) or self.places

    @property
    def metrics(self) -> tuple[str, ...]:
        """Names in `METRICS` for which there is a number."""
        there = {name for cell in self.cells.values() for name in cell.metrics}
        return tuple(name for name in METRICS if name in there)

    @property
    def ours(self) -> tuple[str, ...]:
        """Methods that compare phase codes."""
        ours = {cell.method for cell in self.cells.values() if _family(cell) == 0}
        return tuple(method for method in self.methods if method in ours)

    def require_metric(self, metric: str) -> None:
        """Refuse a metric without any number.

        Raises
        ------
        ValueError
            If the metric has no number; the message names the metrics that do.
        """
        if metric not in self.metrics:
            names = ", ".join(self.metrics)
            raise ValueError(f"metric: got {metric!r}; accepts those with numbers: {names}")

    def values(self, metric: str, method: str, degradation: str) -> dict[Place, float]:
        """Return a method's values by place."""
        cells = {place: self.cells.get((place, degradation, method)) for place in self.places}
        return {
            place: cell.metrics[metric]
            for place, cell in cells.items()
            if cell is not None and metric in cell.metrics
        }


def knows_blur(method: str) -> bool:
    """Return whether a method knows the blur, by its name."""
    return method.endswith(TRUE_BLUR)


def read_results(
    paths: Sequence[str | os.PathLike[str]],
    *,
    suite: str | None = None,
    side: str | None = None,
    methods: Sequence[str] = (),
) -> Results:
    """Read one or more stores of a Middlebury benchmark.

    If a cell has several records, the last one counts. Records of other benchmarks are left out.

    Parameters
    ----------
    paths
        The stores, at least one.
    suite
        Only this suite; None: the only one in the stores.
    side
        Only cells with this image degraded, "left" or "right"; None: the only one in the stores.
    methods
        Only these methods, by name and in this order; empty: all, phase codes first and methods
        that know the blur last.

    Raises
    ------
    ValueError
        If a file is invalid; if the files hold no results of that suite, side or method; if they
        hold results of several suites or sides, and none is chosen.
    OSError
        If a file cannot be read.
    """
    lines = {
        f"{path}: line {number}": record
        for path in paths
        for number, record in enumerate(read_store(path), start=1)
    }
    if all(record.get("kind") != KIND for record in lines.values()):
        raise ValueError(f"{', '.join(map(str, paths))}: no record of the kind {KIND!r}")
    return results_of(lines, suite=suite, side=side, methods=methods)


def results_of(
    records: Mapping[str, Mapping[str, Any]],
    *,
    suite: str | None = None,
    side: str | None = None,
    methods: Sequence[str] = (),
) -> Results:
    """Return the results in records, whose keys appear in messages; see `read_results`."""
    cells: dict[tuple[object, ...], Cell] = {}
    environments: dict[str, Mapping[str, Any]] = {}

    for where, record in records.items():
        if record.get("kind") == "environment":
            environments[str(record.get("id"))] = record
        elif record.get("kind") == KIND:
            try:
                cell = read_cell(record)
            except ValueError as error:
                raise ValueError(f"{where}: {error}") from error
            cells[cell.key] = cell

    return _ordered(_chosen(list(cells.values()), suite, side, methods), methods, environments)


def _chosen(
    cells: Sequence[Cell], suite: str | None, side: str | None, methods: Sequence[str]
) -> list[Cell]:
    """Return the wanted cells; refuse if there are none, or if the choice is open."""
    suite = _choice("suite", suite, {cell.suite for cell in cells})
    of_suite = [cell for cell in cells if cell.suite == suite]

    side = _choice("side", side, {cell.side for cell in of_suite})
    of_side = [cell for cell in of_suite if cell.side == side]

    there = {cell.method for cell in of_side}
    for method in methods:
        _choice("method", method, there)

    chosen = [cell for cell in of_side if not methods or cell.method in methods]
    if all(cell.error is not None for cell in chosen):
        raise ValueError(f"no results: all {len(chosen)} cells failed, {chosen[0].error}")
    return chosen


def _choice(argument: str, wanted: str | None, there: set[str]) -> str:
    """Return the wanted item, or the only one."""
    if wanted in there:
        return wanted
    if wanted is None and len(there) == 1:
        return next(iter(there))

    names = ", ".join(sorted(there, key=_natural))
    if wanted is None:
        raise ValueError(f"{argument}: got none, and there are results of several; accepts {names}")
    raise ValueError(f"{argument}: got {wanted!r}; accepts those with results: {names}")


def _ordered(
    cells: Sequence[Cell],
    methods: Sequence[str],
    environments: Environments,
) -> Results:
    """Put the cells in the order of the tables."""
    done = [cell for cell in cells if cell.error is None]
    order = _unique(cell.method for cell in sorted(done, key=_rank))
    if methods:
        order = tuple(method for method in _unique(methods) if method in order)

    collections = [layout.collection for layout in LAYOUTS]
    places = sorted(
        {cell.place for cell in done},
        key=lambda place: (_index(collections, place.collection), *map(_natural, place)),
    )

    rows = list(SUITES.get(cells[0].suite, ()))
    degradations = sorted(
        {cell.degradation for cell in done}, key=lambda row: (_index(rows, row), _natural(row))
    )

    found = {(cell.place, cell.degradation, cell.method): cell for cell in done}
    keys = [(place, row, method) for place in places for row in degradations for method in order]

    return Results(
        suite=cells[0].suite,
        side=cells[0].side,
        methods=order,
        places=tuple(places),
        degradations=tuple(degradations),
        cells={key: found[key] for key in keys if key in found},
        failures=tuple(cell for cell in cells if cell.error is not None),
        environments={
            name: environments.get(name, {}) for name in _unique(c.environment for c in cells)
        },
    )


def _rank(cell: Cell) -> tuple[bool, int, Natural]:
    return knows_blur(cell.method), _family(cell), _natural(cell.method)


def _family(cell: Cell) -> int:
    """Return 0 for phase codes, 1 for the baselines that share their pipeline, 2 for others."""
    cost = cell.settings.get("cost")
    return 2 if cost is None else int(cost != "phase")


def _natural(text: str) -> Natural:
    """Return a key that ignores case and sorts numbers by value: "L=7" before "L=11"."""
    parts = re.split(r"(\d+)", text.casefold())
    return [(int(part), "") if part.isdecimal() else (0, part) for part in parts]


def _index(known: Sequence[str], name: str) -> int:
    """Return the index of a name; an unknown name goes behind all others."""
    return known.index(name) if name in known else len(known)


def _unique(names: Iterable[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(names))

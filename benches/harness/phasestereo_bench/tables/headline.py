"""Makes the first table of the documentation: methods down; faults, time and memory across."""

from collections.abc import Mapping, Sequence
from typing import Any

from phasestereo_bench.costs import CASES
from phasestereo_bench.report.cells import METRIC, METRICS
from phasestereo_bench.report.results import Results
from phasestereo_bench.report.tables import MISSING, Entry, Table, blurs, figures, means
from phasestereo_bench.tables.plan import AUTO

Record = Mapping[str, Any]

TITLES = {
    "fast": "fast",
    AUTO: "robust, nothing given",
    "opencv:bm": "StereoBM",
    "opencv:sgbm": "StereoSGBM",
    "hitnet": "HITNet",
    "prepared:hitnet": "HITNet, prepared pair",
    "fused:hitnet": "robust and HITNet",
}

COLUMNS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "sharp": ("one-sided-blur", ("sharp",)),
    "one side blurred": ("one-sided-blur", ()),  # the mean of the blurs
    "one side darker": ("one-sided-blur", ("contrast 1.5 0.6",)),
    "rows 1 px off": ("rigs", ("rows 1",)),
    "noise": ("rigs", ("noise 5",)),
    "JPEG": ("rigs", ("jpeg 70",)),
    "webcam": ("rigs", ("webcam",)),
}
"""The suite and the degradations of each column."""


def headline_values(results: Mapping[str, Results]) -> dict[str, Mapping[str, float]]:
    """Return the means of the methods by column, for columns with results of their suites."""
    columns = {}
    for title, (suite, names) in COLUMNS.items():
        if suite in results:
            found = results[suite]
            columns[title] = means(found, METRIC, names or blurs(found)).values
    return columns


def headline_table(results: Mapping[str, Results], costs: Sequence[Record]) -> Table:
    """Return methods x faults, and the time and memory of a sharp pair."""
    columns = headline_values(results)
    there = {method for found in results.values() for method in found.methods}
    methods = [method for method in TITLES if method in there]

    rows = []
    for number, method in enumerate(methods):
        entries = [
            figures(methods, {m: v for m, v in values.items() if m in methods}, METRICS[METRIC])[
                number
            ]
            for values in columns.values()
        ]
        rows.append((Entry(TITLES[method]), *entries, *_cost(costs, method)))

    return Table(("method", *columns, "s / MP", "MB"), tuple(rows))


def cost_table(costs: Sequence[Record]) -> Table:
    """Return scenes and methods x times in ms, and the most memory of a match."""
    rows = []
    for scene, method in dict.fromkeys((record["scene"], record["method"]) for record in costs):
        mine = [r for r in costs if (r["scene"], r["method"]) == (scene, method)]
        own = {record["degradation"]: record for record in mine}

        times = [
            Entry(f"{1000 * own[name]['seconds']:.0f}" if name in own else MISSING)
            for _, name in CASES
        ]

        peaks = [record["peak_bytes"] for record in own.values() if record["peak_bytes"]]
        memory = Entry(f"{max(peaks) / 1e6:.0f}" if peaks else MISSING)
        rows.append((Entry(scene.rpartition("/")[2]), Entry(method), *times, memory))

    header = ("scene", "method", *(f"{name}, ms" for _, name in CASES), "MB")
    return Table(header, tuple(rows), labels=2)


def largest_sharp(costs: Sequence[Record], method: str) -> Record | None:
    """Return the cost of the largest sharp pair, if a method was timed."""
    own = [r for r in costs if (r["method"], r["degradation"]) == (method, "sharp")]
    return max(own, key=lambda record: float(record["pixels"]), default=None)


def _cost(costs: Sequence[Record], method: str) -> tuple[Entry, Entry]:
    """Return seconds per megapixel and MB for the largest sharp pair that a method was timed on."""
    largest = largest_sharp(costs, method)
    if largest is None:
        return Entry(MISSING), Entry(MISSING)

    peak = largest["peak_bytes"]
    memory = Entry(f"{peak / 1e6:.0f}" if peak else MISSING)
    return Entry(f"{largest['seconds'] / largest['pixels'] * 1e6:.2f}"), memory

"""Results: the records of a speed benchmark, read back, and the tables they make."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from phasestereo_bench.report.tables import MISSING, Entry, Table
from phasestereo_bench.store import read_store

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Mapping, Sequence

KIND = "speed"
"""The kind of the records."""

_TITLES: Mapping[str, str] = MappingProxyType(
    {
        "opencv:bm": "StereoBM",
        "opencv:bm-unchecked": "StereoBM unchecked",
        "opencv:sgbm-3way": "SGBM 3-way",
        "match": "ps.match",
    }
)
"""The rivals, in the order of the tables, and what these call them."""

_ENVIRONMENT = "environment"

_LABELS = ("pair", "size", "preset", "d")

_MEGA = 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedRow:
    """A pair by one preset on one thread or on all: what both tables have of it.

    Attributes
    ----------
    pair, width, height, num_disparities
        Which pair.
    preset
        Of ours.
    threads
        How many.
    rounds
        How many medians are of.
    milliseconds, gde_per_second, description_share
        Ours.
    ratios
        The rivals' time to ours, by name.
    memory
        The rise of the peak in bytes by name, ours included, as far as it was measured.
    result_bytes
        How much of ours the result is.
    first_call
        The first match's time to the next one's, of ours.
    """

    pair: str
    width: int
    height: int
    num_disparities: int
    preset: str
    threads: int
    rounds: int
    milliseconds: float
    gde_per_second: float
    description_share: float
    ratios: Mapping[str, float]
    memory: Mapping[str, float]
    result_bytes: float | None
    first_call: float | None

    @property
    def labels(self) -> tuple[Entry, ...]:
        """The columns that identify it."""
        size = f"{self.width} x {self.height}"
        return Entry(self.pair), Entry(size), Entry(self.preset), Entry(str(self.num_disparities))


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedResults:
    """All lines, in the order of their size, and what they were made with.

    Attributes
    ----------
    lines
        At least one.
    environments
        What is known of the environments, by name.
    levels, builds
        Instruction sets that we used, and that OpenCV was built for.
    pinned
        Whether single threads were held to one processor.
    """

    lines: tuple[SpeedRow, ...]
    environments: Mapping[str, Mapping[str, Any]]
    levels: tuple[str, ...]
    builds: tuple[str, ...]
    pinned: bool


def read_speed(paths: Sequence[str | os.PathLike[str]]) -> SpeedResults | None:
    """Read one or more stores; None if they have no record of this kind.

    Of several records of the same pair, preset and number of threads the last counts.

    Raises
    ------
    ValueError
        If a file is not what it should be, all measurements failed, or there are records of other
        kinds, too; each benchmark has a report of its own.
    OSError
        If a file cannot be read.
    """
    stored = [record for path in paths for record in read_store(path)]
    kinds = {str(record.get("kind")) for record in stored} - {_ENVIRONMENT}

    if KIND not in kinds:
        return None
    if len(kinds) > 1:
        raise ValueError(f"results of several benchmarks: {', '.join(sorted(kinds))}; give one")

    lines = _lines(record for record in stored if record["kind"] == KIND)
    records = [record for _, record in lines]
    known = {record["id"]: record for record in stored if record["kind"] == _ENVIRONMENT}

    return SpeedResults(
        lines=tuple(line for line, _ in lines),
        environments={name: known.get(name, {}) for name in _unique(records, "environment")},
        levels=_unique(records, "simd"),
        builds=_unique(records, "opencv_build"),
        pinned=all(r["pinned_to"] is not None for r in records if r["threads"] == "one"),
    )


def time_table(results: SpeedResults) -> Table:
    """Return what a pair takes us, and how much longer it takes the rivals."""
    header = (*_LABELS, "threads", "ms", "GDE/s", *_TITLES.values(), "first call", "description %")
    rows = [
        (
            *line.labels,
            Entry(str(line.threads)),
            Entry(f"{line.milliseconds:.{1 if line.milliseconds < 100 else 0}f}"),
            Entry(f"{line.gde_per_second:.2f}"),
            *(_entry("{:.2f}", line.ratios.get(name)) for name in _TITLES),
            _entry("{:.2f}", line.first_call),
            Entry(f"{100 * line.description_share:.0f}"),
        )
        for line in results.lines
    ]
    return Table(header, tuple(rows), labels=3)


def memory_table(results: SpeedResults) -> Table:
    """Return how far a match raises the resident memory, in MB."""
    header = (*_LABELS, "threads", "MB", "of which result", *_TITLES.values())
    rows = [
        (
            *line.labels,
            Entry(str(line.threads)),
            _megabytes(line.memory.get("ours")),
            _megabytes(line.result_bytes),
            *(_megabytes(line.memory.get(name)) for name in _TITLES),
        )
        for line in results.lines
    ]
    return Table(header, tuple(rows), labels=3)


def explain_speed(results: SpeedResults) -> str:
    """Say what the figures of both tables are."""
    rounds = " or ".join(str(count) for count in sorted({line.rounds for line in results.lines}))
    held = "held to one processor" if results.pinned else "not held to any processor"
    return (
        f"Ours with {' or '.join(results.levels)} against OpenCV built for "
        f"{' or '.join(results.builds)}. ms, GDE/s (1e9 pixels times disparities a second): ours. "
        "Below the rivals' names: their time divided by ours, more than 1 where we are faster. "
        f"Medians of {rounds} rounds in which all took turns; a single thread was {held}. "
        "ps.match: without a Matcher that is kept. First call: the first match of a process after "
        "a small one, divided by the next. description %: share of our time from images to codes. "
        "MB: rise of the peak of the resident memory over a process that has matched a small pair."
    )


def _lines(records: Iterable[Mapping[str, Any]]) -> list[tuple[SpeedRow, Mapping[str, Any]]]:
    """Return the lines in order, each with its record."""
    lines: dict[tuple[object, ...], tuple[SpeedRow, Mapping[str, Any]]] = {}
    errors = []
    for record in records:
        if record["status"] != "ok":
            errors.append(record["error"])
            continue
        try:
            line = _line(record)
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"a record of kind {KIND!r} is not whole: {error!r}") from error
        lines[line.labels, record["threads"]] = line, record

    if not lines:
        raise ValueError(f"no results: all {len(errors)} cells failed, {errors[-1]}")
    return sorted(lines.values(), key=lambda both: _size(both[0]))


def _line(record: Mapping[str, Any]) -> SpeedRow:
    ours, rivals = record["ours"], record["rivals"]
    memory = {"ours": ours["memory"], **{name: rivals[name]["memory"] for name in rivals}}
    peaks = {name: weight.get("peak_bytes") for name, weight in memory.items()}

    return SpeedRow(
        pair=str(record["pair"]),
        width=int(record["width"]),
        height=int(record["height"]),
        num_disparities=int(record["num_disparities"]),
        preset=str(record["preset"]),
        threads=int(record["thread_count"]),
        rounds=int(record["rounds"]),
        milliseconds=1e3 * float(ours["median"]),
        gde_per_second=float(ours["gde_per_second"]),
        description_share=float(ours["description_share"]),
        ratios={name: float(rivals[name]["median_ratio"]) for name in rivals},
        memory={name: float(peak) for name, peak in peaks.items() if peak is not None},
        result_bytes=ours["memory"].get("result_bytes"),
        first_call=ours["memory"].get("first_call"),
    )


def _size(line: SpeedRow) -> tuple[int, str, str, int]:
    evaluations = line.width * line.height * line.num_disparities
    return evaluations, line.pair, line.preset, line.threads


def _unique(records: Iterable[Mapping[str, Any]], name: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(str(record[name]) for record in records))


def _entry(form: str, value: float | None) -> Entry:
    return Entry(MISSING if value is None else form.format(value))


def _megabytes(count: float | None) -> Entry:
    return _entry("{:.1f}", None if count is None else count / _MEGA)

"""Makes the tables from the records of a speed benchmark."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from phasestereo_bench.report.tables import MISSING, Entry, Table

Record = Mapping[str, Any]

KIND = "speed"
"""The kind of the records."""

_TITLES: Mapping[str, str] = {
    "opencv:bm": "StereoBM",
    "opencv:bm-unchecked": "StereoBM unchecked",
    "opencv:sgbm-3way": "SGBM 3-way",
    "match": "ps.match",
}
"""The rivals, in the order of the tables, and their names there."""

_LABELS = ("pair", "size", "preset", "d", "threads")

_MEGA = 1e6


def records_before(lines: Sequence[Record], records: Iterable[Record]) -> list[Record | None]:
    """Return for each record the last earlier one from another core on the same machine.

    Parameters
    ----------
    lines
        All lines of a store, as of `read_store`.
    records
        The records that count, all from the store; a record without an earlier one gets None.
    """
    machines = {
        line["id"]: (line["cpu"], line["cores"])
        for line in lines
        if line.get("kind") == "environment"
    }

    def cell(record: Record) -> tuple[object, ...]:
        names = ("pair", "height", "width", "num_disparities", "preset", "threads")
        return machines.get(record["environment"]), *(record[name] for name in names)

    done = [line for line in lines if line.get("status") == "ok"]

    def before(record: Record) -> Record | None:
        same = [one for one in done if cell(one) == cell(record)]
        places = (place for place, one in enumerate(same) if one["core"] == record["core"])
        earlier = reversed(same[: max(places, default=0)])
        return next((one for one in earlier if one["core"] != record["core"]), None)

    return [before(record) for record in records]


def time_table(records: Sequence[Record], lines: Sequence[Record] = ()) -> Table:
    """Return our time for a pair, and the rivals' as a ratio.

    Parameters
    ----------
    records
        The records that count.
    lines
        All lines of their store; with them, a column shows the change of our time since
        `records_before`.
    """
    change = ["before"] if lines else []
    header = (*_LABELS, "ms", *change, "GDE/s", *_TITLES.values(), "first call", "description %")
    records = _by_size(records)
    rows = []
    for record, before in zip(records, records_before(lines, records), strict=True):
        ours, rivals = record["ours"], record["rivals"]
        milliseconds = 1e3 * ours["median"]
        ratios = [rivals.get(name, {}).get("median_ratio") for name in _TITLES]
        rows.append((
            *_labels(record),
            Entry(f"{milliseconds:.{1 if milliseconds < 100 else 0}f}"),
            *(_entry("{:.2f}", _growth(before, record)) for _ in change),
            Entry(f"{ours['gde_per_second']:.2f}"),
            *(_entry("{:.2f}", ratio) for ratio in ratios),
            _entry("{:.2f}", ours["memory"].get("first_call")),
            Entry(f"{100 * ours['description_share']:.0f}"),
        ))  # fmt: skip
    return Table(header, tuple(rows), labels=3)


def memory_table(records: Iterable[Record]) -> Table:
    """Return the rise of the resident memory by a match, in MB."""
    header = (*_LABELS, "MB", "of which result", *_TITLES.values())
    rows = []
    for record in _by_size(records):
        ours = record["ours"]["memory"]
        theirs = [record["rivals"].get(name, {}).get("memory", {}) for name in _TITLES]
        taken = [ours.get("peak_bytes"), ours.get("result_bytes")]
        taken += [each.get("peak_bytes") for each in theirs]
        rows.append((*_labels(record), *map(_megabytes, taken)))
    return Table(header, tuple(rows), labels=3)


def explain_speed(records: Sequence[Record]) -> str:
    """Explain the figures of both tables."""
    rounds, levels, builds = (
        " or ".join(dict.fromkeys(str(record[name]) for record in records))
        for name in ("rounds", "simd", "opencv_build")
    )
    pinned = all(one["pinned_to"] is not None for one in records if one["threads"] == "one")
    held = "held to one processor" if pinned else "not held to any processor"
    return (
        f"Ours with {levels} against OpenCV built for {builds}. ms, GDE/s (1e9 pixels times "
        "disparities a second): ours. "
        "Below the rivals' names: their time divided by ours, more than 1 where we are faster. "
        f"Medians of {rounds} rounds in which all took turns; a single thread was {held}. "
        "ps.match: without a Matcher that is kept. First call: the first match of a process after "
        "a small one, divided by the next. description %: share of our time from images to codes. "
        "MB: rise of the peak of the resident memory over a process that has matched a small pair."
    )


def _growth(before: Record | None, record: Record) -> float | None:
    """Return our time divided by the earlier one; a rival's time corrects for a busy machine."""
    both = [one["rivals"].get("opencv:sgbm-3way", {}) for one in (before, record) if one]
    ratios = [rival.get("median_ratio") for rival in both]
    return ratios[0] / ratios[1] if len(ratios) == 2 and all(ratios) else None


def _by_size(records: Iterable[Record]) -> list[Record]:
    def size(record: Record) -> tuple[int, str, str, int]:
        evaluations = record["width"] * record["height"] * record["num_disparities"]
        return evaluations, record["pair"], record["preset"], record["thread_count"]

    return sorted(records, key=size)


def _labels(record: Record) -> tuple[Entry, ...]:
    """Return the columns that identify a row."""
    size = f"{record['width']} x {record['height']}"
    texts = (
        record["pair"],
        size,
        *(record[n] for n in ("preset", "num_disparities", "thread_count")),
    )
    return tuple(Entry(str(text)) for text in texts)


def _entry(form: str, value: float | None) -> Entry:
    return Entry(MISSING if value is None else form.format(value))


def _megabytes(count: float | None) -> Entry:
    return _entry("{:.1f}", None if count is None else count / _MEGA)

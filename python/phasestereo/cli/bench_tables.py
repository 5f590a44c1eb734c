"""What ``phasestereo bench middlebury`` prints of its records."""

from __future__ import annotations

from statistics import mean
from typing import TYPE_CHECKING, Any

from rich import box
from rich.table import Table

from phasestereo.bench.methods import TRUE_BLUR

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    Record = Mapping[str, Any]


def means_table(records: Sequence[Record]) -> Table:
    """Return means over the scenes: methods down, degradations across."""
    scenes = {(record["collection"], record["scene"]) for record in records}
    table = _table(
        f"More than 1 px off, % of the non-occluded pixels, mean of {len(scenes)} scenes"
    )
    degradations = list(dict.fromkeys(record["degradation"] for record in records))
    for degradation in degradations:
        table.add_column(degradation.replace(" ", "\n"), justify="right")
    for name, row in _by_method(records).items():
        cells = [[r for r in row if r["degradation"] == column] for column in degradations]
        table.add_row(name, *map(_mean_bad, cells))
    if not all(map(_is_good, records)):
        table.caption = "* without the scenes on which the method failed"
    return table


def costs_table(records: Sequence[Record]) -> Table:
    """Return what a pair takes each method."""
    table = _table("One pair, on one thread")
    for heading in ("mean seconds", "peak MB"):
        table.add_column(heading, justify="right")
    for name, row in _by_method(records).items():
        done = list(filter(_is_good, row))
        peaks = [record["peak_bytes"] for record in done if record["peak_bytes"] is not None]
        seconds = f"{mean(record['seconds'] for record in done):.3f}" if done else "-"
        table.add_row(name, seconds, f"{max(peaks) / 1e6:.0f}" if peaks else "-")
    return table


def name_of(record: Record) -> str:
    """Return the method's name, with its ending and the image that was degraded if not the left."""
    side = "" if record["side"] == "left" else f"\n({record['side']} degraded)"
    return f"{record['method']}{TRUE_BLUR * record['true_blur']}{side}"


def _table(title: str) -> Table:
    table = Table(
        title=title,
        title_justify="left",
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        show_edge=False,
    )
    table.add_column("method", overflow="fold")
    return table


def _by_method(records: Sequence[Record]) -> dict[str, list[Record]]:
    rows: dict[str, list[Record]] = {}
    for record in records:
        rows.setdefault(name_of(record).replace(TRUE_BLUR, f"\n{TRUE_BLUR}"), []).append(record)
    return rows


def _mean_bad(records: Sequence[Record]) -> str:
    """Return the mean of the good records, with a mark if there are others."""
    bad = [record["v2"]["nonocc"] for record in records if _is_good(record)]
    known = [value for value in bad if value is not None]
    mark = "*" if len(bad) < len(records) else ""
    return (f"{mean(known):.1f}" if known else "-") + mark


def _is_good(record: Record) -> bool:
    return bool(record["status"] == "ok")

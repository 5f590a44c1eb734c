"""Makes tables of recordings without true depths, and of real pairs with them."""

from collections.abc import Mapping, Sequence
from statistics import fmean, pstdev
from typing import Any

from phasestereo_bench.real.jobs import FRAMES, PAIRS, ROWS
from phasestereo_bench.report.cells import METRIC, METRICS
from phasestereo_bench.report.tables import MISSING, Entry, Table, figures

Record = Mapping[str, Any]

_ROWS = {
    "delivered": "as delivered",
    "match": "match alone",
    "rectify": "rectify from the images",
    "calibrated": "by the calibration, as measured",
}
_STATES = {False: "raw", True: "rectified"}


def rows_table(records: Sequence[Record]) -> Table:
    """Return recordings x ways to align their rows: means of rms px, and the worst frame."""
    mine = [record for record in records if record["kind"] == ROWS]
    rows = []
    for name in _unique(mine, "recording"):
        own = [record for record in mine if record["recording"] == name]
        entries = [_mean_and_worst([record[key] for record in own]) for key in _ROWS]
        rows.append((Entry(name), Entry(str(len(own))), *entries))

    return Table(("recording", "frames", *_ROWS.values()), tuple(rows))


def agreement_table(records: Sequence[Record]) -> Table:
    """Return recordings x methods: agreement of left and right, %, and its spread over frames."""
    mine = [record for record in records if record["kind"] == FRAMES]
    methods = _unique(mine, "method")

    rows = []
    for name in _unique(mine, "recording"):
        for state, words in _STATES.items():
            own = [r for r in mine if r["recording"] == name and r["rectified"] == state]
            for key in ("agreement", "trusted"):
                entries = [_share([r[key] for r in own if r["method"] == m]) for m in methods]
                rows.append((Entry(f"{name}, {words}"), Entry(key), *entries))

    return Table(("recording", "share, %", *methods), tuple(rows), labels=2)


def pairs_table(records: Sequence[Record]) -> Table:
    """Return real pairs x methods: bad-1.0, %."""
    mine = [record for record in records if record["kind"] == PAIRS]
    methods = _unique(mine, "method")

    rows = []
    for name in _unique(mine, "pair"):
        values = {r["method"]: r["bad_1"] for r in mine if r["pair"] == name}
        rows.append((Entry(name), *figures(methods, values, METRICS[METRIC])))

    return Table(("pair", *methods), tuple(rows))


def _unique(records: Sequence[Record], key: str) -> list[str]:
    return list(dict.fromkeys(record[key] for record in records))


def _mean_and_worst(values: Sequence[float | None]) -> Entry:
    known = [value for value in values if value is not None]
    if not known:
        return Entry(MISSING)

    without = f", {len(values) - len(known)} refused" if len(known) < len(values) else ""
    return Entry(f"{fmean(known):.2f} ({max(known):.2f}{without})")


def _share(values: Sequence[float | None]) -> Entry:
    known = [100 * value for value in values if value is not None]
    return Entry(f"{fmean(known):.1f} ± {pstdev(known):.1f}" if known else MISSING)

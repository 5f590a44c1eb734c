"""The table that the records of the trials make."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from statistics import median
from typing import Any

from phasestereo_bench.blur.verdicts import ANGLE, SIZE_PIXELS, SIZE_SHARE, BlurVerdict, verdict
from phasestereo_bench.report.tables import MISSING, Entry, Table

Record = Mapping[str, Any]

_FAMILIES = ("gaussian", "disk", "motion", "none")
_HEADER = (
    *("blur", "trials", "kind %", "side %", "size %", "angle %", "one kind %", "all right %"),
    *("size off, px", "angle off, degrees"),
)


def blur_table(records: Iterable[Record]) -> Table:
    """Return the shares of correct answers, a row for each blur, and one for all."""
    groups: dict[str, list[BlurVerdict]] = {}
    for record in sorted(records, key=_order):
        groups.setdefault(_name(record), []).append(verdict(record))

    everything = [judged for group in groups.values() for judged in group]
    rows = [_row(name, group) for name, group in groups.items()]
    return Table(_HEADER, (*rows, _row("all", everything)))


def explain_blur(records: Sequence[Record]) -> str:
    """Say what the figures of the table are."""
    scenes = {(record["collection"], record["scene"]) for record in records}
    noises = sorted({record["noise"] for record in records if record["noise"]})
    levels = " or ".join(f"{noise:g}" for noise in noises)

    return (
        f"Trials on {len(scenes)} scenes; a blurred image has 8 bits and noise of {levels or 'no'} "
        "gray levels. %: share of the trials that are right. Size: Gaussians by their standard "
        "deviation, disks by their radius, motions by their length, right if off by no more than "
        f"{SIZE_PIXELS:g} px or {SIZE_SHARE:.0%}; angle: by no more than {ANGLE:g} degrees. "
        "One kind: no part of the image has another blur. Gaussians up to 1.5 and "
        "disks up to 2 px may be taken for each other, a disk for a Gaussian of half its size. "
        "Off: the median of what is right in kind."
    )


def _order(record: Record) -> tuple[int, int, float]:
    alike = record["side"] == "both"
    family = len(_FAMILIES) if alike else _FAMILIES.index(record["family"])
    return family, int(alike), 0.0 if alike else float(record["size"])


def _name(record: Record) -> str:
    if record["side"] == "both":
        return "none: both alike"
    if record["side"] == "neither":
        return "none: as they are"
    return f"{record['family']} {record['size']:g}"


def _row(name: str, group: Sequence[BlurVerdict]) -> tuple[Entry, ...]:
    sized = [judged.size_error for judged in group if judged.size_error is not None]
    turned = [judged.angle_error for judged in group if judged.angle_error is not None]

    # A size means nothing without a blur, an angle only something for a motion.
    blurred = not name.startswith("none")
    moved = name.startswith(("motion", "all"))

    return (
        Entry(name),
        Entry(str(len(group))),
        _share(group, lambda judged: judged.kind),
        _share(group, lambda judged: judged.side),
        _share(group, lambda judged: judged.size) if blurred else Entry(MISSING),
        _share(group, lambda judged: judged.angle) if moved else Entry(MISSING),
        _share(group, lambda judged: judged.single),
        _share(group, lambda judged: judged.all),
        Entry(f"{median(sized):.2f}" if sized else MISSING),
        Entry(f"{median(turned):.1f}" if turned else MISSING),
    )


def _share(group: Sequence[BlurVerdict], right: Callable[[BlurVerdict], bool]) -> Entry:
    """Return the share in %, 100 only of all."""
    count = sum(map(right, group))
    return Entry("100" if count == len(group) else f"{100 * count / len(group):.1f}")

"""Reads cells, the scores of a method on a scene, from records of a Middlebury benchmark."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from phasestereo_bench.methods import TRUE_BLUR

Record = Mapping[str, Any]


KIND = "middlebury"
"""The kind of the records to read."""


class Metric(NamedTuple):
    """A kind of number: its name, its unit if it has one, and whether more is better."""

    title: str
    unit: str
    more: bool = False

    @property
    def better(self) -> str:
        """The better values, in words."""
        return f"{'more' if self.more else 'less'} is better"

    @property
    def label(self) -> str:
        """Name and unit of the number."""
        return ", ".join(filter(None, (self.title, self.unit)))

    def rank(self, value: float) -> float:
        """Return a key that sorts values from the best to the worst."""
        return -value if self.more else value

    def format(self, value: float) -> str:
        """Return the value as tables show it: % to 0.1, pixels to 0.01, areas to 0.001."""
        return f"{value:.{_DIGITS[self.unit]}f}"


_DIGITS = {"%": 1, "px": 2, "": 3}


METRICS: Mapping[str, Metric] = {
    "v2.nonocc": Metric("bad-1.0, non-occluded pixels", "%"),
    "v2.all": Metric("bad-1.0, all pixels", "%"),
    "v2.disc": Metric("bad-1.0, pixels near a depth jump", "%"),
    "v3.bad_0_5": Metric("bad-0.5, non-occluded pixels", "%"),
    "v3.bad_1": Metric("bad-1.0, non-occluded pixels, clipped to the range", "%"),
    "v3.bad_2": Metric("bad-2.0, non-occluded pixels", "%"),
    "v3.bad_4": Metric("bad-4.0, non-occluded pixels", "%"),
    "v3.invalid": Metric("missing estimates, non-occluded pixels", "%"),
    "v3.avgerr": Metric("mean error, non-occluded pixels", "px"),
    "v3.rms": Metric("root mean square error, non-occluded pixels", "px"),
    "v3.a50": Metric("A50, non-occluded pixels", "px"),
    "v3.a90": Metric("A90, non-occluded pixels", "px"),
    "v3.a95": Metric("A95, non-occluded pixels", "px"),
    "v3.a99": Metric("A99, non-occluded pixels", "px"),
    "d1": Metric("D1, non-occluded pixels", "%"),
    "epe": Metric("end-point error, non-occluded pixels", "px"),
    "roc": Metric("ROC area of the confidence, non-occluded pixels", "", more=True),
}
"""The metrics by their names in a record."""

METRIC = "v2.nonocc"
"""The one that documents show."""


class Place(NamedTuple):
    """A scene of a collection."""

    collection: str
    scene: str

    def __str__(self) -> str:
        """Return "collection/scene", like scenes of `phasestereo_bench.datasets`."""
        return "/".join(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One method on one scene with one image degraded.

    Attributes
    ----------
    suite, place, degradation, side
        The scene, its degradation, and the side of the degraded image.
    method
        The method's name, with its ending if it knows the blur.
    metrics
        Finite values by the names in `METRICS`.
    seconds, peak_bytes
        Time and memory of the match, if they are known.
    settings
        The method's settings by name.
    environment
        Name of the environment in which the method ran.
    error
        The reason for missing metrics; None if the cell has metrics.
    """

    suite: str
    place: Place
    degradation: str
    side: str
    method: str
    metrics: Mapping[str, float]
    seconds: float | None
    peak_bytes: float | None
    settings: Mapping[str, Any]
    environment: str
    error: str | None

    @property
    def key(self) -> tuple[object, ...]:
        """The fields that identify the cell."""
        return self.suite, self.place, self.degradation, self.side, self.method


def read_cell(record: Record) -> Cell:
    """Read a cell from a record of kind `KIND`.

    Raises
    ------
    ValueError
        If a field is missing or invalid; the message names the field.
    """
    ok = _text(record, "status") == "ok"
    settings = record.get("settings")

    return Cell(
        suite=_text(record, "suite"),
        place=Place(_text(record, "collection"), _text(record, "scene")),
        degradation=_text(record, "degradation"),
        side=_text(record, "side"),
        method=_method(record),
        metrics=_metrics(record) if ok else {},
        seconds=_number(record.get("seconds")),
        peak_bytes=_number(record.get("peak_bytes")),
        settings=settings if isinstance(settings, dict) else {},
        environment=str(record.get("environment", "unknown")),
        error=None if ok else str(record.get("error")),
    )


def _method(record: Record) -> str:
    true_blur = bool(record.get("true_blur"))
    return _text(record, "method").removesuffix(TRUE_BLUR) + TRUE_BLUR * true_blur


def _metrics(record: Record) -> dict[str, float]:
    found = {}
    for name in METRICS:
        group, _, member = name.rpartition(".")
        holder = record.get(group) if group else record
        value = _number(holder.get(member)) if isinstance(holder, dict) else None
        if value is not None:
            found[name] = value

    return found


def _number(value: object) -> float | None:
    """Return a finite number; None for anything else, which is an unknown value."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    return float(value) if math.isfinite(value) else None


def _text(record: Record, name: str) -> str:
    value = record.get(name)
    if isinstance(value, str):
        return value
    raise ValueError(f"{name} must be a text, got {value!r}")

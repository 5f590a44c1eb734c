"""Verdicts: whether the estimate of a trial matches what was done to the images."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

SIZE_PIXELS, SIZE_SHARE, ANGLE = 0.5, 0.1, 15.0
"""How far a size may be off, in pixels or as a share of it, and an angle, in degrees."""

_ALIKE_UP_TO = {"gaussian": 1.5, "disk": 2.0}
"""Up to these sizes a Gaussian and a disk of twice its size cannot be distinguished."""


@dataclass(frozen=True, slots=True)
class BlurVerdict:
    """What is right about an estimate.

    Attributes
    ----------
    kind
        Whether the family is right: no blur where neither or both of the images are blurred.
    side
        Whether the softer image is; of no blur, whether none is reported.
    size_error
        By how many pixels the size is off; None where it has no meaning.
    size
        Whether that is little enough.
    angle_error
        By how many degrees, 0 to 90; None where it has no meaning.
    angle
        Whether that is little enough.
    single
        Whether this kind of blur is the only one that was found.
    """

    kind: bool
    side: bool
    size_error: float | None
    size: bool
    angle_error: float | None
    angle: bool
    single: bool

    @property
    def all(self) -> bool:
        """Whether everything is right."""
        return self.kind and self.side and self.size and self.angle and self.single


def verdict(record: Mapping[str, Any]) -> BlurVerdict:
    """Judge a good record of a trial."""
    found, single = record["found"], record["kinds"] == 1

    if record["side"] in ("neither", "both"):
        none = found["side"] == "none"
        return BlurVerdict(none, none, None, size=True, angle_error=None, angle=True, single=single)

    family, true = record["family"], float(record["size"])
    alike = {found["kind"], family} == set(_ALIKE_UP_TO) and true <= _ALIKE_UP_TO[family]
    kind = found["kind"] == family or alike

    # Sizes and angles are compared only where the family is right.
    size = _as(family, found) if kind else None
    error = None if size is None else abs(size - true)
    # A motion has a direction but no sense: angles repeat after 180 degrees.
    turn = (
        abs((found["angle"] - record["angle"] + 90) % 180 - 90)
        if kind and family == "motion"
        else None
    )

    return BlurVerdict(
        kind=kind,
        side=found["side"] == record["side"],
        size_error=error,
        size=error is not None and error <= max(SIZE_PIXELS, SIZE_SHARE * true),
        angle_error=turn,
        angle=family != "motion" or (turn is not None and turn <= ANGLE),
        single=single,
    )


def _as(family: str, found: Mapping[str, Any]) -> float:
    """Return the size that a found blur has in terms of another family of the same spread."""
    size = float(found["size"])
    if found["kind"] == family:
        return size
    return 2 * size if family == "disk" else size / 2

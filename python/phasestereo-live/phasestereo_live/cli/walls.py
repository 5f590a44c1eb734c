"""The options of ``phasestereo rig test`` for frames of a flat wall."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from phasestereo.cli.errors import wrong
from phasestereo.cli.options import POSITIVE, as_word
from phasestereo.io import Calibration, LengthUnit
from phasestereo.io.depth import meters_in
from phasestereo.rectification.record import Rectification
from phasestereo_live.walls import LIMITS, Wall


def _distance(word: str) -> tuple[float, str | None]:
    found = re.fullmatch(r"(\d+\.?\d*|\.\d+)(mm|cm|m)?", word)
    if not found or not float(found[1]):
        raise ValueError
    return float(found[1]), found[2]


_DISTANCE = as_word(_distance, "a distance, as 1.0m, 850mm, or 1.0 in --unit")


@dataclass(frozen=True, slots=True, kw_only=True)
class WallOptions:
    """The options of a wall.

    Parameters
    ----------
    wall
        Distance of a flat wall with texture that the frames show, such as 1.0m: the command also
        tests depths.
    baseline
        Distance between the cameras of rectified frames; needs --focal.
    unit
        The unit of the baseline, also of the one in --rectify.
    """

    wall: Annotated[tuple[float, str | None] | None, _DISTANCE] = None
    baseline: Annotated[float | None, Parameter(validator=POSITIVE)] = None
    unit: LengthUnit | None = None

    def check(self, *, focal: float | None, rectify: Path | None, has_frames: bool) -> None:
        """Refuse options that are incomplete or have no effect.

        Raises
        ------
        CommandError
            If there is such an option.
        """
        if self.wall is None:
            for name in ("baseline", "unit"):
                if getattr(self, name) is not None:
                    raise wrong(name, "has no effect without --wall")
            return

        if not has_frames:
            raise wrong("wall", "got a saved rig; accepts a folder of frames")
        if rectify is None and (focal is None or self.baseline is None):
            raise wrong("wall", "needs --rectify, or --focal and --baseline")
        if rectify is not None and self.baseline is not None:
            raise wrong("baseline", "has no effect beside --rectify")

    def test(
        self, size: tuple[int, ...], focal: float | None, found: Rectification | None
    ) -> Wall | None:
        """Return the test of a wall for frames of a size, or None."""
        if self.wall is None:
            return None

        height, width = size
        if found is not None:
            if found.calibration is None:
                raise wrong("wall", "needs a calibration that has lengths")
            calibration = found.calibration
        else:
            assert focal is not None  # noqa: S101 -- this and the next line: `check` made sure
            assert self.baseline is not None  # noqa: S101
            calibration = Calibration.from_focal(focal, self.baseline, width=width, height=height)

        distance, unit = self.wall
        own = self.unit or calibration.unit
        if unit is not None:
            if own is None:
                raise wrong("wall", f"got {distance:g}{unit}; needs --unit, that of the baseline")
            distance *= meters_in(unit) / meters_in(own)
        return Wall(distance, calibration, unit=own or "")

    def split(self, limits: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float]]:
        """Return the limits of the rig, and those of the wall."""
        own = LIMITS if self.wall is not None else {}
        return (
            {name: limit for name, limit in limits.items() if name not in own},
            {name: limit for name, limit in limits.items() if name in own},
        )

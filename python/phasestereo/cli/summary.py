"""What ``phasestereo match`` says of a result: a few lines and a table, or one JSON object."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import phasestereo
from phasestereo._numbers import as_json as plain
from phasestereo.cli.outcome import Outcome
from phasestereo.cli.terminal import print_json, print_lines
from phasestereo.metrics import Score
from phasestereo.metrics.scores import unit_of
from phasestereo.result import Result, count_flags, describe_flags
from phasestereo.views.depths import Ranging

_BASELINES = 0.001, 20.0  # meters, of cameras on one mount


@dataclass(frozen=True, slots=True, eq=False)
class MatchSummary:
    """An outcome, and what has become of it.

    Parameters
    ----------
    outcome
        The outcome.
    files
        The files written, by option.
    """

    outcome: Outcome
    files: Mapping[str, str]

    def as_dict(self) -> dict[str, Any]:
        """Return everything as JSON has it; numbers that JSON does not have are None."""
        result, disparities = self.outcome.result, self.outcome.disparities
        rows, cols = result.disparity.shape
        summary = {
            "version": phasestereo.__version__,
            "width": cols,
            "height": rows,
            "min_disparity": disparities[0],
            "num_disparities": disparities[1],
            "settings": asdict(result.settings),
            "timings": dict(result.timings),
            "search": None if result.search is None else asdict(result.search),
            "alignment": _alignment(result),
            "findings": [asdict(found) for found in result.findings],
            "blurs": None if result.blur is None else result.blur.as_dicts(),
            "estimated": self.estimated,
            "trusted": self.trusted,
            "wrong": None if result.summary is None else result.summary.wrong,
            "flags": self.flags,
            "files": dict(self.files),
        }

        if (geometry := self.geometry) is not None:
            summary["geometry"] = {
                "yaw": geometry.yaw,
                "yaw_share": geometry.share[0],
                "moved": geometry.moved,
                "kept": self.kept,
                "focal": geometry.calibration.focal,
                "baseline": geometry.calibration.baseline,
                "unit": geometry.calibration.unit,
            }
        if self.outcome.rectified is not None:
            summary["rectification"] = self.outcome.rectified.as_dict()
        if self.outcome.score is not None:
            summary["metrics"] = self.outcome.score.as_dict()
        return plain(summary)

    @property
    def estimated(self) -> float:
        """Share of the pixels with an estimate, 0 to 1."""
        return float(np.isfinite(self.outcome.result.disparity).mean())

    @property
    def trusted(self) -> float:
        """Share of the pixels whose estimate is trusted, 0 to 1."""
        return float(self.outcome.result.trusted.mean())

    @property
    def geometry(self) -> Ranging | None:
        """What made depths of the disparities; None: nothing did."""
        rig = self.outcome.rig
        return None if rig is None else rig.ranging(self.outcome.result)

    @property
    def kept(self) -> dict[str, Any] | None:
        """Which pixels become depths, their share of all, and the estimated share of wrong ones.

        None without a geometry. ``wrong`` is NaN where there are no confidences.
        """
        if self.outcome.rig is None:
            return None
        result, keep = self.outcome.result, self.outcome.rig.selection.keep
        pixels = result.kept(keep)
        sure = np.empty(0) if result.confidence is None else result.confidence[pixels]
        wrong = 1 - float(sure.mean()) if sure.size else math.nan
        return {"keep": keep, "share": float(pixels.mean()), "wrong": wrong}

    @property
    def flags(self) -> dict[str, int]:
        """Number of pixels under each flag, by its name."""
        counts = count_flags(self.outcome.result.flags)
        return {str(flag.name).lower(): count for flag, count in counts.items()}


def _alignment(result: Result) -> dict[str, Any] | None:
    if result.alignment is None:
        return None
    names = "vertical", "rotation", "scale", "rms", "error", "blocks", "applied"
    return {name: getattr(result.alignment, name) for name in names}


def show(summary: MatchSummary, *, as_json: bool) -> None:
    """Print a summary on standard output."""
    if as_json:
        print_json(summary.as_dict())
        return

    print_lines(_lines(summary))
    if summary.outcome.score is not None:
        Console(highlight=False, soft_wrap=True).print(_table(summary.outcome.score))


def _lines(summary: MatchSummary) -> list[str]:
    result = summary.outcome.result
    rows, cols = result.disparity.shape
    seconds = sum(result.timings.values())

    return [
        *([result.verdict] if result.verdict else []),
        f"{cols} x {rows} pixels, disparities {_range(summary)}, {seconds:.3f} s",
        f"trusted {summary.trusted:.1%}, flagged: {describe_flags(result.flags)}",
        *(() if (rectified := summary.outcome.rectified) is None else rectified.sentences),
        *([] if result.blur is None else [f"blur: {result.blur}"]),
        *([] if summary.geometry is None else _geometry(summary.geometry)),
        *([] if summary.kept is None else [_kept(**summary.kept)]),
        *(f"wrote {path}" for path in summary.files.values()),
    ]


def _geometry(found: Ranging) -> list[str]:
    """Say what depths follow from, and how exact they are."""
    known = found.calibration
    unit: str = known.unit or "a unit that is not known (--unit)"
    if known.unit and not _BASELINES[0] <= known.in_meters().baseline <= _BASELINES[1]:
        unit += " (is the unit right? --unit names that of the baseline and converts nothing)"
    said = (
        f"baseline {known.baseline:.6g}, and depths, in {unit}; focal length {known.focal:.6g} px"
    )
    return [said, str(found)]


def _kept(keep: str, share: float, wrong: float) -> str:
    """Say which pixels became depths and points, and how many of them are probably wrong."""
    said = "" if math.isnan(wrong) else f"; about {wrong:.1%} of these are probably wrong"
    others = "" if keep == "all" else ", --keep all for every estimate"
    return f"depths and points: {share:.1%} of the pixels ({keep}{others}){said}"


def _range(summary: MatchSummary) -> str:
    low, count = summary.outcome.disparities
    search = summary.outcome.result.search
    found = " (found)" if search is not None and search.origin == "found" else ""
    return f"{low} to {low + count - 1}{found}"


def _table(score: Score) -> Table:
    table = Table("metric", title="Against the truth", title_justify="left")
    table.add_column("value", justify="right")

    for name, value in score.as_dict().items():
        table.add_row(name, f"{value:,}" if name == "pixels" else f"{value:.2f} {unit_of(name):<2}")
    return table

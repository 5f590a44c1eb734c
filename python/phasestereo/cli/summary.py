"""What ``phasestereo match`` says of a result: a few lines and a table, or one JSON object."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.table import Table

import phasestereo
from phasestereo.cli.terminal import printable
from phasestereo.metrics import unit_of
from phasestereo.result import count_flags, tell_flags

if TYPE_CHECKING:
    from collections.abc import Mapping

    from phasestereo.cli.outcome import Outcome
    from phasestereo.metrics import Score


@dataclass(frozen=True, slots=True, eq=False)
class Summary:
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
            "blurs": None if result.blur is None else result.blur.as_dicts(),
            "estimated": self.estimated,
            "flags": self.flags,
            "files": dict(self.files),
        }
        if self.outcome.score is not None:
            metrics = self.outcome.score.as_dict().items()
            summary["metrics"] = {k: v if math.isfinite(v) else None for k, v in metrics}
        return summary

    @property
    def estimated(self) -> float:
        """Share of the pixels with an estimate, 0 to 1."""
        return float(np.isfinite(self.outcome.result.disparity).mean())

    @property
    def flags(self) -> dict[str, int]:
        """Number of pixels under each flag, by its name."""
        counts = count_flags(self.outcome.result.flags)
        return {str(flag.name).lower(): count for flag, count in counts.items()}


def show(summary: Summary, *, as_json: bool) -> None:
    """Print a summary on standard output."""
    if as_json:
        sys.stdout.write(json.dumps(summary.as_dict(), indent=2, allow_nan=False) + "\n")
        return
    console = Console(highlight=False, soft_wrap=True)
    for line in _lines(summary):
        console.print(printable(line), markup=False)
    if summary.outcome.score is not None:
        console.print(_table(summary.outcome.score))


def _lines(summary: Summary) -> list[str]:
    result = summary.outcome.result
    rows, cols = result.disparity.shape
    seconds = sum(result.timings.values())
    return [
        f"{cols} x {rows} pixels, {summary.outcome.disparities[1]} disparities, {seconds:.3f} s",
        f"estimated {summary.estimated:.1%}, flagged: {tell_flags(result.flags)}",
        *([] if result.blur is None else [f"blur: {result.blur}"]),
        *(f"wrote {path}" for path in summary.files.values()),
    ]


def _table(score: Score) -> Table:
    table = Table("metric", title="Against the truth", title_justify="left")
    table.add_column("value", justify="right")
    for name, value in score.as_dict().items():
        table.add_row(name, f"{value:,}" if name == "pixels" else f"{value:.2f} {unit_of(name):<2}")
    return table

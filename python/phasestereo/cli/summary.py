"""The report of ``phasestereo match``: a few lines and a table, or one JSON object."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import phasestereo
from phasestereo._numbers import as_json as plain
from phasestereo.cli.geometry import Rig
from phasestereo.cli.outputs import Outcome
from phasestereo.cli.terminal import print_json, print_lines
from phasestereo.metrics import Score
from phasestereo.metrics.scores import unit_of
from phasestereo.result import Result, count_flags, describe_flags
from phasestereo.views.depths import Ranging, depths_of

_BASELINES = 0.001, 20.0  # meters, of cameras on one mount


def show(outcome: Outcome, files: Mapping[str, str], *, as_json: bool) -> None:
    """Print the results and the written files, by option, on standard output."""
    if as_json:
        print_json(_as_dict(outcome, files))
        return

    print_lines(_lines(outcome, files))
    if outcome.score is not None:
        Console(highlight=False, soft_wrap=True).print(_table(outcome.score))


def _as_dict(outcome: Outcome, files: Mapping[str, str]) -> dict[str, Any]:
    """Return everything in JSON form; numbers that JSON does not have become None."""
    result, disparities = outcome.result, outcome.disparities
    rows, cols = result.disparity.shape
    counts = count_flags(result.flags)
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
        "estimated": np.isfinite(result.disparity).mean(),
        "trusted": result.trusted.mean(),
        "wrong": None if result.summary is None else result.summary.wrong,
        "flags": {str(flag.name).lower(): count for flag, count in counts.items()},
        "files": dict(files),
    }

    if outcome.rig is not None:
        geometry = outcome.rig.ranging(result)
        summary["geometry"] = {
            "yaw": geometry.yaw,
            "yaw_share": geometry.share[0],
            "moved": geometry.moved,
            "kept": _kept(result, outcome.rig, geometry),
            "focal": geometry.calibration.focal,
            "baseline": geometry.calibration.baseline,
            "unit": geometry.calibration.unit,
        }
    if outcome.rectified is not None:
        summary["rectification"] = outcome.rectified.as_dict()
    if outcome.score is not None:
        summary["metrics"] = outcome.score.as_dict()
    return plain(summary)


def _kept(result: Result, rig: Rig, geometry: Ranging) -> dict[str, Any]:
    """Return the kind of pixels that become depths, their share, and their share of errors.

    The last one is NaN without confidences. With --decimate, these are the pixels to choose from.
    """
    keep = rig.selection.keep
    pixels = np.isfinite(depths_of(result, geometry, replace(rig.selection, decimate=1)).depth)
    sure = np.empty(0) if result.confidence is None else result.confidence[pixels]
    wrong = 1 - float(sure.mean()) if sure.size else math.nan
    return {"keep": keep, "share": float(pixels.mean()), "wrong": wrong}


def _alignment(result: Result) -> dict[str, Any] | None:
    if result.alignment is None:
        return None
    names = "vertical", "rotation", "scale", "rms", "error", "blocks", "applied"
    return {name: getattr(result.alignment, name) for name in names}


def _lines(outcome: Outcome, files: Mapping[str, str]) -> list[str]:
    result, rig = outcome.result, outcome.rig
    rows, cols = result.disparity.shape
    seconds = sum(result.timings.values())

    return [
        *([result.verdict] if result.verdict else []),
        f"{cols} x {rows} pixels, disparities {_range(outcome)}, {seconds:.3f} s",
        f"trusted {result.trusted.mean():.1%}, flagged: {describe_flags(result.flags)}",
        *(() if outcome.rectified is None else outcome.rectified.sentences),
        *([] if result.blur is None else [f"blur: {result.blur}"]),
        *([] if rig is None else _geometry(rig, result)),
        *(f"wrote {path}" for path in files.values()),
    ]


def _geometry(rig: Rig, result: Result) -> list[str]:
    """Describe the source of the depths, their accuracy, and how many there are."""
    found = rig.ranging(result)
    known = found.calibration
    unit: str = known.unit or "a unit that is not known (--unit)"
    if known.unit and not _BASELINES[0] <= known.in_meters().baseline <= _BASELINES[1]:
        unit += " (is the unit right? --unit names that of the baseline and converts nothing)"
    said = (
        f"baseline {known.baseline:.6g}, and depths, in {unit}; focal length {known.focal:.6g} px"
    )
    return [said, str(found), _kept_in_words(**_kept(result, rig, found))]


def _kept_in_words(keep: str, share: float, wrong: float) -> str:
    """Describe the pixels that became depths and points, and the share that is probably wrong."""
    said = "" if math.isnan(wrong) else f"; about {wrong:.1%} of these are probably wrong"
    others = "" if keep == "all" else ", --keep all for every estimate"
    return f"depths and points: {share:.1%} of the pixels ({keep}{others}){said}"


def _range(outcome: Outcome) -> str:
    low, count = outcome.disparities
    search = outcome.result.search
    found = " (found)" if search is not None and search.origin == "found" else ""
    return f"{low} to {low + count - 1}{found}"


def _table(score: Score) -> Table:
    table = Table("metric", title="Against the truth", title_justify="left")
    table.add_column("value", justify="right")

    for name, value in score.as_dict().items():
        table.add_row(name, f"{value:,}" if name == "pixels" else f"{value:.2f} {unit_of(name):<2}")
    return table

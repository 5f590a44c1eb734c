"""``phasestereo match --max-memory``: pairs larger than memory, from file to file."""

# No `from __future__ import annotations`: the command line is made of these annotations.

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

import phasestereo
from phasestereo import outofcore
from phasestereo.cli.errors import WRONG_USAGE, CommandError, option, refusals
from phasestereo.cli.outputs import Outputs
from phasestereo.cli.scoring import Scoring
from phasestereo.cli.terminal import print_json, print_lines, progress_bar, say
from phasestereo.outofcore import MapReport, Plan, format_bytes
from phasestereo.result import LAYERS, format_counts

_WHOLE = ("color", "ply", "mesh", "depth", "report")


@dataclass(frozen=True, slots=True, kw_only=True)
class Large:
    """The options for pairs larger than memory.

    Parameters
    ----------
    max_memory
        Memory that the program may take, such as 2GB or 800MiB: the pair is read, matched and
        written (.tif, .npy or .zarr, other layers, too) band by band, and the same command goes on
        after whatever ended it. The result is that of the whole pair, to the bit. Images are TIFF
        files, Zarr arrays or .npy. Needs the extra ``large``.
    band_rows
        Rows of a band; without it, as many as the memory allows.
    restart
        Drop what an earlier run left finished.
    """

    max_memory: str | None = None
    band_rows: int | None = None
    restart: Annotated[bool, Parameter(negative=(), show_default=False)] = False

    def asked_for(self) -> bool:
        """Return whether to match that way; refuse options that have no effect."""
        if self.max_memory is not None:
            return True
        for name in self._given():
            raise CommandError(f"{option(name)}: has no effect without --max-memory", WRONG_USAGE)
        return False

    def check(self, outputs: Outputs, scoring: Scoring) -> Path:
        """Return the file for the disparities; refuse what needs the whole map at once."""
        # These draw, triangulate or score a map as a whole.
        wanted = [name for name in _WHOLE if getattr(outputs, name)]
        if scoring.truth:
            wanted.append("truth")
        if wanted:
            raise CommandError(
                f"{option(wanted[0])}: needs the whole map in memory, which --max-memory is to "
                "spare; accepts no such option beside it",
                WRONG_USAGE,
            )

        if outputs.output is None:
            raise CommandError("--max-memory: needs --output, a file for the map", WRONG_USAGE)
        return outputs.output

    def arguments(self) -> dict[str, Any]:
        """Return what was given, as `phasestereo.outofcore.match` takes it."""
        return {name: getattr(self, name) for name in self._given()}

    def _given(self) -> list[str]:
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return [name for name, value in values.items() if value not in (None, False)]


_LAYERS = {f"{layer}_output" for layer in LAYERS}
_OPTIONS = frozenset(field.name for field in fields(Large)) | {"output"} | _LAYERS


def match_large(
    pair: tuple[Path, Path],
    output: Path,
    large: Large,
    arguments: Mapping[str, Any],
    *,
    options: frozenset[str],
    as_json: bool,
) -> None:
    """Match a pair from file to file, and say what it takes, how far it is, and what came out.

    Parameters
    ----------
    pair
        The images.
    output
        The file for the disparities.
    large
        What memory there is, and more of that kind.
    arguments
        What else `phasestereo.outofcore.match` takes.
    options
        Names of the arguments that come from options.
    as_json
        Whether to print one JSON object.
    """
    left, right = pair
    given: dict[str, Any] = {**arguments, **large.arguments()}

    try:
        with refusals(options=options | _OPTIONS), progress_bar("Matching") as progress:
            report = outofcore.match(
                left, right, output, **given, announce=_show_plan, progress=progress, stage=say
            )
    except KeyboardInterrupt:
        say("finished bands are kept: the same command goes on from there")
        raise

    _show(report, as_json=as_json)


def _show_plan(plan: Plan) -> None:
    """Print what a run takes, before it starts and again after its first band."""
    duration = format_duration(plan.seconds)
    if plan.by_band:
        say(f"by its first band, {duration} to go")
        return

    rows, cols = plan.size
    bands = f"{plan.bands} band{'s' * (plan.bands != 1)}"
    threads = f"{plan.threads} thread{'s' * (plan.threads != 1)}"
    finished = f", {plan.finished} finished before" if plan.finished else ""
    say(
        f"{cols} x {rows} pixels, {plan.num_disparities} disparities: {bands} of {plan.rows} "
        f"rows{finished}, {threads}, at most "
        f"{format_bytes(plan.memory)} of memory, about {duration}"
    )


def format_duration(seconds: float) -> str:
    """Return a duration in words, as exactly as an estimate is worth."""
    if seconds < 100:
        return f"{max(1, round(seconds))} s"
    if seconds < 100 * 60:
        return f"{round(seconds / 60)} min"
    return f"{round(seconds / 3600)} h"


def _show(report: MapReport, *, as_json: bool) -> None:
    if as_json:
        print_json({"version": phasestereo.__version__, **report.as_dict()})
    else:
        print_lines(_lines(report))


def _lines(report: MapReport) -> list[str]:
    rows, cols = report.plan.size
    blur = report.statistics.blur
    peak = "" if report.peak_memory is None else f", {format_bytes(report.peak_memory)} of memory"
    flags = format_counts(report.flags, rows * cols)

    return [
        f"{cols} x {rows} pixels, {report.plan.num_disparities} disparities, "
        f"{report.seconds:.3f} s{peak}",
        f"estimated {report.estimated:.1%}, flagged: {flags}",
        *([] if blur is None else [f"blur: {blur}"]),
        *(f"wrote {path}" for path in report.files.values()),
    ]

"""``phasestereo large``: matches a pair larger than memory, from file to file."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

from dataclasses import fields
from pathlib import Path
from typing import Annotated

from cyclopts import Group, Parameter

import phasestereo
from phasestereo.cli.errors import refusals
from phasestereo.cli.options import (
    AT_LEAST_ONE,
    PRESET_HELP,
    REASONABLE,
    SETTINGS_HELP,
    Bands,
    Overrides,
    Threads,
)
from phasestereo.cli.terminal import print_json, print_lines, progress_bar, say
from phasestereo.known import Known
from phasestereo.result import LAYERS, format_counts
from phasestereo.settings import PRESET, Settings, resolve
from phasestereo_large import outofcore
from phasestereo_large.outofcore import MapReport, Plan, format_bytes

_VALUES = {"bands", "preset", "num_disparities", "min_disparity", "threads", "noise"}
_MEMORY = {"max_memory", "band_rows", "restart", "output"} | {f"{layer}_output" for layer in LAYERS}
_OPTIONS = _VALUES | _MEMORY | {field.name for field in fields(Settings)}

_OUTPUT = Group.create_ordered("Output")
_SEARCH = Group.create_ordered("Search")
_WORK = Group.create_ordered("Work")
_SETTINGS = Group.create_ordered("Expert settings", help=SETTINGS_HELP)

_Layer = Annotated[Path | None, Parameter(group=_OUTPUT)]
_Mask = Annotated[Path | None, Parameter(group=_SEARCH)]


def large(
    left: Path,
    right: Path,
    /,
    *,
    output: Annotated[Path, Parameter(alias="-o", group=_OUTPUT)],
    flags_output: _Layer = None,
    confidence_output: _Layer = None,
    uncertainty_output: _Layer = None,
    json: Annotated[bool, Parameter(negative=(), show_default=False, group=_OUTPUT)] = False,
    num_disparities: Annotated[int, Parameter(group=_SEARCH, validator=AT_LEAST_ONE)],
    min_disparity: Annotated[int, Parameter(group=_SEARCH, validator=REASONABLE)] = 0,
    preset: Annotated[str, Parameter(group=_SEARCH, help=PRESET_HELP)] = PRESET,
    left_mask: _Mask = None,
    right_mask: _Mask = None,
    bands: Annotated[Bands | None, Parameter(group=_SEARCH)] = None,
    noise: Annotated[float | None, Parameter(group=_SEARCH)] = None,
    max_memory: Annotated[str, Parameter(group=_WORK)],
    threads: Annotated[Threads, Parameter(group=_WORK)] = None,
    band_rows: Annotated[int | None, Parameter(group=_WORK)] = None,
    restart: Annotated[bool, Parameter(negative=(), show_default=False, group=_WORK)] = False,
    overrides: Annotated[Overrides | None, Parameter(name="*", group=_SETTINGS)] = None,
) -> None:
    """Match a pair larger than memory, from file to file.

    The command reads, matches and writes the pair band by band. The result equals that of the whole
    pair at one scale, to the bit. After an interruption, the same command continues. For example:

    ```
    phasestereo large left.tif right.tif --num-disparities 256 --max-memory 2GB -o out.tif
    ```

    Parameters
    ----------
    left
        Left image: a TIFF file, a Zarr array, or .npy.
    right
        Right image, of the same size and type.
    output
        File for the disparities in pixels: .tif (which keeps the georeference of the left image),
        .npy or .zarr.
    flags_output
        File for the flags, 16 bits, in the same formats.
    confidence_output
        File for the confidences, 0 to 1.
    uncertainty_output
        File for the error bars in pixels: half the width of the interval that holds the true
        disparity with a probability of 90 %.
    json
        Print one JSON object on standard output: size, settings, memory, flags, files.
    num_disparities
        Number of disparities to search.
    min_disparity
        Smallest disparity to search.
    left_mask
        File as large as the left image, in one of its formats, non-zero at valid pixels.
    right_mask
        The same for the right image.
    bands
        Number of the band of TIFF images to match, or 3,2,1 for red, green and blue.
    noise
        Standard deviation of the images' noise, in units of their pixels; needed with
        --noise-threshold.
    max_memory
        Total memory that the program may take, such as 2GB or 800MiB.
    threads
        Number of threads; without it, one per processor.
    band_rows
        Rows of a band; default: the most that the memory allows.
    restart
        Drop the finished bands of an earlier run.
    """
    with refusals(options=_OPTIONS):
        settings = resolve(preset, None, overrides or {})

    try:
        with refusals(options=_OPTIONS), progress_bar("Matching") as progress:
            report = outofcore.match(
                left,
                right,
                output,
                num_disparities=num_disparities,
                max_memory=max_memory,
                min_disparity=min_disparity,
                settings=settings,
                threads=threads,
                left_mask=left_mask,
                right_mask=right_mask,
                bands=bands,
                known=Known(noise=noise),
                flags_output=flags_output,
                confidence_output=confidence_output,
                uncertainty_output=uncertainty_output,
                band_rows=band_rows,
                restart=restart,
                announce=_show_plan,
                progress=progress,
                stage=say,
            )
    except KeyboardInterrupt:
        say("finished bands are kept: the same command goes on from there")
        raise

    _show(report, as_json=json)


def _show_plan(plan: Plan) -> None:
    """Print the memory and time of a run, before it starts and again after its first band."""
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
    """Return a duration in words, rounded as much as an estimate deserves."""
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

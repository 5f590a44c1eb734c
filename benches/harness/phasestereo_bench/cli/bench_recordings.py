"""``phasestereo bench recordings``: raw frames of rigs -> what can be scored without a truth."""

# No `from __future__ import annotations`: the command line is made of these annotations.

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from phasestereo.cli.errors import refusals
from phasestereo_bench.cli.bench_middlebury import rivals
from phasestereo_bench.cli.bench_runs import AS_USUAL, RunOptions, Suite
from phasestereo_bench.cli.parameters import Names, Output
from phasestereo_bench.real import find_recording, recording_jobs
from phasestereo_bench.tables.plan import TIMED
from phasestereo_bench.tables.recorded import agreement_table, rows_table


def recordings(
    *folders: Path,
    method: Names = (),
    hitnet: Path | None = None,
    output: Output = Path("recordings.jsonl"),
    running: Annotated[RunOptions, Parameter(name="*")] = AS_USUAL,
) -> None:
    """Score matchers on raw frames of real rigs, whose depth nobody knows.

    Rows are held against the calibration; every method matches each frame from either side, raw
    and rectified. A run that was interrupted goes on where it stopped. For example:

    ```
    phasestereo bench recordings DATA/rigs/euroc -o recordings.jsonl
    ```

    Parameters
    ----------
    folders
        Of one rig each: its frames (cam0 and cam1, left and right, left*.png and right*.png, or
        pictures of both views) and its calibration, as `phasestereo rectify` takes a folder.
    method
        As of `bench middlebury`. Without it, ours and OpenCV's.
    hitnet
        HITNet's ONNX file for ETH3D: the network takes part, too, if onnxruntime is installed.
    output
        File for the records.
    """
    with refusals(options={"method", "hitnet"}):
        if not folders:
            raise ValueError("no folder given: where are the frames?")

        methods = [*(method or TIMED), *rivals(hitnet)]
        Suite(
            jobs=[j for place in folders for j in recording_jobs(find_recording(place), methods)],
            cells="cells",
            names=("method", "recording"),
            tables=lambda good: {
                "Rows off, px rms: mean, worst frame": rows_table(good),
                "Left and right agree; the method trusts itself": agreement_table(good),
            },
        ).run(output, running)

"""``phasestereo bench surfaces``: rooms, upsampled scenes, table tops -> records and a table."""

# No `from __future__ import annotations`: the command line is made of these annotations.

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from phasestereo.cli.errors import refusals
from phasestereo_bench.cli.bench_middlebury import rivals
from phasestereo_bench.cli.bench_runs import AS_USUAL, RunOptions, Suite
from phasestereo_bench.cli.parameters import (
    RUN,
    SCENES,
    SEVERAL,
    Folders,
    Names,
    Natural,
    RecordsFile,
)
from phasestereo_bench.surfaces import (
    MEGAPIXELS,
    SEEDS,
    default_methods,
    surface_cases,
    surface_jobs,
    surface_table,
    upsampled_table,
)

_OPTIONS = {"megapixels", "seeds", "method", "hitnet"}


def surfaces(
    *folders: Folders,
    megapixels: Annotated[tuple[float, ...], SEVERAL, Parameter(group=SCENES)] = MEGAPIXELS,
    seeds: Annotated[Natural, Parameter(group=SCENES)] = SEEDS,
    method: Names = (),
    hitnet: Path | None = None,
    output: RecordsFile = Path("surfaces.jsonl"),
    running: Annotated[RunOptions, Parameter(name="*", group=RUN)] = AS_USUAL,
) -> None:
    """Score matchers on plain, slanted and curved surfaces, and on finer samplings of a scene.

    Rooms with plain walls, tables and things are rendered at several sizes. Folders add scenes
    that are upsampled, scenes with large planes, and real table tops. The table has bad-1 and bad-2
    by kind of pixel, and the share of neighbors in a column that differ by more than 2 px, beside
    that of the truth. It takes about three minutes on one core. For example:

    ```
    phasestereo bench surfaces ~/middlebury ~/planes ~/tabletop
    phasestereo bench surfaces --megapixels 12 --seeds 1 --method robust:num_disparities=auto
    ```

    Parameters
    ----------
    folders
        Official folder trees of Middlebury's scenes, of which Art, Moebius, Aloe and Lampshade1 are
        upsampled; and folders with tabletop/NAME/left.png, right.png and disparity.png. Without
        any, rooms alone.
    megapixels
        Sizes of the rooms; 0.5 and 2 without it. One of 12 takes a minute and a half to render; the
        memory of opencv:sgbm grows with pixels times disparities.
    seeds
        How many rooms of each kind and size.
    method
        What to compare, as of ``phasestereo bench middlebury``; default: ours, nothing given, and
        opencv:sgbm, which is given the range.
    hitnet
        HITNet's ONNX file for ETH3D: the network takes part, too, if onnxruntime is installed.
    output
        File for the records.
    """
    with refusals(options=_OPTIONS):
        cases = surface_cases(folders, megapixels=megapixels, seeds=seeds)
        Suite(
            jobs=surface_jobs(cases, [*(method or default_methods()), *rivals(hitnet)]),
            cells="maps",
            names=("method", "scene", "row"),
            tables=lambda good: {
                "Off by more than 1 / 2 px, %; stripes (of the truth), %": surface_table(good),
                "Upsampled scenes at their own scale: bad-1, %": upsampled_table(good),
            },
        ).run(output, running)

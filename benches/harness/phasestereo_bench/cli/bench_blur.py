"""``phasestereo bench blur``: blurs that are known, and whether they are found -> a table."""

# No `from __future__ import annotations`: the command line is made of these annotations.

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from phasestereo.cli.errors import refusals
from phasestereo_bench.blur import blur_jobs, blur_table, explain_blur
from phasestereo_bench.cli.bench_runs import AS_USUAL, RunOptions, Suite
from phasestereo_bench.cli.bench_scenes import ALL, SceneChoice
from phasestereo_bench.cli.parameters import RUN, SCENES, Folders, Positive, RecordsFile

_OPTIONS = {"scene", "every"}
_SUITE = "one-sided-blur"


def blur(
    *folders: Folders,
    choice: Annotated[SceneChoice, Parameter(name="*", group=SCENES)] = ALL,
    every: Annotated[Positive, Parameter(group=RUN)] = 1,
    output: RecordsFile = Path("blur.jsonl"),
    running: Annotated[RunOptions, Parameter(name="*", group=RUN)] = AS_USUAL,
) -> None:
    """Blur Middlebury pairs by known kernels, and check whether that blur is found.

    Every scene is tried 109 times: as it is; with the left or the right image blurred by Gaussians,
    disks and motions of many sizes, with noise of 1 or 2 gray levels; and with both images blurred
    alike, which is not a relative blur. Each trial becomes a record in a file of JSON lines as soon
    as it is done. A run that was interrupted goes on where it stopped when the same command is
    given again. For example:

    ```
    phasestereo bench blur ~/middlebury -o blur.jsonl
    phasestereo bench blur ~/middlebury --every 7
    ```

    Parameters
    ----------
    folders
        Official folder trees: folders that hold scenes2001, MiddEval3 and so on, or one of these,
        or one scene in it.
    every
        Run every N-th trial, for a quick look.
    output
        File for the records.
    """
    with refusals(options=_OPTIONS):
        Suite(
            jobs=blur_jobs(choice.select(folders, _SUITE), every=every),
            cells="trials",
            names=("family", "size", "scene"),
            tables=lambda good: {"Blur that was found": blur_table(good)},
            words=lambda good: [explain_blur(good)],
            title="Estimating",
        ).run(output, running)

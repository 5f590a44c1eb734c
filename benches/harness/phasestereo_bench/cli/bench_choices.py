"""``phasestereo bench choices``: the presets with one setting changed at a time."""

# No `from __future__ import annotations`: the command line is made of these annotations.

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators
from rich.console import Console

from phasestereo.cli.errors import CommandError, refusals
from phasestereo_bench.cli.bench_runs import prepare, run_cells
from phasestereo_bench.cli.bench_scenes import SceneChoice
from phasestereo_bench.cli.bench_tables import filled
from phasestereo_bench.tables.ours import choice_jobs, choice_table

_COUNT = validators.Number(gte=0)
_ALL = SceneChoice()
_PIPED_WIDTH = 120


def choices(
    *folders: Path,
    choice: Annotated[SceneChoice, Parameter(name="*")] = _ALL,
    output: Annotated[Path, Parameter(alias="-o")] = Path("choices.jsonl"),
    workers: Annotated[int | None, Parameter(validator=_COUNT)] = None,
    fresh: Annotated[bool, Parameter(negative=(), show_default=False)] = False,
) -> None:
    """Measure what the presets' settings are worth: one of them changed at a time.

    Pairs are sharp, with one image blurred, and with both noisy or compressed. Prints the share of
    the non-occluded pixels that are more than 1 px off, means over the scenes. A run that was
    interrupted goes on where it stopped when the same command is given again. For example:

    ```
    phasestereo bench choices ~/middlebury --scene tsukuba cones Aloe
    ```

    Parameters
    ----------
    folders
        Official folder trees: folders that hold scenes2001, MiddEval3 and so on.
    output
        File for the records.
    workers
        Number of processes, each on one thread; without it, as many as there are processors. 0
        runs everything in one process.
    fresh
        Begin anew: rename an existing file of records, and run every cell.
    """
    with refusals(options={"scene"}):
        scenes, _ = choice.select(folders, "one-sided-blur")
        jobs = choice_jobs(scenes)
        prepare(output, jobs, cells="cells", fresh=fresh)
        records = run_cells(jobs, output, workers=workers, title="Matching", cells="cells")

    console = Console(highlight=False, width=None if sys.stdout.isatty() else _PIPED_WIDTH)
    console.print(filled(f"More than 1 px off, %, {len(scenes)} scenes", choice_table(records)))
    if any(record["status"] != "ok" for record in records):
        raise CommandError(f"cells failed: the reasons are in {output}")

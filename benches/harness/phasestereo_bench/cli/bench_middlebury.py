"""``phasestereo bench middlebury``: methods x scenes x degradations -> a table."""

# No `from __future__ import annotations`: the command line is made of these annotations.

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from phasestereo.cli.errors import refusals
from phasestereo.cli.terminal import say
from phasestereo_bench.cases import SUITES
from phasestereo_bench.cli.bench_report import show_results
from phasestereo_bench.cli.bench_runs import AS_USUAL, RunOptions, require_done
from phasestereo_bench.cli.bench_scenes import ALL, SceneChoice
from phasestereo_bench.cli.parameters import CELLS, RUN, SCENES, Flag, Folders, Names, RecordsFile
from phasestereo_bench.methods import method as method_of, present
from phasestereo_bench.middlebury import default_methods, middlebury_jobs
from phasestereo_bench.report.results import results_of
from phasestereo_bench.rigs import QUICK_SCENES
from phasestereo_bench.store import read_store

_OPTIONS = {"suite", "degradation", "side", "method", "hitnet", "scene"}
_SUITE_HELP = f"Which degradations: {', '.join(SUITES)}."


def middlebury(
    *folders: Folders,
    choice: Annotated[SceneChoice, Parameter(name="*", group=SCENES)] = ALL,
    suite: Annotated[str, Parameter(group=CELLS, help=_SUITE_HELP)] = "one-sided-blur",
    degradation: Annotated[Names, Parameter(group=CELLS)] = (),
    side: Annotated[Names, Parameter(group=CELLS)] = (),
    method: Annotated[Names, Parameter(group=CELLS)] = (),
    hitnet: Annotated[Path | None, Parameter(group=CELLS)] = None,
    quick: Annotated[Flag, Parameter(group=SCENES)] = False,
    output: RecordsFile = Path("results.jsonl"),
    running: Annotated[RunOptions, Parameter(name="*", group=RUN)] = AS_USUAL,
) -> None:
    """Score matchers on Middlebury pairs of which one image is degraded.

    Every combination of method, scene and degradation is a cell, which becomes a record in a file
    of JSON lines as soon as it is done. A run that was interrupted goes on where it stopped when
    the same command is given again. Half and full size of MiddEval3 (trainingH, trainingF) have
    tables of their own. For example:

    ```
    phasestereo bench middlebury ~/middlebury
    phasestereo bench middlebury ~/middlebury --suite sharp --method paper opencv:sgbm
    phasestereo bench middlebury ~/middlebury --suite sharp --scene "training?/*" --method robust
    ```

    Parameters
    ----------
    folders
        Official folder trees: folders that hold scenes2001, MiddEval3 and so on, or one of these,
        or one scene in it.
    quick
        Only tsukuba, cones and Aloe, unless --scene names others: minutes, and figures of three.
    degradation
        Only these of the suite, such as "gauss 2".
    side
        Which image is degraded: left, right, or both one after the other; alternating is the left
        one of every other scene. Without it, alternating for rigs and rigs-2, else left.
    method
        What to compare: a preset or baseline (robust, paper, fast, sad, nsad), other settings of it
        (paper:neighborhood=11,window=9; robust:num_disparities=auto gets no range), opencv:bm,
        opencv:sgbm, opencv:sgbm-5way, opencv:sgbm-3way, opencv:sgbm-3x3, mccnn, onnx:FILE.onnx,
        "program:COMMAND {left} {right} {num_disparities} {output}", or
        package.module:function; with prepared: before it, as prepared:sgbm, on the pair as
        `prepare` makes it; with fused: as the second matcher of `match`; with +true-blur after it,
        the sharp image is first blurred like the other one. Without it, what the suite is for.
    hitnet
        HITNet's ONNX file for ETH3D: the network takes part, too, if onnxruntime is installed.
    output
        File for the records.
    """
    with refusals(options=_OPTIONS):
        if quick and not choice.scene:
            choice = replace(choice, scene=tuple(sorted(QUICK_SCENES)))

        scenes = choice.select(folders, suite)
        methods = [*(method or default_methods(suite)), *rivals(hitnet)]
        jobs = middlebury_jobs(
            scenes, methods, degradation or None, suite=suite, sides=side or None
        )

        for entrant in map(method_of, methods):
            if "license" in entrant.settings:
                say(f"{entrant}: license of the weights: {entrant.settings['license']}")

        records = running.run(jobs, output, cells="cells")

    known = [line for line in read_store(output) if line["kind"] == "environment"]
    further = [f"Records: {output}; a plot: phasestereo bench report {output}"]
    for shown in dict.fromkeys(record["side"] for record in records if record["status"] == "ok"):
        own = [*known, *(record for record in records if record["side"] == shown)]
        results = results_of({str(number): line for number, line in enumerate(own)})
        show_results(results, "v2.nonocc", further)

    require_done(records, "cells", "method", "scene", "degradation")


def rivals(hitnet: Path | None, others: Sequence[str] = ()) -> list[str]:
    """Return HITNet, if its file is given, and others; say in a sentence what cannot run here."""
    specs = [f"hitnet:{hitnet.resolve()}"] if hitnet is not None else []
    there, missing = present([*specs, *others])
    for sentence in missing:
        say(sentence)
    return there

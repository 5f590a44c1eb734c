"""``phasestereo bench middlebury`` records cells; ``report`` prints tables and draws a plot."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from phasestereo.cli.errors import refusals
from phasestereo.cli.terminal import say
from phasestereo_bench.cases import SUITES
from phasestereo_bench.cli.bench_runs import AS_USUAL, RunOptions, require_done
from phasestereo_bench.cli.bench_scenes import ALL, SceneChoice
from phasestereo_bench.cli.bench_tables import show
from phasestereo_bench.cli.parameters import CELLS, RUN, SCENES, Flag, Folders, Names, RecordsFile
from phasestereo_bench.methods import method as method_of, present
from phasestereo_bench.middlebury import default_methods, middlebury_jobs
from phasestereo_bench.report.cells import KIND, METRIC, METRICS
from phasestereo_bench.report.origin import explain, made_with
from phasestereo_bench.report.plots import draw_means, save_plot
from phasestereo_bench.report.results import Results, read_results, results_of
from phasestereo_bench.report.sharp import sharp_tables
from phasestereo_bench.report.tables import cost_table, mean_table
from phasestereo_bench.rigs import QUICK_SCENES
from phasestereo_bench.store import read_store

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
    """Score matchers on Middlebury pairs with one degraded image.

    Every combination of method, scene and degradation is a cell. Each cell becomes a record in a
    file of JSON lines as soon as it is done. To continue an interrupted run, give the same command
    again. Half and full size of MiddEval3 (trainingH, trainingF) have their own tables. For
    example:

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
        Use only tsukuba, cones and Aloe, unless --scene names others: takes minutes, and the
        figures cover three scenes.
    degradation
        Only these degradations of the suite, such as "gauss 2".
    side
        Image to degrade: left, right, or both one after the other; alternating is the left one of
        every other scene. Without it, alternating for rigs and rigs-2, else left.
    method
        Methods to compare: a preset or baseline (robust, paper, fast, sad, nsad), other settings of
        it (paper:neighborhood=11,window=9; robust:num_disparities=auto gets no range), opencv:bm,
        opencv:sgbm, opencv:sgbm-5way, opencv:sgbm-3way, opencv:sgbm-3x3, mccnn, onnx:FILE.onnx,
        "program:COMMAND {left} {right} {num_disparities} {output}", or package.module:function;
        with prepared: before it, as prepared:sgbm, on the pair as `prepare` makes it; with fused:
        as the second matcher of `match`; with +true-blur after it, the sharp image is first blurred
        like the other one. Without it, the default methods of the suite.
    hitnet
        HITNet's ONNX file for ETH3D; the network also takes part if onnxruntime is installed.
    output
        File for the records.
    """
    with refusals(options={"suite", "degradation", "side", "method", "hitnet", "scene"}):
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
        show_results(results, METRIC, further)

    require_done(records, "cells", "method", "scene", "degradation")


def rivals(hitnet: Path | None, others: Sequence[str] = ()) -> list[str]:
    """Return HITNet, if its file is given, and others; print which of them cannot run here."""
    specs = [f"hitnet:{hitnet.resolve()}"] if hitnet is not None else []
    there, missing = present([*specs, *others])
    for sentence in missing:
        say(sentence)
    return there


def report(
    *results: Path,
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    metric: str = METRIC,
    method: Names = (),
    suite: str | None = None,
    side: str | None = None,
) -> None:
    """Report on the records of ``bench middlebury``: tables, and a plot.

    The command prints the means over the scenes. For other benchmarks, give their command again to
    print their tables again. For example:

    ```
    phasestereo bench report results.jsonl -o means.svg
    phasestereo bench report results.jsonl --metric v3.bad_2 --method paper opencv:sgbm
    ```

    Parameters
    ----------
    results
        Files of records. If a cell has several records, the last one counts.
    output
        File for a plot of the means, .svg or .png.
    metric
        Number to show: v2.nonocc, v2.all, v2.disc, v3.bad_0_5, v3.bad_1, v3.bad_2, v3.bad_4,
        v3.invalid, v3.avgerr, v3.rms, v3.a50, v3.a90, v3.a95, v3.a99, d1, epe or roc.
    method
        Only these methods, in this order, each as a table names it.
    suite
        Only this suite; needed if there are results of several.
    side
        Only cells with this image degraded, left or right; needed if there are both.
    """
    with refusals(options={"metric", "method", "suite", "side", "output"}):
        if not results:
            raise ValueError("no file of records given")

        loaded = read_results(results, suite=suite, side=side, methods=method)
        loaded.require_metric(metric)

        if output is not None:
            save_plot(draw_means(loaded, metric), output)

    kinds = {record["kind"] for path in results for record in read_store(path)}
    rest = ", ".join(sorted(kinds - {KIND, "environment"}))
    further = [f"Left out, records of other benchmarks: {rest}"] if rest else []
    further += [] if output is None else [f"Wrote {output}"]
    show_results(loaded, metric, further)


def show_results(results: Results, metric: str, further: Sequence[str]) -> None:
    """Print tables, their explanation, the environments, the failures, and further lines."""
    failed = [f"{c.place}, {c.degradation}, {c.method} failed: {c.error}" for c in results.failures]
    show(
        {
            METRICS[metric].label: mean_table(results, metric),
            **sharp_tables(results),
            "One pair, one thread": cost_table(results),
        },
        *(explain(results, metric), made_with(results.environments.values()), *failed, *further),
    )

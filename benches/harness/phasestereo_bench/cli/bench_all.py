"""``phasestereo bench tables`` makes every table of the documentation from one folder of data."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter, validators

from phasestereo.cli.errors import refusals
from phasestereo.cli.terminal import say
from phasestereo_bench.cases import require_known
from phasestereo_bench.cli.bench_middlebury import rivals
from phasestereo_bench.cli.bench_runs import RunOptions, require_done
from phasestereo_bench.cli.bench_speed import speed_suite
from phasestereo_bench.cli.parameters import SEVERAL, Flag, Names, Natural, Output
from phasestereo_bench.report.documents import fill_places
from phasestereo_bench.report.markdown import marked
from phasestereo_bench.tables import export, job_groups, table_texts
from phasestereo_bench.tables.plan import HITNET

_OPTIONS = {"hitnet", "method", "only"}


def tables(
    data: Path,
    /,
    *,
    hitnet: Path | None = None,
    readme: Annotated[tuple[Path, ...], SEVERAL] = (),
    export_to: Annotated[Path | None, Parameter(name="--export")] = None,
    output: Output = Path("tables"),
    workers: Annotated[int | None, Parameter(validator=validators.Number(gte=0))] = None,
    speed_rounds: Natural = 5,
    only: Names = (),
    quick: Flag = False,
    fresh: Flag = False,
) -> None:
    """Make every table of the documentation (all suites, real rigs, times) in an hour.

    Learned rivals take part if they are available: HITNet by its file, MC-CNN if the package mccnn
    is installed. To continue an interrupted run, give the same command again. The command also
    keeps records of an earlier version of the matcher, unless you add --fresh. For example:

    ```
    phasestereo bench tables DATA -o tables --readme README.md docs/suites.md
    phasestereo bench tables DATA --only rigs --readme docs/suites.md
    phasestereo bench tables DATA -o quick --quick --speed-rounds 0
    ```

    Parameters
    ----------
    data
        Folder with middlebury, and if possible planes, tabletop, rigs/euroc, rigs/stereopi,
        real_defocus/breakfast, large/chess_1920x1080 and rivals/hitnet_eth3d.onnx.
    hitnet
        HITNet's ONNX file for ETH3D. Without it, rivals/hitnet_eth3d.onnx below the data.
    readme
        Markdown files to update: tables between markers are replaced, everything else stays.
    export_to
        JSON file for the numbers. Without it, results.json in the output folder.
    output
        Folder for the records; created if needed.
    workers
        Number of processes, each on one thread, where time does not count; default: one
        per processor.
    speed_rounds
        Number of times that `bench speed` matches each of its pairs; 0 skips it.
    only
        Make only these tables: a suite, choices, synthesis, rendered, surfaces, blur, real, costs
        or speed.
    quick
        Use only three small scenes, and put no table into a document.
    fresh
        Start over: rename existing files of records.
    """
    with refusals(options=_OPTIONS):
        weights = hitnet or data / HITNET
        learned = rivals(weights if hitnet or weights.is_file() else None, ["mccnn"])

        output.mkdir(parents=True, exist_ok=True)
        done: list[dict[str, Any]] = []

        groups = {group.name: group for group in job_groups(data, learned, quick=quick)}
        require_known("only", only, (*groups, "speed"))

        for group in [group for name, group in groups.items() if name in (only or groups)]:
            store = output / f"{group.name}.jsonl"
            many, title = 1 if group.alone else workers, group.name.capitalize()
            running = RunOptions(workers=many, fresh=fresh)
            done += running.run(group.jobs, store, cells="cells", title=title)

        if speed_rounds and not quick and (not only or "speed" in only):
            store = output / "speed.jsonl"
            suite = speed_suite(data, store, rounds=speed_rounds)
            running = RunOptions(workers=0, fresh=fresh)
            running.run(suite.jobs, store, cells=suite.cells, title="Speed")

        export(output, export_to or output / "results.json")
        if not quick:
            _fill(readme, output)
    say(f"records and numbers: {output}")
    require_done(done, "cells", "kind")


def _fill(documents: tuple[Path, ...], output: Path) -> None:
    """Replace the tables in documents; each document gets the tables that it has places for."""
    texts = table_texts(output)
    for document in documents:
        there = marked(document.read_text("utf-8"))
        mine = {name: text for name, text in texts.items() if name in there}
        if mine:
            fill_places(document, mine)
        for name in sorted(there - texts.keys()):
            say(f"{document}: there are no records for {name}; its table stays as it is")

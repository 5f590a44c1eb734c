"""These commands write files: for sites, for a page of comparisons, for the paper's page."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from phasestereo.cli.errors import refusals
from phasestereo.cli.terminal import progress_bar, say
from phasestereo_bench.cli.bench_scenes import SceneChoice
from phasestereo_bench.cli.bench_tables import show
from phasestereo_bench.cli.parameters import Flag, Output
from phasestereo_bench.paper import claims_table, judge_claims, load_pairs, run_study, write_study
from phasestereo_bench.report.documents import fill_places
from phasestereo_bench.submission import submit as submitted
from phasestereo_bench.tables.comparison import comparison_text, draw_comparison, read_numbers

_EACH = SceneChoice(scene=("*",))


def submit(
    *folders: Path,
    choice: Annotated[SceneChoice, Parameter(name="*")] = _EACH,
    method: str = "robust",
    name: str = "phasestereo",
    output: Output = Path("submission"),
) -> None:
    """Write the zip files that the sites of Middlebury, ETH3D and KITTI take.

    Scenes need no truth. The command matches each scene once, on one thread, one after the other.
    For example:

    ```
    phasestereo bench submit ~/MiddEval3 --scene "trainingH/*" "testH/*"
    phasestereo bench submit ~/kitti2015/testing --method mine:match --name Mine
    ```

    Parameters
    ----------
    folders
        Folders that hold MiddEval3, two_view_training, two_view_test, kitti2012 or kitti2015.
    method
        Method to match with, as in `bench middlebury`.
    name
        Name of the method on the site: letters, digits, - and _.
    output
        Folder for the files, and for one zip per site and size.
    """
    with refusals(options={"scene", "method", "name"}):
        scenes = choice.select(folders, "sharp", silent=True)
        with progress_bar("Matching") as progress:
            archives, said = submitted(scenes, method, name, output, progress=progress)

    for line in (*said, *(f"{path}: {count} scenes" for path, count in archives.items())):
        say(line)


def compare(
    numbers: Path,
    /,
    *,
    output: Output = Path("compare"),
    readme: Path | None = None,
) -> None:
    """Compare our presets with other methods: errors against time, by fault, by kind of pixel.

    For example:

    ```
    phasestereo bench compare docs/results.json -o docs/images --readme docs/compare.md
    ```

    Parameters
    ----------
    numbers
        The file results.json that bench tables writes.
    output
        Folder for the SVG pictures.
    readme
        Markdown file to update: the table between the comments ``<!-- bench:compare -->`` and
        ``<!-- /bench:compare -->`` is replaced.
    """
    with refusals():
        found = read_numbers(numbers)
        output.mkdir(parents=True, exist_ok=True)
        written = draw_comparison(found, output)
        if readme is not None:
            fill_places(readme, {"compare": comparison_text(found)})
            written.append(readme)

    for path in written:
        say(f"wrote {path}")


def paper(
    folder: Path,
    /,
    *,
    output: Output = Path("paper"),
    workers: int | None = None,
    quick: Flag = False,
) -> None:
    """Run the experiments of the paper, and compare its claims with the results.

    The command matches Cones and Tsukuba by phase codes, SAD and normalized SAD, with the left
    image blurred by a growing motion, Gaussian, or mixture of degradations. It writes the numbers,
    Figures 2 and 3, and a page of tables with a verdict on every claim (paper.md). It takes a
    minute or two. To continue an interrupted run, give the same command again. For example:

    ```
    phasestereo bench paper ~/middlebury -o paper
    ```

    Parameters
    ----------
    folder
        Middlebury's folder tree, with scenes2003/cones and scenes2001/tsukuba.
    output
        Folder for all files; created if needed. Files of an earlier run in it are replaced.
    workers
        Number of processes, each on one thread; without it, one per processor. 0
        runs everything in one process.
    quick
        Use few levels of blur and few settings, to see it work, not to judge the paper.
    """
    with refusals(options={"workers"}):
        pairs = load_pairs(folder)
        output.mkdir(parents=True, exist_ok=True)
        store = output / "results.jsonl"

        try:
            study = run_study(pairs, store, quick=quick, workers=workers, watch=progress_bar)
        except KeyboardInterrupt:
            say(f"{store} keeps what is done; the same command goes on")
            raise

        page = write_study(study, store, output)[-1]

    claims = claims_table(judge_claims(study.readings))
    show({"The paper's claims": claims}, f"All tables: {page}")

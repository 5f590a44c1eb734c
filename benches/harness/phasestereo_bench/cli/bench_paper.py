"""``phasestereo bench paper``: the paper's experiments, its tables, and its claims."""

# No `from __future__ import annotations`: the command line is made of these annotations.

from pathlib import Path

from phasestereo.cli.errors import refusals
from phasestereo.cli.terminal import progress_bar, say
from phasestereo_bench.cli.bench_tables import show
from phasestereo_bench.cli.parameters import Flag, Output
from phasestereo_bench.paper import claims_table, judge_claims, load_pairs, run_study, write_study


def paper(
    folder: Path,
    /,
    *,
    output: Output = Path("paper"),
    workers: int | None = None,
    quick: Flag = False,
) -> None:
    """Run the experiments of the paper, and put its claims beside what comes out.

    Matches Cones and Tsukuba, the left image being blurred by a growing motion, Gaussian, or
    mixture of degradations, by phase codes, SAD and normalized SAD. Writes the numbers, Figures 2
    and 3, and a page of tables with a verdict on every claim (paper.md). Takes a minute or two; a
    run that was interrupted goes on where it stopped when the same command is given again. For
    example:

    ```
    phasestereo bench paper ~/middlebury -o paper
    ```

    Parameters
    ----------
    folder
        Middlebury's folder tree, with scenes2003/cones and scenes2001/tsukuba.
    output
        Folder for everything; made if need be. Files of an earlier run in it are replaced.
    workers
        Number of processes, each on one thread; without it, one per processor. 0
        runs everything in one process.
    quick
        Few levels of blur and few settings: to see it work, not to judge the paper.
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

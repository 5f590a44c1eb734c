"""``phasestereo bench speed`` times our matchers and OpenCV's in turn; makes records, tables."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from phasestereo._extras import require
from phasestereo.cli.errors import refusals
from phasestereo.cli.terminal import say
from phasestereo_bench.cli.bench_runs import Records, RunOptions, Suite
from phasestereo_bench.cli.parameters import Flag, Output, Positive
from phasestereo_bench.report.origin import made_with
from phasestereo_bench.report.tables import Table
from phasestereo_bench.speed import (
    PAIRS,
    explain_speed,
    find_pairs,
    memory_table,
    speed_jobs,
    time_table,
)
from phasestereo_bench.store import read_good, read_store

_BEFORE = (
    "before: our time divided by that of the last record of another core on this machine, both "
    "relative to SGBM 3-way."
)
_PAIRS_HELP = f"Only these: {', '.join(PAIRS)}; or rendered ones of any size: 0.1MPx16, 24MPx512."


def speed(
    data: Annotated[Path | None, Parameter(env_var="PHASESTEREO_DATA")] = None,
    /,
    *,
    pairs: Annotated[
        tuple[str, ...], Parameter(consume_multiple=True, show_default=False, help=_PAIRS_HELP)
    ] = (),
    rounds: Positive = 15,
    output: Output = Path("speed.jsonl"),
    fresh: Flag = False,
) -> None:
    """Time a match against OpenCV's StereoBM and StereoSGBM.

    All matchers match the same gray pairs in turn, in one process. Ours runs with either preset,
    first on one thread and then on all. Each matcher also runs once in its own process, to measure
    its memory. The command takes about a quarter of an hour; please run it on an idle machine. To
    continue an interrupted run, give the same command again. With another core, the same file of
    records shows what became slower or faster. For example:

    ```
    phasestereo bench speed data -o speed/speed.jsonl
    phasestereo bench speed --pairs full-hd 24MPx512 --rounds 5
    ```

    Parameters
    ----------
    data
        Folder with middlebury/scenes2001/tsukuba, middlebury/scenes2003/cones,
        middlebury/MiddEval3/trainingQ/Motorcycle and large/chess_1920x1080/left.png, right.png.
        Missing pairs are left out. Without it, there are only rendered pairs.
    rounds
        Number of times that each matcher matches each pair; medians count.
    output
        File for the records; its folder is created if needed, and keeps rendered pairs.
    fresh
        Start over: rename an existing file of records.
    """
    with refusals(options={"pairs", "rounds"}):
        require("cv2", extra="opencv")  # fails before the user has waited

        output.parent.mkdir(parents=True, exist_ok=True)
        say(f"rendered pairs are kept in {output.parent}; each takes ten seconds a megapixel once")
        suite = speed_suite(data, output, names=pairs, rounds=rounds)
        suite.run(output, RunOptions(workers=0, fresh=fresh))


def speed_suite(
    data: Path | None, output: Path, *, names: tuple[str, ...] = (), rounds: int
) -> Suite:
    """Return the suite of the available pairs, and print those left out.

    Raises
    ------
    ValueError
        If no pair is available.
    """
    there, left_out = find_pairs(data, cache=output.parent, names=names)
    for line in left_out:
        say(line)
    if not there:
        raise ValueError("there is no pair to match")

    def tables(_: Records) -> dict[str, Table | None]:
        good, _ = read_good(output)
        times = time_table(good, read_store(output))
        title = "Times: ours, and the rivals' divided by ours"
        return {title: times, "Memory, MB": memory_table(good)}

    def words(_: Records) -> list[str]:
        good, ran_in = read_good(output)
        return [explain_speed(good), _BEFORE, made_with(ran_in)]

    return Suite(
        jobs=speed_jobs(there, rounds=rounds),
        cells="measurements",
        names=("pair", "threads"),
        tables=tables,
        words=words,
    )

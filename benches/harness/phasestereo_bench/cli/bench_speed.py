"""``phasestereo bench speed``: ours and OpenCV's matchers, timed in turn -> records and tables."""

# No `from __future__ import annotations`: the command line is made of these annotations.

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

    All of them match the same gray pairs in turn, in one process, ours with either preset first on
    one thread and then on all, and each once more in a process of its own, for its memory. Takes
    about a quarter of an hour, on an idle machine, please; a run that was interrupted goes on where
    it stopped when the same command is given again. With another core, the same file of records
    shows what became slower or faster. For example:

    ```
    phasestereo bench speed data -o speed/speed.jsonl
    phasestereo bench speed --pairs full-hd 24MPx512 --rounds 5
    ```

    Parameters
    ----------
    data
        Folder with middlebury/scenes2001/tsukuba, middlebury/scenes2003/cones,
        middlebury/MiddEval3/trainingQ/Motorcycle and large/chess_1920x1080/left.png, right.png.
        What is not there is left out. Without it, there are only pairs that are rendered.
    rounds
        How often each matches each pair; medians count.
    output
        File for the records; its folder is made if need be, and keeps rendered pairs.
    fresh
        Begin anew: rename an existing file of records.
    """
    with refusals(options={"pairs", "rounds"}):
        require("cv2", extra="opencv")  # known before anybody has waited

        output.parent.mkdir(parents=True, exist_ok=True)
        say(f"rendered pairs are kept in {output.parent}; each takes ten seconds a megapixel once")
        suite = speed_suite(data, output, names=pairs, rounds=rounds)
        suite.run(output, RunOptions(workers=0, fresh=fresh))


def speed_suite(
    data: Path | None, output: Path, *, names: tuple[str, ...] = (), rounds: int
) -> Suite:
    """Return the suite of the pairs that are there, and say which are left out.

    Raises
    ------
    ValueError
        If no pair is there.
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

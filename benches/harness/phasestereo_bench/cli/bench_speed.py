"""``phasestereo bench speed``: ours and OpenCV's matchers, timed in turn -> records and tables."""

# No `from __future__ import annotations`: the command line is made of these annotations.

import sys
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter, validators
from rich.console import Console

from phasestereo._extras import require
from phasestereo.cli.errors import CommandError, refusals
from phasestereo.cli.terminal import printable, progress_bar, say
from phasestereo_bench.cli.bench_tables import speed_screen
from phasestereo_bench.cli.stores import put_aside
from phasestereo_bench.runner import finished
from phasestereo_bench.speed import (
    PAIRS,
    GrayPair,
    find_pairs,
    read_speed,
    run_speed,
    speed_jobs,
)
from phasestereo_bench.store import read_store

_PAIRS_HELP = f"Only these: {', '.join(PAIRS)}; or rendered ones of any size: 0.1MPx16, 24MPx512."
_PIPED_WIDTH = 120


def speed(
    data: Annotated[Path | None, Parameter(env_var="PHASESTEREO_DATA")] = None,
    /,
    *,
    pairs: Annotated[
        tuple[str, ...], Parameter(consume_multiple=True, show_default=False, help=_PAIRS_HELP)
    ] = (),
    rounds: Annotated[int, Parameter(validator=validators.Number(gte=1))] = 15,
    output: Annotated[Path, Parameter(alias="-o")] = Path("speed.jsonl"),
    fresh: Annotated[bool, Parameter(negative=(), show_default=False)] = False,
) -> None:
    """Time a match against OpenCV's StereoBM and StereoSGBM.

    All of them match the same gray pairs in turn, in one process, ours with either preset first on
    one thread and then on all, and each once more in a process of its own, for its memory. Takes
    about a quarter of an hour, on an idle machine, please; a run that was interrupted goes on where
    it stopped when the same command is given again. For example:

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
        there = _load(data, output.parent, pairs)
        _prepare(output, there, rounds, fresh=fresh)

        try:
            with progress_bar("Matching") as progress:
                records = run_speed(there, output, rounds=rounds, progress=progress)
        except KeyboardInterrupt:
            say(f"{output} keeps what is done; the same command goes on")
            raise

        _show(output, records)


def _load(data: Path | None, cache: Path, names: tuple[str, ...]) -> list[GrayPair]:
    say(f"pairs that are rendered are kept in {cache}; each takes ten seconds a megapixel once")
    there, left_out = find_pairs(data, cache=cache, names=names)
    for line in left_out:
        say(line)

    if not there:
        raise ValueError("there is no pair to match")
    return there


def _prepare(output: Path, pairs: list[GrayPair], rounds: int, *, fresh: bool) -> None:
    """Put an earlier file of records aside, or say what is kept of it."""
    if not output.exists():
        return

    if fresh:
        say(f"renamed {output} to {put_aside(output)}")
        return

    jobs = speed_jobs(pairs, rounds=rounds)
    kept = finished(jobs, read_store(output))
    if kept:
        say(f"{len(kept)} of {len(jobs)} are in {output} already; --fresh measures them again")


def _show(output: Path, records: list[dict[str, Any]]) -> None:
    failed = [record for record in records if record["status"] != "ok"]
    if len(failed) < len(records):
        results = read_speed([output])

        console = Console(highlight=False, width=None if sys.stdout.isatty() else _PIPED_WIDTH)
        if results is not None:
            console.print(speed_screen(results))

        command = f"phasestereo bench report {output} --readme FILE.md"
        message = f"Records: {output}; into a document: {command}"
        console.print(printable(message), markup=False, soft_wrap=True)

    if failed:
        first = failed[0]
        raise CommandError(
            f"{len(failed)} of {len(records)} measurements failed, the first of them "
            f"{first['pair']} on {first['threads']} threads: {first['error']}"
        )

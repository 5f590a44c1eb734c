"""What commands that run a benchmark's cells share: earlier records, progress, and Ctrl-C."""

from __future__ import annotations

from itertools import count
from typing import TYPE_CHECKING, Any

from phasestereo.cli.errors import CommandError
from phasestereo.cli.terminal import progress_bar, say
from phasestereo_bench.environment import describe_environment
from phasestereo_bench.runner import Job, finished, run_jobs
from phasestereo_bench.store import read_store

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path


def _prepare(output: Path, jobs: Sequence[Job], *, cells: str, fresh: bool) -> None:
    """Put an earlier file of records aside, or say what is kept of it; `cells` is their name."""
    if not output.exists():
        return

    kept = finished(jobs, read_store(output))
    if fresh:
        names = (output.with_name(f"{output.name}.bak{number or ''}") for number in count())
        aside = next(name for name in names if not name.exists())
        output.rename(aside)
        say(f"renamed {output} to {aside}")
    elif kept:
        here = describe_environment()["id"]
        foreign = sum(record["environment"] != here for record in kept)
        reason = f", {foreign} of them from other versions or machines" if foreign else ""
        kept_already = f"{len(kept)} of {len(jobs)} {cells} are in {output} already{reason}"
        say(f"{kept_already}; --fresh reruns them")


def require_done(records: Sequence[Mapping[str, Any]], cells: str, *names: str) -> None:
    """Refuse records that failed, with the fields of these names of the first; `cells`: theirs.

    Raises
    ------
    CommandError
        If there is one.
    """
    failed = [record for record in records if record["status"] != "ok"]
    if failed:
        case = ", ".join(str(failed[0][name]) for name in names)
        count = f"{len(failed)} of {len(records)} {cells} failed"
        raise CommandError(f"{count}, the first of them {case}: {failed[0]['error']}")


def run_cells(
    jobs: Sequence[Job],
    output: Path,
    *,
    workers: int | None,
    fresh: bool,
    title: str,
    cells: str,
) -> list[dict[str, Any]]:
    """Run jobs under a progress bar; say what is there already, and when interrupted how to go on.

    Parameters
    ----------
    jobs, output, workers
        As for `phasestereo_bench.run_jobs`.
    fresh
        Whether an earlier file is put aside.
    title
        That of the progress bar.
    cells
        What the jobs are called.
    """
    _prepare(output, jobs, cells=cells, fresh=fresh)
    try:
        with progress_bar(title) as progress:
            return run_jobs(jobs, output, workers=workers, progress=progress)
    except KeyboardInterrupt:
        done = len(finished(jobs, read_store(output))) if output.exists() else 0
        say(f"{done} of {len(jobs)} {cells} are in {output}; the same command does the others")
        raise

"""Holds the shared parts of benchmark commands: earlier records, progress, Ctrl-C, and tables."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter, validators

from phasestereo.cli.errors import CommandError
from phasestereo.cli.terminal import progress_bar, say
from phasestereo_bench.cli.bench_tables import show
from phasestereo_bench.cli.parameters import Flag
from phasestereo_bench.environment import describe_environment
from phasestereo_bench.report.tables import Table
from phasestereo_bench.runner import Job, finished, run_jobs
from phasestereo_bench.store import read_store


def _prepare(output: Path, jobs: Sequence[Job], *, cells: str, fresh: bool) -> None:
    """Rename an earlier file of records, or print what is kept of it; `cells` names its records."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """Options for the run of a benchmark's cells.

    Parameters
    ----------
    workers
        Number of processes, each on one thread; without it, one per processor. 0
        runs everything in one process.
    fresh
        Start over: rename an existing file of records, and run everything.
    """

    workers: Annotated[int | None, Parameter(validator=validators.Number(gte=0))] = None
    fresh: Flag = False

    def run(
        self, jobs: Sequence[Job], output: Path, *, cells: str, title: str = "Matching"
    ) -> list[dict[str, Any]]:
        """Run jobs under a progress bar; print which records exist, and on Ctrl-C how to continue.

        Parameters
        ----------
        jobs, output
            As for `phasestereo_bench.run_jobs`.
        cells
            Noun for the jobs in messages.
        title
            Title of the progress bar.
        """
        _prepare(output, jobs, cells=cells, fresh=self.fresh)
        try:
            with progress_bar(title) as progress:
                return run_jobs(jobs, output, workers=self.workers, progress=progress)
        except KeyboardInterrupt:
            done = len(finished(jobs, read_store(output))) if output.exists() else 0
            say(f"{done} of {len(jobs)} {cells} are in {output}; the same command does the others")
            raise


AS_USUAL = RunOptions()
"""Run one process per processor, and continue where the last run stopped."""


Records = list[dict[str, Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Suite:
    """A benchmark: its jobs, each of which matches a case and judges the map, and its tables.

    Attributes
    ----------
    jobs
        Jobs to run.
    cells
        Noun for the jobs in messages.
    names
        The fields of a record that name its case.
    tables
        A function from the records of successful jobs to tables by their titles.
    words
        A function from these records to the lines below the tables.
    title
        Title of the progress bar.
    """

    jobs: Sequence[Job]
    cells: str
    names: tuple[str, ...]
    tables: Callable[[Records], Mapping[str, Table | None]]
    words: Callable[[Records], Iterable[str]] = lambda _: ()
    title: str = "Matching"

    def run(self, output: Path, running: RunOptions) -> None:
        """Run the jobs that are not done yet, and print the tables.

        Raises
        ------
        CommandError
            If a job failed.
        """
        records = running.run(self.jobs, output, cells=self.cells, title=self.title)
        good = [record for record in records if record["status"] == "ok"]
        if good:
            show(self.tables(good), *self.words(good), f"Records: {output}")
        require_done(records, self.cells, *self.names)

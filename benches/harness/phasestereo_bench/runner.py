"""Runs jobs on all cores, keeps one record of each, and resumes where an earlier run stopped."""

import json
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from phasestereo._numbers import as_integer
from phasestereo_bench.environment import describe_environment, usable_cpus
from phasestereo_bench.store import appending
from phasestereo_bench.worker import JobFields, next_outcome, perform, working

CellKey = tuple[tuple[str, ...], str]
Outcomes = Generator[tuple[int, JobFields], None, None]


@dataclass(frozen=True, slots=True)
class Job:
    """One cell of a benchmark.

    Parameters
    ----------
    key
        Fields that identify the cell; jobs with equal keys are the same cell.
    work
        Function to call; it must be in a module, because another process has to find it. It returns
        the record as JSON values.
    arguments
        Keyword arguments for it that can be pickled.
    """

    key: Mapping[str, str | int | float | bool | None]
    work: Callable[..., Mapping[str, Any]]
    arguments: Mapping[str, Any]


def run_jobs(
    jobs: Sequence[Job],
    store: Path,
    *,
    workers: int | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> list[dict[str, Any]]:
    """Run jobs, and keep a record of each in a file of JSON lines.

    A job is left out if the file has it from an earlier run; failed jobs run again. Every record is
    in the file as soon as its job is done. If a job raises or its process dies, its record says
    failed, and the others go on.

    Parameters
    ----------
    jobs
        Jobs to run.
    store
        File to append to; it is created if it does not exist.
    workers
        Number of processes, each with every library held to one thread; None: one for each
        processor. 0 runs the jobs in this process, one after another and without a limit on
        threads: for work that no other process can import, such as functions of a notebook; a crash
        then ends everything.
    progress
        Called as ``progress(done, total)`` at the start and after every job; both count the jobs to
        run.

    Returns
    -------
    list of dict
        The records of all jobs, in their order: ``{**key, "status": "ok", **returned, "seconds",
        "peak_bytes", "environment"}``, where seconds and peak_bytes from the work take precedence
        over those of the whole job; or ``{**key, "status": "failed", "error", "traceback",
        "environment"}``. The record that the work returns replaces no field of the key.

    Raises
    ------
    OSError
        If the file cannot be read or written.
    TypeError, ValueError
        If an argument is wrong, or the file is not a file of results.
    RuntimeError
        If the processes cannot start.
    KeyboardInterrupt
        On Ctrl-C, within about a second; the records of finished jobs are in the file.
    """
    count = usable_cpus() if workers is None else as_integer("workers", workers, least=0)
    with appending(store) as (lines, append):
        here = describe_environment()
        if all(line.get("id") != here["id"] for line in lines):
            append(here)

        records = _finished(jobs, lines)
        todo = list({_cell(job): job for job in jobs if _cell(job) not in records}.values())
        if progress is not None:
            progress(0, len(todo))

        with closing(_outcomes(todo, count)) as outcomes:
            for done, (number, outcome) in enumerate(outcomes, start=1):
                key = todo[number].key
                # The key comes first for readers, and again last, so that no result can replace it.
                record = {**key, **outcome, **key, "environment": here["id"]}
                append(record)
                records[_cell(todo[number])] = record
                if progress is not None:
                    progress(done, len(todo))

    return [records[_cell(job)] for job in jobs]


def finished(jobs: Sequence[Job], lines: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the good records of these jobs from the lines of a store."""
    records = _finished(jobs, lines)
    return [records[cell] for cell in map(_cell, jobs) if cell in records]


def _finished(
    jobs: Iterable[Job], lines: Iterable[Mapping[str, Any]]
) -> dict[CellKey, dict[str, Any]]:
    """Return the good records by cell; the fields of these jobs' keys identify a cell."""
    shapes = {tuple(sorted(job.key)) for job in jobs}
    return {
        (names, _values(line, names)): dict(line)
        for line in lines
        if line.get("status") == "ok"
        for names in shapes
        if all(name in line for name in names)
    }


def _cell(job: Job) -> CellKey:
    names = tuple(sorted(job.key))
    return names, _values(job.key, names)


def _values(fields: Mapping[str, Any], names: tuple[str, ...]) -> str:
    return json.dumps([fields[name] for name in names], allow_nan=False)


def _outcomes(jobs: Sequence[Job], workers: int) -> Outcomes:
    """Yield the number and the outcome of every job as soon as it is done."""
    if workers == 0:
        yield from ((number, perform(job.work, job.arguments)) for number, job in enumerate(jobs))
        return

    with working(min(workers, len(jobs)) or 1) as processes:
        for number, job in enumerate(jobs):
            processes.submit(str(number), perform, job.work, job.arguments)
        for _ in jobs:
            key, outcome = next_outcome(processes)
            yield int(key), outcome

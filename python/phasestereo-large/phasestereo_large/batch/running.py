"""Run a batch: send a few pairs at a time to workers, and collect their records."""

from __future__ import annotations

import secrets
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path
from time import monotonic
from typing import Any, Unpack

from phasestereo._extras import require
from phasestereo._numbers import accept, as_integer, as_number
from phasestereo.io.drafts import remove_abandoned
from phasestereo.io.files import StrPath
from phasestereo.io.maps import FLOAT_SUFFIXES
from phasestereo.result import LAYERS, maps_with
from phasestereo.settings import PresetName, Settings, SettingsOverrides, resolve
from phasestereo_large.batch.cluster import Cluster, remote, share
from phasestereo_large.batch.manifest import DONE, Manifest, Record
from phasestereo_large.batch.pairs import PairFiles, check_names
from phasestereo_large.batch.work import FullDiskError, Order, blank, match_files
from phasestereo_large.locks import locked
from phasestereo_large.processes import Processes, WorkerDiedError, local

WorkerPool = Cluster | Processes

_AHEAD = 2  # pairs under way per worker, so that no worker waits for its next pair
_LOCK = ".batch.lock"


@dataclass(frozen=True, slots=True, kw_only=True)
class BatchReport:
    """The outcome of a run over many pairs.

    Parameters
    ----------
    pairs
        Number of pairs in the list.
    skipped
        Number of pairs that already had a result.
    done
        Number of pairs that this run matched.
    failed
        Records of the pairs that failed, in the order of the list.
    seconds
        Wall-clock time.
    manifest
        The file with the records of all pairs.
    damaged
        The invalid lines of an earlier manifest, by number, with their faults: they are in
        ``manifest.damaged`` next to it, and this run matched their pairs again.
    """

    pairs: int
    skipped: int
    done: int
    failed: list[Record]
    seconds: float
    manifest: Path
    damaged: tuple[str, ...] = ()


def run(
    pairs: Iterable[PairFiles],
    folder: StrPath,
    *,
    scheduler: str | None = None,
    security: Any = None,
    workers: int | None = None,
    threads: int | None = None,
    retries: int = 2,
    time_limit: float | None = None,
    suffix: str = ".tif",
    layers: Iterable[str] = (),
    preset: PresetName | None = None,
    settings: Settings | None = None,
    progress: Callable[[int, int], object] | None = None,
    on_failure: Callable[[Record], object] | None = None,
    **overrides: Unpack[SettingsOverrides],
) -> BatchReport:
    """Match many pairs of files in many processes; skip those that already have a result.

    The run matches a pair again if its last attempt failed, if a file of its result is missing or
    changed in length, or if its images, the settings, the disparities or the version changed.

    Parameters
    ----------
    pairs
        The pairs, from `read_pairs`.
    folder
        Folder for results and the manifest; created if missing. Workers write there, so all
        machines must share this folder and the images.
    scheduler
        Address of a Dask cluster's scheduler, such as "tls://host:8786". None: the run starts its
        own processes on this machine, which nobody else can reach.
    security
        With a scheduler: a ``distributed.Security`` with the certificates to connect with. Anyone
        who can connect to a scheduler can run any code on its workers and clients.
    workers
        Number of processes on this machine; None: one per processor.
    threads
        Threads per match. None: on this machine, a number that keeps all processors busy; on a
        cluster 1, since each thread of a worker matches its own pair.
    retries
        Number of retries for a pair that failed, or whose worker died, after all others are done.
    time_limit
        Seconds that a pair may take, including reading and writing; None: any number. On this
        machine, the run ends processes that take longer.
    suffix
        The format of the disparities: ".tif" (which keeps the georeference of the left image),
        ".pfm" or ".npy".
    layers
        "flags", "confidence" and "uncertainty" (the error bars), to write beside them as
        NAME.flags.tif and so on.
    preset, settings, **overrides
        As in `phasestereo.match`.
    progress
        Called as ``progress(finished, pairs)`` from the calling thread.
    on_failure
        Called with the record of each pair that failed for good.

    Returns
    -------
    BatchReport
        The outcome. A pair that fails does not raise an error.

    Raises
    ------
    TypeError, ValueError
        For a wrong argument, two pairs with one name, a folder with an invalid manifest, workers
        with another version.
    OSError
        If the folder is not writable or is full, another run is at work in it, or the scheduler
        cannot be reached or is lost. The folder keeps everything finished until then.
    ImportError
        If the extra ``batch`` is not installed, or with a scheduler ``dask``.
    RuntimeError
        If no process can start.

    Notes
    -----
    A script that calls this without a scheduler must do so under ``if __name__ == "__main__":``,
    since the new processes import it.
    """
    chosen = resolve(preset, settings, overrides)
    listed = list(pairs)
    check_names(listed)
    _check(suffix, tuple(layers), chosen)

    for name, value, least in (
        ("retries", retries, 0),
        ("workers", workers, 1),
        ("threads", threads, 1),
    ):
        if value is not None:
            as_integer(name, value, least=least)
    if time_limit is not None:
        as_number("time_limit", time_limit, positive=True)

    if scheduler is not None and workers is not None:
        raise ValueError("workers: got a number beside a scheduler; accepts None: it has its own")
    if scheduler is None and security is not None:
        raise ValueError("security: got that without a scheduler; accepts None: nobody connects")

    # Workers may have another current folder.
    target = Path(folder).absolute()
    target.mkdir(parents=True, exist_ok=True)

    # A cluster's worker matches one pair on each of its threads at the same time.
    count, each = share(workers, threads, len(listed)) if scheduler is None else (0, threads or 1)
    order = Order(
        settings=chosen,
        folder=target,
        suffix=suffix,
        layers=tuple(layers),
        threads=each,
        seconds=time_limit,
    )

    # Start workers, or connect to them, only if there is a pair to match.
    with locked(target / _LOCK, require("filelock", extra="batch")):
        remove_abandoned(target)
        work = _Run(listed, order, retries, progress, on_failure)
        work.run(
            lambda: local(count, time_limit) if scheduler is None else remote(scheduler, security)
        )
    return work.report()


@dataclass(slots=True)
class _Job:
    pair: PairFiles
    recipe: str
    attempts: int = 0


class _Run:
    """The state of a run: the pairs still to do, and the outcomes of the others."""

    def __init__(
        self,
        pairs: list[PairFiles],
        order: Order,
        retries: int,
        progress: Callable[[int, int], object] | None,
        on_failure: Callable[[Record], object] | None,
    ) -> None:
        self._pairs, self._order, self._retries = pairs, order, retries
        self._progress, self._on_failure = progress, on_failure
        self._manifest = Manifest(order.folder)

        self._later: deque[_Job] = deque()
        self._suspects: deque[_Job] = deque()
        self._skipped, self._done, self._failed = 0, 0, 0

        self._started = monotonic()
        self._token = secrets.token_hex(4)  # task keys must differ from those of an earlier run

    def run(self, connect: Callable[[], AbstractContextManager[WorkerPool]]) -> None:
        """Do all missing pairs; connect to workers only if there are any."""
        self._manifest.save(pair.name for pair in self._pairs)
        try:
            jobs = self._missing()
            first = list(islice(jobs, 1))
            if first:
                with connect() as pool:
                    self._work(pool, chain(first, jobs))
        finally:
            self._manifest.save(pair.name for pair in self._pairs)

    def report(self) -> BatchReport:
        """Return the report."""
        records = [self._manifest.records[pair.name] for pair in self._pairs]
        return BatchReport(
            pairs=len(self._pairs),
            skipped=self._skipped,
            done=self._done,
            failed=[record for record in records if record.state != DONE],
            seconds=round(monotonic() - self._started, 3),
            manifest=self._manifest.path,
            damaged=tuple(f"{each.where}: {each.reason}" for each in self._manifest.damaged),
        )

    def _missing(self) -> Iterator[_Job]:
        """Yield the missing pairs, and count the others."""
        for pair in self._pairs:
            recipe = self._order.recipe(pair)
            if self._is_there(self._manifest.records.get(pair.name), recipe):
                self._skipped += 1
                self._report_progress()
            else:
                yield _Job(pair, recipe)

    def _is_there(self, record: Record | None, recipe: str) -> bool:
        if record is None or record.state != DONE or record.recipe != recipe or not record.files:
            return False

        files = [(self._order.folder / name, size) for name, size in record.files.items()]
        return all(path.is_file() and path.stat().st_size == size for path, size in files)

    def _work(self, pool: WorkerPool, jobs: Iterator[_Job]) -> None:
        """Try all once, then retry those that failed, then, one by one, those whose worker died.

        When a worker of a cluster dies, any of its pairs may be the cause. Running each alone shows
        which one it is.
        """
        self._drain(pool, jobs)

        while self._later:
            again, self._later = self._later, deque()
            self._drain(pool, iter(again))

        while self._suspects:
            self._drain(pool, iter([self._suspects.popleft()]))
            self._suspects += self._later
            self._later.clear()

    def _drain(self, pool: WorkerPool, jobs: Iterator[_Job]) -> None:
        """Do these jobs, a few at a time."""
        under_way: dict[str, _Job] = {}
        self._submit(pool, jobs, under_way)
        while under_way:
            key, outcome = pool.finished()
            self._settle(under_way.pop(key), outcome)
            self._submit(pool, jobs, under_way)

    def _submit(self, pool: WorkerPool, jobs: Iterator[_Job], under_way: dict[str, _Job]) -> None:
        free = _AHEAD * pool.slots() - len(under_way)
        for job in islice(jobs, max(0, free)):
            job.attempts += 1
            key = f"phasestereo-{self._token}-{job.attempts}-{job.pair.name}"
            under_way[key] = job
            pool.submit(key, match_files, job.pair, self._order, job.recipe)

    def _settle(self, job: _Job, outcome: Callable[[], Record]) -> None:
        """Queue a failed job again, or record how it ended."""
        queue = self._later
        try:
            record = outcome()
        except WorkerDiedError as error:
            record, queue = blank(job.pair, job.recipe, str(error)), self._suspects
        except TimeoutError as error:
            record = blank(job.pair, job.recipe, str(error))
        except FullDiskError as error:
            raise OSError(
                f"{error}; what is finished is kept, the same run again goes on"
            ) from error
        except ConnectionError:
            raise
        except Exception as error:  # noqa: BLE001 -- loading a result may raise anything
            record = blank(job.pair, job.recipe, f"the worker could not run it: {error!r}")

        if record.state != DONE and job.attempts <= self._retries:
            queue.append(job)
        else:
            self._finish(replace(record, attempts=job.attempts))

    def _finish(self, record: Record) -> None:
        self._manifest.add(record)
        if record.state == DONE:
            self._done += 1
        else:
            self._failed += 1

            if self._on_failure is not None:
                self._on_failure(record)

        self._report_progress()

    def _report_progress(self) -> None:
        if self._progress is not None:
            self._progress(self._skipped + self._done + self._failed, len(self._pairs))


def _check(suffix: str, layers: tuple[str, ...], settings: Settings) -> None:
    accept("suffix", suffix, FLOAT_SUFFIXES)

    there = maps_with(settings)
    for layer in layers:
        if layer not in LAYERS:
            raise ValueError(f"layers: got {layer!r}; accepts {', '.join(LAYERS)}")
        if layer not in there:
            raise ValueError(f"layers: got {layer!r} with settings that work out none")

"""Processes of this machine that match, and that nobody but the run can reach.

Each has a pipe to this process and no port: a worker runs whatever it is sent, so strangers who
could connect to it would run what they like in our name. One process does one pair at a time in a
pool of its own, so that one that dies, or takes too long, takes nothing else with it.
"""

from __future__ import annotations

import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing import connection, get_context, parent_process, resource_tracker
from time import monotonic
from typing import Any, TypeAlias

from phasestereo._interrupts import unheard
from phasestereo_large.batch import work  # noqa: F401 - before the first task, whose time it would take

TaskResult: TypeAlias = Callable[[], Any]

DIED = "its worker died: it ran out of memory, was killed, or crashed"

_GRACE = 5.0  # seconds beyond its time in which a pair may end by itself
_KILL = getattr(signal, "SIGKILL", signal.SIGTERM)


class WorkerDiedError(Exception):
    """The worker of a task died."""


@contextmanager
def local(workers: int, seconds: float | None = None) -> Iterator[Processes]:
    """Start processes on this machine, and end them with the block.

    Parameters
    ----------
    workers
        How many.
    seconds
        How long a task may take until its process is ended; None: as long as it wants.

    Raises
    ------
    RuntimeError
        If they cannot be started.
    """
    if os.name == "posix":
        resource_tracker.ensure_running()  # the thread that starts it would hear Ctrl-C again

    processes = Processes(seconds)
    try:
        processes.start(workers)
        yield processes
    finally:
        processes.close()


class Processes:
    """Some processes; see `local`."""

    def __init__(self, seconds: float | None) -> None:
        self._seconds = seconds
        self._waiting: deque[tuple[str, Callable[..., Any], tuple[Any, ...]]] = deque()
        self._at_work: dict[Future[Any], _Task] = {}
        self._every: list[_Process] = []
        self._idle: list[_Process] = []

    def start(self, count: int) -> None:
        """Start so many processes, all at the same time, and wait until they are there."""
        self._every = [_Process() for _ in range(count)]
        for process in self._every:
            process.start()
        for process in self._every:
            process.wait()
        self._idle = list(self._every)

    def slots(self) -> int:
        """Return how many tasks are done at the same time."""
        return len(self._every)

    def submit(self, key: str, function: Callable[..., Any], *arguments: Any) -> None:
        """Let a process call a function, as soon as one is free."""
        self._waiting.append((key, function, arguments))
        self._hand_out()

    def finished(self) -> list[tuple[str, TaskResult]]:
        """Wait for a task to end; return what ended, each with what returns or raises its result.

        That raises `WorkerDiedError` if the process died, and `TimeoutError` if it took too long.
        """
        while True:
            done, _ = wait(self._at_work, self._patience(), FIRST_COMPLETED)
            if done:
                return [self._take_in(future) for future in done]

            # None ended in time: a killed process ends its task, with an error.
            for task in self._at_work.values():
                if task.age() >= self._limit():
                    task.late = True
                    task.process.kill()

    def close(self) -> None:
        """End all processes, those at work, too."""
        for process in self._every:
            process.kill()
        for process in self._every:
            process.close()

    def _limit(self) -> float:
        return float("inf") if self._seconds is None else self._seconds + _GRACE

    def _patience(self) -> float | None:
        """Return the seconds until a task may be late; None: none ever is."""
        if self._seconds is None:
            return None
        ages = [task.age() for task in self._at_work.values() if not task.late]
        return max(0.0, self._limit() - max(ages)) if ages else None

    def _hand_out(self) -> None:
        while self._waiting and self._idle:
            key, function, arguments = self._waiting.popleft()
            process = self._idle.pop()
            try:
                future = process.pool.submit(function, *arguments)
            except BrokenProcessPool:  # it died while it had nothing to do
                process = self._in_place_of(process)
                future = process.pool.submit(function, *arguments)
            self._at_work[future] = _Task(key, process, monotonic())

    def _in_place_of(self, dead: _Process) -> _Process:
        dead.close()
        process = _Process()
        self._every[self._every.index(dead)] = process
        process.start()
        process.wait()
        return process

    def _take_in(self, future: Future[Any]) -> tuple[str, TaskResult]:
        """Return what a task came to, and give its process, or one in its place, the next one."""
        task = self._at_work.pop(future)
        process = task.process

        if isinstance(future.exception(), BrokenProcessPool):
            process = self._in_place_of(process)

        self._idle.append(process)
        self._hand_out()
        return task.key, partial(_result, future, task, self._seconds)


def _result(future: Future[Any], task: _Task, seconds: float | None) -> Any:
    try:
        return future.result()
    except BrokenProcessPool as error:
        if task.late:
            raise TimeoutError(f"took longer than {seconds:g} s, and was ended") from error
        raise WorkerDiedError(DIED) from error


@dataclass(slots=True, eq=False)
class _Task:
    key: str
    process: _Process
    started: float
    late: bool = False

    def age(self) -> float:
        return monotonic() - self.started


class _Process:
    """A process, which does one task after another.

    It starts by `start`, when whoever made this object knows it: a process that starts in the
    constructor would be left to the collector where Ctrl-C ends the constructor.
    """

    def __init__(self) -> None:
        self.pool = ProcessPoolExecutor(1, get_context("spawn"), _begin)
        self._number: int | None = None

    def start(self) -> None:
        """Start the process, and return at once."""
        with unheard():  # Ctrl-C is meant for the run, which ends its processes
            self._first = self.pool.submit(os.getpid)

    def wait(self) -> None:
        """Wait until the process has started."""
        try:
            self._number = self._first.result()
        except BrokenProcessPool as error:
            raise RuntimeError(
                "worker processes cannot be started; a script that runs a batch must do so under "
                'if __name__ == "__main__":'
            ) from error

    def kill(self) -> None:
        """End the process whatever it is at."""
        if self._number is not None:
            try:
                os.kill(self._number, _KILL)
            except OSError:
                self._number = None  # it has ended already

    def close(self) -> None:
        """Wait for the end of the process, and for its start, if it never did anything else."""
        self._number = None  # a number may be given to another process then
        self.pool.shutdown(cancel_futures=True)


def _begin() -> None:
    """End this process when the one that started it ends, however that comes about."""
    parent = parent_process()

    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)

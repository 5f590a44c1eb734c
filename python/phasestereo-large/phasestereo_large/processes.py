"""Run tasks in processes on this machine that only their parent can reach.

Each has a pipe to this process and no port: a worker runs any task it receives, so strangers who
could connect to it could run any code in our name. Each is a separate executor that gets its tasks
from a thread, so a process that dies or takes too long does not affect the others.
"""

from __future__ import annotations

import os
import pickle
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import (
    active_children,
    connection,
    get_context,
    parent_process,
    resource_tracker,
)
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import ForkingPickler
from queue import SimpleQueue
from typing import Any, TypeAlias

TaskResult: TypeAlias = Callable[[], Any]

_GRACE = 5.0  # seconds beyond its limit for a task to end by itself


class WorkerDiedError(Exception):
    """The worker of a task died."""


class StartError(RuntimeError):
    """A worker could not be started."""


@contextmanager
def local(workers: int, seconds: float | None = None) -> Iterator[Processes]:
    """Run processes of this machine, and end them with the block.

    Parameters
    ----------
    workers
        Largest number of processes; each starts with its first task.
    seconds
        Time limit of a task, after which its process is ended; None: no limit.
    """
    processes = Processes(workers, seconds)
    try:
        yield processes
    finally:
        processes.close()


class Processes:
    """Some processes; see `local`."""

    def __init__(self, count: int, seconds: float | None) -> None:
        self._every = [_Process(seconds) for _ in range(count)]
        self._idle = list(self._every)
        self._threads = ThreadPoolExecutor(count, initializer=_ignore_interrupts)
        self._ended: SimpleQueue[tuple[str, Future[Any]]] = SimpleQueue()

    def slots(self) -> int:
        """Return the number of tasks done at the same time."""
        return len(self._every)

    def submit(self, key: str, function: Callable[..., Any], *arguments: Any) -> None:
        """Have a process call a function, as soon as one is free."""
        future = self._threads.submit(self._do, (function, arguments))
        future.add_done_callback(lambda done: self._ended.put((key, done)))

    def finished(self) -> tuple[str, TaskResult]:
        """Wait for a task to end; return its key, and a function that returns or raises its result.

        The function raises `WorkerDiedError` if the process died, `TimeoutError` if it took too
        long, and the error of `pickle` if the task cannot be sent.

        Raises
        ------
        StartError
            If a process could not be started for the task.
        """
        key, future = self._ended.get()
        if isinstance(error := future.exception(), StartError):
            raise error
        return key, future.result

    def close(self) -> None:
        """End all processes, including busy ones."""
        for process in self._every:
            process.end()
        self._threads.shutdown(cancel_futures=True)
        for process in self._every:
            process.close()

    def _do(self, task: tuple[Callable[..., Any], tuple[Any, ...]]) -> Any:
        process = self._idle.pop()  # there are as many threads as processes
        try:
            return process.do(bytes(ForkingPickler.dumps(task)))
        finally:
            self._idle.append(process)


class _Process:
    """A process that does one task after another; a new one replaces a dead one."""

    def __init__(self, seconds: float | None) -> None:
        self._seconds = seconds
        self._limit = None if seconds is None else seconds + _GRACE
        self._process: BaseProcess | None = None
        self._pool: ProcessPoolExecutor | None = None
        self._is_over = False

    def do(self, task: bytes) -> Any:
        """Do a pickled task, and return its value; see `Processes.finished`."""
        if self._process is None or not self._process.is_alive():
            self.close()
            self._start(task)
        assert self._pool is not None  # noqa: S101 -- for the type checker
        if self._is_over:  # `end` came while it started
            raise CancelledError

        is_late = False
        try:
            future = self._pool.submit(_call, task)
            is_late = not wait([future], self._limit).done
            if is_late:
                self._kill()
            return future.result()
        except BrokenProcessPool as error:
            self.close()
            if is_late:
                raise TimeoutError(
                    f"took longer than {self._seconds:g} s, and was ended"
                ) from error
            raise WorkerDiedError(f"its worker died: {self._ending()}") from error

    def end(self) -> None:
        """End the process, even if it is busy, and start no other one."""
        self._is_over = True
        self._kill()

    def close(self) -> None:
        """End the process, and wait for its end."""
        self._kill()
        if self._pool is not None:
            self._pool.shutdown()

    def _start(self, task: bytes) -> None:
        """Start a process that loads the task's code; this does not count toward its time."""
        self._pool = ProcessPoolExecutor(1, get_context("spawn"), _begin)
        try:
            number = self._pool.submit(_load, task).result()
        except (RuntimeError, OSError) as error:
            raise StartError(
                "worker processes cannot be started; a script that starts some must do so under "
                'if __name__ == "__main__":'
            ) from error
        self._process = next(child for child in active_children() if child.pid == number)

    def _kill(self) -> None:
        if self._process is not None:
            self._process.kill()

    def _ending(self) -> str:
        """Describe the end of the process."""
        code = self._process.exitcode if self._process is not None else None
        if code is not None and code < 0:
            return f"killed by {signal.Signals(-code).name}, as when memory runs out"
        return f"ended with exit code {code}"


def _ignore_interrupts() -> None:
    """Keep Ctrl-C from processes of this thread: it is for the parent, which ends them."""
    if hasattr(signal, "pthread_sigmask"):
        resource_tracker.ensure_running()  # its start lets the signal through again
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


def _begin() -> None:
    """Begin a worker: it ends when its parent ends for any reason, and not by Ctrl-C.

    A handler ignores Ctrl-C, since programs that a task starts would inherit a mask or an ignored
    signal.
    """
    signal.signal(signal.SIGINT, lambda *_: None)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})

    if (parent := parent_process()) is not None:
        threading.Thread(target=partial(_end_with, parent.sentinel), daemon=True).start()


def _end_with(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)


def _load(task: bytes) -> int:
    with suppress(Exception):  # `_call` will raise it
        pickle.loads(task)  # noqa: S301 -- from our own parent
    return os.getpid()


def _call(task: bytes) -> Any:
    function, arguments = pickle.loads(task)  # noqa: S301 -- from our own parent
    return function(*arguments)

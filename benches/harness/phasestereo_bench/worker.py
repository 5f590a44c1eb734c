"""A process that works off jobs one by one, each with every library on a single thread."""

from __future__ import annotations

import json
import math
import os
import pickle
import signal
import sys
import traceback
from collections.abc import Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context, resource_tracker
from multiprocessing.reduction import ForkingPickler
from typing import TYPE_CHECKING, Any

import numpy as np

from phasestereo._interrupts import unheard
from phasestereo_bench.measurement import measured

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from multiprocessing.connection import Connection
    from multiprocessing.context import SpawnProcess

    Work = Callable[..., Mapping[str, Any]]
    JobFields = dict[str, Any]

# Read by the libraries as they load, so they must be set before the process starts.
_SINGLE = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "RAYON_NUM_THREADS",
    "OPENCV_FOR_THREADS_NUM",
)


@dataclass(slots=True, eq=False)
class Worker:
    """A running process, and the number of the job it is at."""

    process: SpawnProcess
    connection: Connection
    ready: bool = False
    job: int | None = None

    @classmethod
    def start(cls) -> Worker:
        """Start a process; it says when it is ready."""
        if os.name == "posix":
            resource_tracker.ensure_running()  # the thread that starts it would hear Ctrl-C again

        context = get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(theirs,))

        with _single_threaded(), unheard():
            process.start()
        theirs.close()

        return cls(process, ours)

    def give(self, job: int, work: Work, arguments: Mapping[str, Any]) -> None:
        """Hand over a job.

        Raises
        ------
        Exception
            Whatever `pickle` raises for work or arguments that it cannot take.
        """
        parcel = ForkingPickler.dumps((work, dict(arguments)))
        self.job = job
        try:
            self.connection.send_bytes(parcel)
        except OSError:  # it has died, which `receive` will report
            return

    def receive(self) -> JobFields | None:
        """Take what it has to say: the outcome of its job, or None when it has become ready.

        Raises
        ------
        EOFError
            If the process has died.
        """
        try:
            message = self.connection.recv_bytes()
        except OSError as error:
            raise EOFError from error

        if not self.ready:
            self.ready = True
            return None

        self.job = None
        outcome: JobFields = json.loads(message)
        return outcome

    def stop(self) -> None:
        """End the process, whatever it is at."""
        self.connection.close()
        self.process.kill()
        self.process.join()

    def reap(self) -> str:
        """Wait for a process that has died by itself, and say how it ended."""
        self.connection.close()
        self.process.join()

        code = self.process.exitcode
        if code is not None and code < 0:
            return f"the process was killed by {signal.Signals(-code).name}"
        return f"the process ended with exit code {code}"


def perform(work: Work, arguments: Mapping[str, Any]) -> JobFields:
    """Do a job in this process.

    Returns
    -------
    dict
        ``"status"``: ``"ok"``, what the work returned, ``"seconds"`` and ``"peak_bytes"``; or
        ``"status"``: ``"failed"``, ``"error"`` and ``"traceback"``. Fit for JSON: numbers that it
        does not have, NaN and infinity, have become None.
    """
    try:
        done = measured(lambda: work(**arguments))
        cost = {"seconds": done.seconds, "peak_bytes": done.peak_bytes}
        outcome: JobFields = _plain({"status": "ok", **cost, **done.answer})
        json.dumps(outcome)
    except Exception as error:  # noqa: BLE001 - whatever a matcher may raise fails its cell alone
        return failure(error)
    return outcome


def perform_alone(work: Work, arguments: Mapping[str, Any]) -> JobFields:
    """Do a job in a fresh process, which ends with it.

    Returns
    -------
    dict
        As `perform`; ``"status"``: ``"failed"`` and ``"error"`` where the process died.
    """
    worker = Worker.start()
    try:
        worker.receive()  # that it is ready
        worker.give(0, work, arguments)
        outcome = worker.receive()
    except EOFError:
        return {"status": "failed", "error": worker.reap()}
    finally:
        worker.stop()

    return outcome or {}


def failure(error: Exception) -> JobFields:
    """Return the outcome of a job that raised."""
    message = " ".join(f"{type(error).__name__}: {error}".split())
    trace = "".join(traceback.format_exception(error))
    return {"status": "failed", "error": message, "traceback": trace}


def require_portable(name: str, value: object) -> None:
    """Refuse what cannot be sent to another process.

    Raises
    ------
    TypeError
        If it cannot; the message begins with the name.
    """
    main = sys.modules["__main__"]
    # A spawned process imports the main module by name or file; a notebook has neither.
    homeless = getattr(main, "__spec__", None) is None and not hasattr(main, "__file__")
    reason = "it is of a notebook or an interactive session"

    try:
        ForkingPickler.dumps(value)
        if not (homeless and getattr(value, "__module__", None) == "__main__"):
            return
    except Exception as error:  # noqa: BLE001 - pickling runs code of the value
        reason = str(error)
    raise TypeError(
        f"{name}: {value!r} cannot be sent to other processes: {reason}; "
        "define it in a module, or run in this process with workers=0"
    )


def _serve(connection: Connection) -> None:
    """Work off jobs until there are no more; the main function of the process."""
    _leave_interrupts_to_parent()
    with connection:
        try:
            connection.send_bytes(b"ready")
            while True:
                outcome = _answer(connection.recv_bytes())
                connection.send_bytes(json.dumps(outcome).encode())
        except (EOFError, OSError):  # the parent is gone
            return


def _answer(parcel: bytes) -> JobFields:
    try:
        work, arguments = pickle.loads(parcel)  # noqa: S301 - from our own parent
    except Exception as error:  # noqa: BLE001 - importing the module of the work may raise anything
        return failure(error)
    return perform(work, arguments)


def _plain(value: Any) -> Any:
    """Return a value as JSON has it, as far as that is plain; the rest is left to fail there."""
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value


@contextmanager
def _single_threaded() -> Iterator[None]:
    """Let processes that start in this block find one thread per library in their environment."""
    earlier = {name: os.environ.get(name) for name in _SINGLE}
    os.environ.update(dict.fromkeys(_SINGLE, "1"))

    try:
        yield
    finally:
        for name, value in earlier.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _leave_interrupts_to_parent() -> None:
    """Ignore Ctrl-C by a handler: programs that a job starts would inherit SIG_IGN."""
    signal.signal(signal.SIGINT, lambda *_: None)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})

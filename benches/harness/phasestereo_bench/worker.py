"""Does jobs in this process, or in others that hold every library to a single thread."""

import json
import os
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

from phasestereo._numbers import as_json
from phasestereo_bench.measurement import measured
from phasestereo_large.processes import Processes, local

Work = Callable[..., Mapping[str, Any]]
JobFields = dict[str, Any]

# The libraries read these as they load, so set them before the process starts.
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


@contextmanager
def working(count: int) -> Iterator[Processes]:
    """Let processes work off jobs by `perform`, each with every library on a single thread."""
    inherited = dict.fromkeys(_SINGLE, "1")
    with patch.dict(os.environ, inherited), local(count) as processes:
        yield processes


def next_outcome(processes: Processes) -> tuple[str, JobFields]:
    """Wait for the end of a job; return its key and its outcome."""
    key, outcome = processes.finished()
    try:
        fields: JobFields = outcome()
    except Exception as error:  # noqa: BLE001 - pickling runs code of the arguments
        return key, failure(error)
    return key, fields


def perform(work: Work, arguments: Mapping[str, Any]) -> JobFields:
    """Do a job in this process.

    Returns
    -------
    dict
        ``"status"``: ``"ok"``, what the work returned, ``"seconds"`` and ``"peak_bytes"``; or
        ``"status"``: ``"failed"``, ``"error"`` and ``"traceback"``. All values fit JSON: NaN and
        infinity, which JSON does not have, become None.
    """
    try:
        done = measured(lambda: work(**arguments))
        cost = {"seconds": done.seconds, "peak_bytes": done.peak_bytes}
        outcome: JobFields = as_json({"status": "ok", **cost, **done.answer})
        json.dumps(outcome)
    except Exception as error:  # noqa: BLE001 - an error of a matcher fails only its cell
        return failure(error)
    return outcome


def perform_alone(work: Work, arguments: Mapping[str, Any]) -> JobFields:
    """Do a job in a fresh process, which ends with the job.

    Returns
    -------
    dict
        As `perform`; ``"status"``: ``"failed"`` and ``"error"`` if the process died.
    """
    with working(1) as processes:
        processes.submit("", perform, work, arguments)
        return next_outcome(processes)[1]


def failure(error: Exception) -> JobFields:
    """Return the outcome of a job that raised."""
    message = " ".join(f"{type(error).__name__}: {error}".split())
    trace = "".join(traceback.format_exception(error))
    return {"status": "failed", "error": message, "traceback": trace}

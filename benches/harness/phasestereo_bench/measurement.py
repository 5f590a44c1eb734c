"""Measures the seconds of a call, and the rise of the resident memory."""

import ctypes
import gc
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

Answer = TypeVar("Answer")

_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


@dataclass(frozen=True, slots=True)
class Measured(Generic[Answer]):
    """The result of a call, its wall-clock seconds, and the rise of the peak of memory."""

    answer: Answer
    seconds: float
    peak_bytes: int | None


def measured(call: Callable[[], Answer]) -> Measured[Answer]:
    """Call a function, and measure its time and memory.

    Parameters
    ----------
    call
        Function to measure; it is called once.

    Returns
    -------
    Measured
        `peak_bytes` is the peak of the resident memory of the whole process during the call, less
        the memory that was resident before; None if the system does not report it (Linux does).
    """
    before = _restart_peak()

    start = time.perf_counter()
    answer = call()
    seconds = time.perf_counter() - start

    after = None if before is None else _peak()
    rise = None if before is None or after is None else max(0, after - before)
    return Measured(answer, seconds, rise)


def _restart_peak() -> int | None:
    """Restart the peak and return it, bytes; None if the system cannot.

    Freed memory that the process keeps would fill without a rise, so it goes back first. Later
    collections skip living objects, because a look at them takes longer than a small match.
    """
    gc.collect()
    gc.freeze()
    with suppress(OSError, AttributeError, TypeError):  # another system, or another C library
        ctypes.CDLL(None).malloc_trim(0)

    try:
        _RESET.write_text("5", "ascii")
    except OSError:
        return None
    return _peak()


def _peak() -> int | None:
    """Return the peak of the resident memory, bytes."""
    for line in _STATUS.read_text("ascii").splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024
    return None

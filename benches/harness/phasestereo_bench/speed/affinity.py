"""Affinity: the processors on which the threads of this process may run."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_TASKS = Path("/proc/self/task")


@contextmanager
def pinned() -> Iterator[int | None]:
    """Hold every thread of this process to one processor while the block lasts.

    Threads that start meanwhile are held there, too, and let go with the others.

    Yields
    ------
    int or None
        Which processor; None where the system cannot hold anything.
    """
    if not hasattr(os, "sched_setaffinity"):
        yield None
        return

    everywhere = os.sched_getaffinity(0)
    core = min(everywhere)
    _settle({core})

    try:
        yield core
    finally:
        _settle(everywhere)


def _settle(cores: Iterable[int]) -> None:
    """Move all threads: the call for a process only moves the one that makes it."""
    tasks = [int(task.name) for task in _TASKS.iterdir()] if _TASKS.is_dir() else [0]
    for task in tasks:
        with suppress(ProcessLookupError):  # it has ended since
            os.sched_setaffinity(task, cores)

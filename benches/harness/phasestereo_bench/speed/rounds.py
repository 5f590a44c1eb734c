"""Times contenders in turn, so changes of the machine affect all alike; threads are fixed."""

import os
import random
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from phasestereo.result import Result
from phasestereo.rig.findings import unwarned
from phasestereo_bench.environment import usable_cpus
from phasestereo_bench.speed.contenders import CONTENDERS, MATCH, OURS, Call, set_opencv_threads
from phasestereo_bench.speed.pairs import GrayPair

_TASKS = Path("/proc/self/task")


@contextmanager
def pinned() -> Iterator[int | None]:
    """Hold every thread of this process to one processor while the block lasts.

    Threads that start meanwhile are held there, too, and released with the others.

    Yields
    ------
    int or None
        The processor; None if the system cannot hold threads to one.
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
    """Move all threads, because the call for a process moves only the calling thread."""
    tasks = [int(task.name) for task in _TASKS.iterdir()] if _TASKS.is_dir() else [0]
    for task in tasks:
        with suppress(ProcessLookupError):  # the thread has ended meanwhile
            os.sched_setaffinity(task, cores)


_REST = 0.001  # seconds: threads of the last contender stop looking for more work


@dataclass(slots=True)
class Entrant:
    """A contender with its times in every round.

    Attributes
    ----------
    name
        Name of one of `CONTENDERS`.
    call
        Function that matches the pair.
    opencv_threads
        Number of threads that OpenCV may use; None for ours.
    seconds
        Seconds of every round.
    stages
        Seconds of every stage in every round; empty for OpenCV's.
    """

    name: str
    call: Call
    opencv_threads: int | None
    seconds: list[float] = field(default_factory=list)
    stages: list[dict[str, float]] = field(default_factory=list)


def time_one_thread(pair: GrayPair, preset: str, rounds: int) -> tuple[list[Entrant], int | None]:
    """Time our matcher with a preset and all rivals on one processor.

    OpenCV takes part with one thread and again with two, both on that processor: StereoBM then
    works in stripes that stay in the cache, and is faster on large images. If the system cannot
    hold threads to a processor, OpenCV takes part with one.

    Returns
    -------
    tuple
        The entrants, and the processor, None if they were not held to one.
    """
    with pinned() as core:
        counts = (1,) if core is None else (1, 2)
        return _timed(pair, preset, rounds, 1, counts), core


def time_all_threads(pair: GrayPair, preset: str, rounds: int) -> list[Entrant]:
    """Time our matcher with a preset and all rivals, with one thread per processor."""
    return _timed(pair, preset, rounds, None, (usable_cpus(),))


def _timed(
    pair: GrayPair, preset: str, rounds: int, threads: int | None, opencv_threads: Sequence[int]
) -> list[Entrant]:
    ours = OURS[preset]
    rivals = [name for name in CONTENDERS if name.startswith("opencv")]

    entrants = [
        Entrant(name, CONTENDERS[name](pair.num_disparities, threads), count)
        for name in (ours, ours + MATCH, *rivals)
        for count in (opencv_threads if name in rivals else (None,))
    ]

    for entrant in entrants:  # the first call allocates, and has caches to fill
        _enter(entrant, pair)
        entrant.seconds.clear()
        entrant.stages.clear()

    shuffle = random.Random(0).shuffle  # noqa: S311 - no secret
    for _ in range(rounds):
        order = list(entrants)
        shuffle(order)  # no entrant always follows the same one
        for entrant in order:
            _enter(entrant, pair)

    return entrants


def _enter(entrant: Entrant, pair: GrayPair) -> None:
    """Match once, and note the time."""
    if entrant.opencv_threads is not None:
        set_opencv_threads(entrant.opencv_threads)

    time.sleep(_REST)
    with unwarned():  # the quality of the map does not count here
        start = time.perf_counter()
        answer = entrant.call(pair.left, pair.right)
        entrant.seconds.append(time.perf_counter() - start)

    if isinstance(answer, Result):
        entrant.stages.append(dict(answer.timings))

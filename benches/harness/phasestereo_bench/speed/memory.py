"""Measures the rise of resident memory during a match, each in a separate process."""

from collections.abc import Mapping
from typing import Any

from phasestereo.result import Result
from phasestereo.rig.findings import unwarned
from phasestereo_bench.measurement import measured
from phasestereo_bench.speed.contenders import CONTENDERS, set_opencv_threads
from phasestereo_bench.speed.pairs import Gray, GrayPair
from phasestereo_bench.worker import perform_alone

_SMALL = 64
_FEW = 16


def memory_of(name: str, pair: GrayPair, *, threads: int) -> dict[str, Any]:
    """Match a pair in a fresh process, and weigh it.

    Parameters
    ----------
    name
        Name of one of `CONTENDERS`.
    pair
        The pair to match.
    threads
        Number of threads. A fresh process holds every library to one thread, so it cannot find the
        number by itself.

    Returns
    -------
    dict
        ``"peak_bytes"``: the rise of the peak of the resident memory over that of the process after
        it has matched a small pair, None if it is unknown; ``"result_bytes"``: the part of that
        which the returned arrays take; ``"first_call"``: the time of the small match divided by
        that of the next. Or ``"error"``: the reason why all of these are unknown.
    """
    arguments = {
        "name": name,
        "images": (pair.left, pair.right),
        "num_disparities": pair.num_disparities,
        "threads": threads,
    }
    outcome = perform_alone(weigh, arguments)

    kept = ("peak_bytes", "result_bytes", "first_call", "error")
    return {name: outcome[name] for name in kept if name in outcome}


def weigh(
    *, name: str, images: tuple[Gray, Gray], num_disparities: int, threads: int
) -> Mapping[str, Any]:
    """Match a small pair, then the whole one, and return the memory that the whole one takes."""
    make = CONTENDERS[name]
    if name.startswith("opencv"):
        set_opencv_threads(threads)

    with unwarned():  # a part of a pair may not match
        # The small match loads code and buffers, which should not count for any pair.
        make(_FEW, threads)(*(image[:_SMALL, :_SMALL].copy() for image in images))
        call = make(num_disparities, threads)
        done = measured(lambda: call(*images))
        again = measured(lambda: call(*images))

    return {
        "peak_bytes": done.peak_bytes,
        "result_bytes": _size(done.answer),
        "first_call": done.seconds / again.seconds,
    }


def _size(answer: Any) -> int:
    arrays = [answer]
    if isinstance(answer, Result):
        arrays = [answer.disparity, answer.flags, answer.confidence]
    return sum(array.nbytes for array in arrays if array is not None)

"""Memory: how far one match raises what is resident, each in a process of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from phasestereo.result import Result
from phasestereo_bench.measurement import measured
from phasestereo_bench.speed.contenders import CONTENDERS, OURS, set_opencv_threads
from phasestereo_bench.worker import Worker

if TYPE_CHECKING:
    from collections.abc import Mapping

    from phasestereo_bench.speed.pairs import Gray, GrayPair

_SMALL = 64
_FEW = 16


def memory_of(name: str, pair: GrayPair, *, threads: int) -> dict[str, Any]:
    """Match a pair in a fresh process, and weigh it.

    Parameters
    ----------
    name
        Of `CONTENDERS`.
    pair
        What to match.
    threads
        How many. A fresh process would not find out by itself, as it is told to keep every library
        to one.

    Returns
    -------
    dict
        ``"peak_bytes"``: the rise of the peak of the resident memory over that of the process when
        it has matched a small pair, None where the system does not tell; ``"result_bytes"``: how
        much of that the arrays are which were returned. Or ``"error"``: why neither is known.
    """
    worker = Worker.start()
    try:
        worker.receive()
        arguments = {
            "name": name,
            "images": (pair.left, pair.right),
            "num_disparities": pair.num_disparities,
            "threads": threads,
        }
        worker.give(0, weigh, arguments)
        outcome = worker.receive() or {}
    except EOFError:
        return {"error": worker.bury()}
    finally:
        worker.stop()
    return {
        name: outcome[name] for name in ("peak_bytes", "result_bytes", "error") if name in outcome
    }


def weigh(
    *, name: str, images: tuple[Gray, Gray], num_disparities: int, threads: int
) -> Mapping[str, Any]:
    """Match a small pair and then the whole; tell what the latter took. The work of the process."""
    make = CONTENDERS[name]
    if name != OURS:
        set_opencv_threads(threads)
    make(_FEW, threads)(*(image[:_SMALL, :_SMALL].copy() for image in images))
    done = measured(lambda: make(num_disparities, threads)(*images))
    return {"peak_bytes": done.peak_bytes, "result_bytes": _size(done.answer)}


def _size(answer: Any) -> int:
    arrays = [answer]
    if isinstance(answer, Result):
        arrays = [answer.disparity, answer.flags, answer.confidence]
    return sum(array.nbytes for array in arrays if array is not None)

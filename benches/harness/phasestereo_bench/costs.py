"""Measures seconds and memory of a match, with the method alone on the machine on one thread."""

from collections.abc import Sequence
from statistics import median
from typing import Any

from phasestereo_bench.cases import Case, usual_side
from phasestereo_bench.datasets import Scene
from phasestereo_bench.measurement import measured
from phasestereo_bench.methods import method
from phasestereo_bench.runner import Job
from phasestereo_bench.worker import perform_alone

COST = "cost"
"""The kind of the records."""

CASES = (
    ("rigs", "sharp"),
    ("one-sided-blur", "disk 3"),
    ("rigs", "rows 1"),
    ("rigs", "noise 5"),
    ("rigs", "jpeg 70"),
    ("rigs", "webcam"),
)
"""Suites and degradations for the timing of methods: some estimate more on a bad pair."""

_ROUNDS = 3
_SMALL = 64  # px: a process first matches a pair of this size, which does not count


def cost_jobs(scene: Scene, methods: Sequence[str]) -> list[Job]:
    """Return the jobs of a scene; one worker must run them, with nothing beside it."""
    return [
        Job(
            {
                "kind": COST,
                "scene": str(scene),
                "suite": suite,
                "degradation": name,
                "method": str(method(spec)),
            },
            measure_case,
            {"case": Case(scene, suite, name, usual_side(suite)), "spec": spec},
        )
        for suite, name in CASES
        for spec in methods
    ]


def measure_case(case: Case, spec: str) -> dict[str, Any]:
    """Match a case three times, after one match that does not count.

    Returns
    -------
    dict
        ``"seconds"``: the median; ``"peak_bytes"``, for a sharp pair: the rise of the peak of the
        resident memory in a fresh process over that of the process after it has matched a small
        pair, None if the system does not report it, and for other pairs; ``"pixels"``.
    """
    match, pair = method(spec).match, case.pair(true_blur=False)
    left, right, count = pair.left, pair.right, pair.num_disparities

    # The first match does not count: it fills caches and memory pools.
    match(left, right, count)
    runs = [measured(lambda: match(left, right, count)) for _ in range(_ROUNDS)]

    # Some libraries keep the memory of an earlier match, so a fresh process weighs.
    sharp, arguments = case.degradation == "sharp", {"case": case, "spec": spec}
    return {
        "seconds": median(run.seconds for run in runs),
        "peak_bytes": perform_alone(weigh, arguments).get("weight") if sharp else None,
        "pixels": left.shape[0] * left.shape[1],
    }


def weigh(case: Case, spec: str) -> dict[str, Any]:
    """Match a small pair, then the whole one, and return the memory that the whole one takes."""
    match, pair = method(spec).match, case.pair(true_blur=False)

    # The small match loads code and buffers, which should not count for any pair.
    small = (image[:_SMALL, : 2 * _SMALL].copy() for image in (pair.left, pair.right))
    match(*small, _SMALL // 4)
    done = measured(lambda: match(pair.left, pair.right, pair.num_disparities))

    return {"weight": done.peak_bytes}

"""What a match takes: seconds and memory, each method alone on the machine and on one thread."""

from __future__ import annotations

from statistics import median
from typing import TYPE_CHECKING, Any

from phasestereo_bench.cases import Case, usual_side
from phasestereo_bench.measurement import measured
from phasestereo_bench.methods import method
from phasestereo_bench.runner import Job

if TYPE_CHECKING:
    from collections.abc import Sequence

    from phasestereo_bench.datasets import Scene

COST = "cost"
"""What records are called."""

CASES = (
    ("rigs", "sharp"),
    ("one-sided-blur", "disk 3"),
    ("rigs", "rows 1"),
    ("rigs", "noise 5"),
    ("rigs", "jpeg 70"),
    ("rigs", "webcam"),
)
"""Suites and degradations that methods are timed on: what is found out takes time, too."""

_ROUNDS = 3
_SMALL = 64  # px: a process has matched so much before anything counts


def cost_jobs(scene: Scene, methods: Sequence[str]) -> list[Job]:
    """Return the jobs of a scene; they are to be run by one worker, with nothing beside it."""
    jobs = []
    for suite, name in CASES:
        case = Case(scene, suite, name, usual_side(suite))
        for spec in methods:
            key = {"kind": COST, "scene": str(scene), "suite": suite, "degradation": name}
            key |= {"method": str(method(spec))}
            jobs.append(Job(key, measure_case, {"case": case, "spec": spec}))
    return jobs


def measure_case(case: Case, spec: str) -> dict[str, Any]:
    """Match a case three times.

    Returns
    -------
    dict
        ``"seconds"``: the median; ``"peak_bytes"``: the rise of the peak of the resident memory in
        the first of these, over that of a process which has matched a small pair, None where the
        system does not tell; ``"pixels"``.
    """
    match, pair = method(spec).match, case.pair(true_blur=False)
    left, right = pair.left, pair.right
    match(left[:_SMALL, : 2 * _SMALL].copy(), right[:_SMALL, : 2 * _SMALL].copy(), _SMALL // 4)
    runs = [measured(lambda: match(left, right, pair.num_disparities)) for _ in range(_ROUNDS)]
    return {
        "seconds": median(run.seconds for run in runs),
        "peak_bytes": runs[0].peak_bytes,
        "pixels": left.shape[0] * left.shape[1],
    }

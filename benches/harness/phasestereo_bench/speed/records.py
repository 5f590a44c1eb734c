"""Records the results for a pair, on one thread or on all, with everything they depend on."""

import hashlib
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

from phasestereo import _core
from phasestereo_bench.environment import describe_environment, usable_cpus
from phasestereo_bench.runner import Job
from phasestereo_bench.speed.contenders import MATCH, OURS, opencv_build
from phasestereo_bench.speed.memory import memory_of
from phasestereo_bench.speed.pairs import GrayPair
from phasestereo_bench.speed.results import KIND
from phasestereo_bench.speed.rounds import Entrant, time_all_threads, time_one_thread

ROUNDS = 15


def speed_jobs(pairs: Sequence[GrayPair], *, rounds: int = ROUNDS) -> list[Job]:
    """Return the jobs that time both presets and all rivals on these pairs: four for each pair.

    They must run one by one and in this process: ``run_jobs(..., workers=0)``. If a file of records
    has a job from the same machine, versions and compiled core, the job does not run again.
    `measure` describes a record.

    Raises
    ------
    ImportError
        If OpenCV is not installed.
    ValueError
        If the number of rounds is not positive.
    """
    if rounds < 1:
        raise ValueError(f"rounds: got {rounds}; accepts 1 and more")

    made_with: dict[str, str] = {
        "environment": describe_environment()["id"],
        "core": _digest(_core.__file__),
        "simd": _core.simd_level(),
        "opencv_build": opencv_build(),
    }

    return [
        Job(
            {
                "kind": KIND,
                "pair": pair.name,
                "height": pair.left.shape[0],
                "width": pair.left.shape[1],
                "num_disparities": pair.num_disparities,
                "preset": preset,
                "threads": threads,
                "rounds": rounds,
                **made_with,
            },
            measure,
            {"pair": pair, "preset": preset, "threads": threads, "rounds": rounds},
        )
        for pair in pairs
        for preset in OURS
        for threads in ("one", "all")
    ]


def measure(pair: GrayPair, preset: str, threads: str, rounds: int) -> dict[str, Any]:
    """Measure time and memory of our matcher with a preset and of all rivals on a pair.

    Parameters
    ----------
    pair
        The pair to match.
    preset
        One of `OURS`.
    threads
        "one" or "all".
    rounds
        Number of rounds.

    Returns
    -------
    dict
        ``"thread_count"``; ``"pinned_to"``: number of the processor, None if threads were free;
        ``"ours"`` and, by name, ``"rivals"``: ``"seconds"`` of every round and their ``"median"``
        and ``"minimum"``, ``"gde_per_second"`` (1e9 pixels times disparities a second, by the
        median), ``"memory"`` as of `memory_of`; "match" is `phasestereo.match`. Ours also has
        ``"stages"``, seconds by name in every round, and ``"description_share"``, the median of the
        description's share of the time. Rivals also have ``"ratio_of_medians"`` and
        ``"median_ratio"`` of the rounds, their time to ours; ``"opencv_threads"``; and
        ``"slower"``, the seconds with other numbers of threads.
    """
    if threads == "one":
        entrants, core = time_one_thread(pair, preset, rounds)
    else:
        entrants, core = time_all_threads(pair, preset, rounds), None

    by_name: dict[str, list[Entrant]] = {}
    for entrant in entrants:
        by_name.setdefault(entrant.name, []).append(entrant)

    count = 1 if threads == "one" else usable_cpus()
    (ours,) = by_name.pop(OURS[preset])
    by_name["match"] = by_name.pop(OURS[preset] + MATCH)

    return {
        "thread_count": count,
        "pinned_to": core,
        "ours": {
            **_figures(ours, pair),
            **_stages(ours),
            "memory": memory_of(OURS[preset], pair, threads=count),
        },
        "rivals": {name: _rivalry(same, ours, pair) for name, same in by_name.items()},
    }


def _figures(entrant: Entrant, pair: GrayPair) -> dict[str, Any]:
    middle = median(entrant.seconds)
    return {
        "seconds": entrant.seconds,
        "median": middle,
        "minimum": min(entrant.seconds),
        "gde_per_second": pair.evaluations / middle / 1e9,
    }


def _stages(ours: Entrant) -> dict[str, Any]:
    """Return the times of the stages, and the share of time that describes the images."""
    stages = {name: [stage[name] for stage in ours.stages] for name in ours.stages[0]}
    rounds = zip(stages["description"], ours.seconds, strict=True)
    return {"stages": stages, "description_share": median(part / whole for part, whole in rounds)}


def _rivalry(same: Sequence[Entrant], ours: Entrant, pair: GrayPair) -> dict[str, Any]:
    """Return the figures of a rival's fastest entrant, and its ratio to ours."""
    best, *others = sorted(same, key=lambda entrant: median(entrant.seconds))
    rounds = zip(best.seconds, ours.seconds, strict=True)
    return {
        **_figures(best, pair),
        "ratio_of_medians": median(best.seconds) / median(ours.seconds),
        "median_ratio": median(theirs / own for theirs, own in rounds),
        "opencv_threads": best.opencv_threads,
        "slower": {str(other.opencv_threads): other.seconds for other in others},
        "memory": memory_of(best.name, pair, threads=best.opencv_threads or 1),
    }


def _digest(file: str | None) -> str:
    """Return a digest that identifies a build of the core; builds of one version may differ."""
    if file is None:
        return "unknown"
    return hashlib.sha256(Path(file).read_bytes()).hexdigest()[:12]

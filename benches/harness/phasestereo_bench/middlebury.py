"""Scores methods x scenes x degradations on Middlebury; each gets a record of its metrics."""

import math
from collections.abc import Iterable
from dataclasses import asdict, fields
from typing import Any, NamedTuple

import numpy as np

from phasestereo.metrics import Score, bad_pixels, middlebury_v2, roc_area, score
from phasestereo_bench import cases
from phasestereo_bench.arrays import Floats, Image
from phasestereo_bench.cases import SIDES, SUITES, Case, require_known, usual_side
from phasestereo_bench.datasets import Pair, Scene
from phasestereo_bench.measurement import measured
from phasestereo_bench.methods import Matcher, Method, available, method
from phasestereo_bench.rigs import RIGS
from phasestereo_bench.runner import Job

Specs = Iterable[str | Matcher | Method]

_DEFAULTS = {
    "one-sided-blur": (
        "robust",
        "robust+true-blur",
        *(f"paper:neighborhood={side}" for side in (7, 11, 15, 21)),
        "paper:neighborhood=7+true-blur",
        "opencv:sgbm",
        "opencv:sgbm+true-blur",
    ),
    "sharp": ("robust", "fast", "paper", "opencv:bm", "opencv:sgbm", "opencv:sgbm-3x3"),
    **dict.fromkeys(
        RIGS, ("robust", "robust:num_disparities=auto", "fast", "opencv:bm", "opencv:sgbm")
    ),
}


def middlebury_jobs(
    scenes: Iterable[Scene],
    methods: Specs | None = None,
    degradations: Iterable[str] | None = None,
    *,
    suite: str = "one-sided-blur",
    sides: Iterable[str] | None = None,
) -> list[Job]:
    """Return the jobs that score methods on scenes with one degraded image, one per cell.

    Parameters
    ----------
    scenes
        Scenes with truth, as `phasestereo_bench.datasets.find_scenes` returns them.
    methods
        Names, functions ``(left, right, num_disparities) -> disparity`` (or a pair of a disparity
        and a confidence), or `Method`s, as `phasestereo_bench.method` takes them. Default: those of
        `default_methods`. If other processes cannot import a function, its cells fail, unless
        ``workers=0``.
    degradations
        Names of the suite, all of them by default.
    suite
        "one-sided-blur", "rigs", "rigs-2", or "sharp", whose only row is the pair as it is.
    sides
        Images to degrade: "left", "right" or both, one after the other; "alternating" is the left
        one of every other scene. Default: alternating for rigs, else left.

    Returns
    -------
    list of Job
        In their records, "kind", "suite", "collection", "scene", "degradation", "side", "method"
        and "true_blur" name the cell; "status" is "ok" or "failed". With "ok" there are "v2"
        (`MiddleburyV2`'s regions), "v3" (the other fields of `Score`), "d1", "epe" and "roc", the
        `phasestereo.metrics.roc_area` of the confidence (all four on the non-occluded pixels), None
        if a mask or a confidence is missing or nothing has an estimate; "num_disparities", "width"
        and "height"; the method's "settings"; "seconds" and "peak_bytes" of the call of the method
        alone; "environment". Otherwise "error" gives the reason: a method that raises, or returns
        anything but floats of the image's size, or two of these, fails its cell. A method with the
        true blur has no cell where the degradation has no kernel.

    Raises
    ------
    TypeError, ValueError
        If an argument is wrong, a scene has no truth, or no cell is left.
    ImportError
        If a package that a method needs is not installed.
    """
    # Files may have changed since an earlier call in this process.
    cases.forget()
    require_known("suite", [suite], SUITES)
    entrants = _entrants(default_methods(suite) if methods is None else methods)
    wanted = list(dict.fromkeys(sides or (usual_side(suite),)))
    require_known("side", wanted, SIDES)
    names = list(SUITES[suite] if degradations is None else dict.fromkeys(degradations))
    require_known("degradation", names, SUITES[suite])

    rows = [
        Case(scene, suite, degradation, side)
        for scene in _require_truth(scenes)
        for degradation in names
        for side in wanted
    ]

    jobs = [
        Job(
            {
                "kind": "middlebury",
                "suite": case.suite,
                "collection": case.scene.collection,
                "scene": case.scene.name,
                "degradation": case.degradation,
                "side": case.side,
                "method": entrant.name,
                "true_blur": entrant.true_blur,
            },
            score_case,
            {"case": case, "spec": spec},
        )
        for case in rows
        for entrant, spec in entrants
        if case.kernel is not None or not entrant.true_blur
    ]

    if not jobs:
        raise ValueError("no cell is left: only degradations with a kernel have a true blur")
    return jobs


def default_methods(suite: str) -> list[str]:
    """Return the methods of a suite that can run here, OpenCV's only if it is installed."""
    require_known("suite", [suite], SUITES)

    without_opencv = "opencv:sgbm" not in available()
    return [
        name for name in _DEFAULTS[suite] if not (without_opencv and name.startswith("opencv:"))
    ]


def has_truth(scene: Scene) -> bool:
    """Return whether a scene can be scored at all."""
    return (scene.folder / scene.layout.truth).is_file()


def score_case(case: Case, spec: str | Method) -> dict[str, Any]:
    """Match a case and return its record: the work of one cell."""
    entrant = method(spec)
    pair = case.pair(true_blur=entrant.true_blur)
    found = matched_pair(entrant, pair)
    confidence = found.confidence

    return {
        **_metrics(found.disparity, pair),
        "roc": None if confidence is None else _roc(confidence, found.disparity, pair),
        "num_disparities": pair.num_disparities,
        "width": pair.left.shape[1],
        "height": pair.left.shape[0],
        "settings": dict(entrant.settings),
        "seconds": found.seconds,
        "peak_bytes": found.peak_bytes,
    }


class Matched(NamedTuple):
    """The result of a method, its time and its memory."""

    disparity: Floats
    confidence: Floats | None
    seconds: float
    peak_bytes: int | None


def matched_pair(entrant: Method, pair: Pair) -> Matched:
    """Match a pair; see `matched`."""
    # If the range does not start at 0, the pair is shifted by its start. Methods that know the
    # start keep that pair; the others get the rig's own images.
    first = 0 if entrant.told else pair.first
    found = matched(entrant, pair.left, np.roll(pair.right, -first, axis=1), pair.num_disparities)
    return found._replace(disparity=found.disparity - first)


def matched(entrant: Method, left: Image, right: Image, num_disparities: int) -> Matched:
    """Match images and check what the method returns.

    Raises
    ------
    TypeError, ValueError
        If the result is anything but floats of the image's size, or two of these.
    """
    done = measured(lambda: entrant.match(left, right, num_disparities))
    answer = done.answer if isinstance(done.answer, tuple) else (done.answer, None)
    if len(answer) != 2:
        raise TypeError(f"the method returned {len(answer)} things, not disparities, confidences")

    disparity = _map(answer[0], left.shape[:2])
    confidence = None if answer[1] is None else _map(answer[1], left.shape[:2])
    return Matched(disparity, confidence, done.seconds, done.peak_bytes)


def wrong_shares(pair: Pair, spec: str | Method) -> dict[str, float]:
    """Match a pair; return the shares of wrong visible pixels, %: "bad_1", "bad_2"."""
    truth, mask = pair.scored
    found = matched_pair(method(spec), pair).disparity
    return {f"bad_{px}": bad_pixels(found, truth, float(px), mask) for px in (1, 2)}


def _metrics(disparity: Floats, pair: Pair) -> dict[str, Any]:
    by_region = middlebury_v2(disparity, pair)
    regions = {region: getattr(by_region, region) for region in ("nonocc", "all", "disc")}

    numbers: dict[str, Any] = dict.fromkeys(field.name for field in fields(Score))
    if "nonocc" in pair.masks:
        mask, count = pair.masks["nonocc"], pair.num_disparities
        numbers = asdict(score(disparity, pair.known_truth, mask=mask, num_disparities=count))

    d1, epe = numbers.pop("d1"), numbers.pop("epe")
    return {"v2": regions, "v3": numbers, "d1": d1, "epe": epe}


def _roc(confidence: Floats, disparity: Floats, pair: Pair) -> float | None:
    """Return the area under the ROC curve; None without a mask, or if all pixels are alike."""
    if pair.truth is None or "nonocc" not in pair.masks:
        return None

    area = roc_area(confidence, disparity, pair.truth, mask=pair.masks["nonocc"])
    return area if math.isfinite(area) else None


def _map(returned: object, size: tuple[int, ...]) -> Floats:
    """Return a map of a method, after checks."""
    if not isinstance(returned, np.ndarray):
        raise TypeError(f"the method returned {type(returned).__name__}, not an array")
    if not np.issubdtype(returned.dtype, np.floating):
        raise TypeError(
            f"the method returned {returned.dtype}, not floats: pixels, NaN without an estimate"
        )
    if returned.shape != size:
        raise ValueError(f"the method returned shape {returned.shape}, not {size}")
    return returned


def _entrants(specs: Specs) -> list[tuple[Method, str | Method]]:
    """Return the methods by name, with what other processes make them from: the name is lighter."""
    if isinstance(specs, str) or not hasattr(specs, "__iter__"):
        raise TypeError(f"methods: got {type(specs).__name__}; accepts a list of methods")

    entrants: dict[str, tuple[Method, str | Method]] = {}
    for spec in specs:
        entrant = method(spec)
        sent = spec if isinstance(spec, str) else entrant
        _, earlier = entrants.setdefault(str(entrant), (entrant, sent))
        if earlier != sent:
            raise ValueError(f"methods: two of them are called {entrant}; give them other names")

    if not entrants:
        raise ValueError("methods: got none; accepts one or more")
    return list(entrants.values())


def _require_truth(scenes: Iterable[Scene]) -> list[Scene]:
    wanted = list(scenes)
    without = [str(scene) for scene in wanted if not has_truth(scene)]
    if without:
        raise ValueError(f"scene: without truth there is nothing to score: {', '.join(without)}")
    return wanted

"""Measures how well `phasestereo.verify` judges the maps of other matchers.

Only pixels with a known truth count. A disparity is wrong if it is off by more than 1 px.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

import phasestereo as ps
from phasestereo.metrics import roc_area
from phasestereo.rig.findings import unwarned
from phasestereo_bench.arrays import Map, Mask
from phasestereo_bench.cases import Case, usual_side
from phasestereo_bench.datasets import Pair, Scene
from phasestereo_bench.methods import Method, method as as_method
from phasestereo_bench.middlebury import matched_pair
from phasestereo_bench.report.tables import Entry, Table

CONDITIONS: Mapping[str, str] = {
    "sharp": "rigs",
    "disk 6": "one-sided-blur",
    "gauss 2": "one-sided-blur",
    "motion 9": "one-sided-blur",
    "noise 20": "rigs",
    "jpeg 70": "rigs",
    "both disk 3": "rigs",
    "rows 1": "rigs",
}
"""The degradations of pairs, and the suite of each."""

_WRONG = 1.0  # px
_DIFFERENT, _CONFIDENT = 1.5, 0.8  # bounds that refute a map by disagreement alone


@dataclass(frozen=True, slots=True)
class Opinion:
    """Shares of the pixels of a map by their verdict, 0 to 1; NaN without any.

    Attributes
    ----------
    wrong
        Share of the visible pixels that are wrong.
    refuted_wrong, refuted_right
        Shares of the wrong and of the right pixels that are refuted.
    differ_wrong, differ_right
        The same shares by disagreement alone: a confident match is more than 1.5 px away.
    better
        Share of the refuted pixels whose better disparity is right.
    supported, supported_wrong
        Share of the visible pixels that are supported, and share of these that are wrong.
    refuted_hidden
        Share of the right pixels hidden in the other image that are refuted.
    area
        Area under the ROC curve of the confidences of the visible pixels.
    off
        Difference between the mean of the confidences and the share of right pixels.
    """

    wrong: float
    refuted_wrong: float
    refuted_right: float
    differ_wrong: float
    differ_right: float
    better: float
    supported: float
    supported_wrong: float
    refuted_hidden: float
    area: float
    off: float


def opinions(
    scenes: Sequence[Scene], methods: Sequence[str], conditions: Iterable[str]
) -> Iterator[tuple[str, str, Opinion]]:
    """Yield condition, method and means over the scenes.

    Raises
    ------
    OSError, ValueError, ImportError
        If a scene cannot be loaded or has no truth, or a method cannot run.
    """
    chosen = [as_method(each) for each in methods]

    for condition in conditions:
        suite = CONDITIONS[condition]
        cases = [Case(scene, suite, condition, usual_side(suite)) for scene in scenes]
        judged = [_judged(case.pair(true_blur=False), chosen) for case in cases]
        for method, of_scenes in zip(chosen, zip(*judged, strict=True), strict=True):
            yield condition, str(method), _mean(of_scenes)


def opinion_table(rows: Iterable[tuple[str, str, Opinion]]) -> Table:
    """Return conditions and methods down, shares in % across."""
    headings = (
        "condition", "method", "wrong", "wrong refuted", "right refuted", "by difference",
        "better is right", "supported", "of these wrong", "hidden, right refuted",
        "area", "confidence off",
    )  # fmt: skip

    entries = [
        (
            Entry(condition),
            Entry(method),
            _percent(found.wrong),
            _percent(found.refuted_wrong),
            _percent(found.refuted_right),
            Entry(f"{100 * found.differ_wrong:.1f} / {100 * found.differ_right:.1f}"),
            _percent(found.better),
            _percent(found.supported),
            _percent(found.supported_wrong),
            _percent(found.refuted_hidden),
            Entry(f"{found.area:.3f}"),
            _percent(found.off),
        )
        for condition, method, found in rows
    ]
    return Table(headings, tuple(entries), labels=2)


def _judged(pair: Pair, methods: Sequence[Method]) -> list[Opinion]:
    truth, visible = pair.scored
    seen = visible & np.isfinite(truth) & (np.arange(truth.shape[1]) >= np.nan_to_num(truth))
    hidden = pair.masks.get("all", seen) & np.isfinite(truth) & ~visible

    maps = (matched_pair(method, pair).disparity.astype(np.float32) for method in methods)
    return [_opinion(pair, claims, seen, hidden) for claims in maps]


def _opinion(pair: Pair, claims: Map, seen: Mask, hidden: Mask) -> Opinion:
    with unwarned():
        said = ps.verify(pair.left, pair.right, claims, threads=1)

    truth = pair.known_truth
    claimed = np.isfinite(claims)
    right = claimed & (np.abs(claims - truth) <= _WRONG)
    wrong = claimed & ~right

    refuted, supported = said.verdict == ps.Verdict.REFUTED, said.verdict == ps.Verdict.SUPPORTED
    differ = np.abs(said.result.disparity - claims) > _DIFFERENT
    if said.result.confidence is not None:
        differ &= said.result.confidence > _CONFIDENT

    return Opinion(
        wrong=_share(wrong, seen & claimed),
        refuted_wrong=_share(refuted, seen & wrong),
        refuted_right=_share(refuted, seen & right),
        differ_wrong=_share(differ, seen & wrong),
        differ_right=_share(differ, seen & right),
        better=_share(np.abs(said.better - truth) <= _WRONG, seen & refuted),
        supported=_share(supported, seen & claimed),
        supported_wrong=_share(wrong, seen & supported),
        refuted_hidden=_share(refuted, hidden & right),
        area=roc_area(said.confidence, claims, truth, mask=seen & claimed),
        off=abs(float(said.confidence[seen & claimed].mean()) - _share(right, seen & claimed)),
    )


def _share(pixels: Mask, of: Mask) -> float:
    return float(pixels[of].mean()) if of.any() else float("nan")


def _mean(found: Sequence[Opinion]) -> Opinion:
    def mean(name: str) -> float:
        values = np.array([getattr(each, name) for each in found])
        known = values[np.isfinite(values)]
        return float(known.mean()) if known.size else float("nan")

    return Opinion(**{field.name: mean(field.name) for field in fields(Opinion)})


def _percent(share: float) -> Entry:
    return Entry(f"{100 * share:.1f}" if np.isfinite(share) else "-")

"""The figures of an earlier prototype of the method, and the settings they were made with.

The prototype was written in NumPy, before this package. Its notes leave some settings open; those
here were found by trying which give its figures again. All figures are percentages of the pixels
that both images see.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from phasestereo_bench.paper.experiments import (
    AREAS,
    GAUSS,
    MOTION_X,
    NSAD,
    PHASE,
    RULES,
    SAD,
    Experiment,
    odd,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from phasestereo.settings import Settings
    from phasestereo_bench.paper.experiments import MatchingCost

__all__ = ["Figure", "figures"]


class Figure(NamedTuple):
    """One figure of the prototype: what it is of, its settings, and the %.

    `rule` is how L follows from the level, or L itself; empty for methods without.
    """

    scene: str
    experiment: Experiment
    level: float
    method: MatchingCost
    rule: str
    settings: Settings
    published: float


class _Row(NamedTuple):
    """Figures of one method by level; a window of None is that of the protocol "tied"."""

    scene: str
    experiment: Experiment
    method: MatchingCost
    rule: str
    penalty: float
    published: Mapping[float, float]
    window: int | None = None


# In the third experiment the prototype gave phase codes a smaller window than their rivals, and on
# each pair the penalty that was the best on the sharp one.
_ROWS = (
    _Row("cones", MOTION_X, PHASE, "2n + 1", 1, {7: 20.7, 11: 32.0, 15: 42.3, 21: 52.0}),
    _Row("cones", MOTION_X, SAD, "", 20, {7: 35.7, 11: 43.3, 15: 48.5, 21: 58.4}),
    _Row("cones", MOTION_X, NSAD, "", 0.5, {7: 64, 21: 81}),
    _Row("cones", MOTION_X, PHASE, "n", 0.5, {7: 55, 21: 78}),
    _Row("tsukuba", MOTION_X, PHASE, "3n", 1, {7: 11.8, 11: 18.2, 15: 26.5, 21: 34.4}),
    _Row("tsukuba", MOTION_X, SAD, "", 20, {7: 9.7, 11: 22.5, 15: 31.2, 21: 42.1}),
    _Row("cones", GAUSS, PHASE, "4 sigma + 1", 0.5, {2: 16.4, 3: 23.7, 4: 32.3, 5: 38.0}),
    _Row("cones", GAUSS, SAD, "", 20, {2: 28.4, 3: 37.7, 4: 45.6, 5: 51.4}),
    _Row("tsukuba", GAUSS, PHASE, "7", 1, {0: 5.3}),
    _Row("tsukuba", GAUSS, SAD, "", 20, {0: 2.9}),
    _Row("cones", AREAS, PHASE, "21", 0.5, {11: 29.8}, window=9),
    _Row("cones", AREAS, SAD, "", 20, {11: 44.0}),
    _Row("cones", AREAS, NSAD, "", 0.5, {11: 38.4}),
    _Row("tsukuba", AREAS, PHASE, "21", 2, {11: 18.1}, window=9),
    _Row("tsukuba", AREAS, SAD, "", 20, {11: 19.9}),
    _Row("tsukuba", AREAS, NSAD, "", 0.5, {11: 24.6}),
)


def figures() -> list[Figure]:
    """Return all the figures of the prototype, those of a method by growing blur."""
    return [_figure(row, level) for row in _ROWS for level in row.published]


def _figure(row: _Row, level: float) -> Figure:
    settings = row.method.settings(
        window=row.window or row.experiment.window(level),
        penalty=row.penalty,
        neighborhood=_side(row.rule, level),
        power=row.experiment.power,
    )
    published = row.published[level]
    return Figure(row.scene, row.experiment, level, row.method, row.rule, settings, published)


def _side(rule: str, level: float) -> int | None:
    """Return the L that a rule means: a rule of the experiments, the level itself, or a number."""
    if not rule:
        return None
    if rule == "n":
        return odd(level)

    return odd(RULES[rule](level)) if rule in RULES else int(rule)

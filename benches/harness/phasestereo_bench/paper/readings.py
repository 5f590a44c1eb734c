"""What was measured, one record for every point of a figure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from collections.abc import Iterable

    from phasestereo_bench.paper.cells import Cell, Scores

__all__ = ["Reading", "curve", "reading"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """One point of a figure.

    Attributes
    ----------
    experiment, scene, protocol, method, rule, level
        Which point: keys of an experiment ("bits" being Figure 3) and of a pair, "tied" or
        "fixed", the cost, the rule for L (empty where there is none), and the amount of blur.
    power, bits, neighborhood, window, penalty
        The settings; the first three are None for methods without phase codes.
    nonocc, all, disc
        % of the pixels that are off by more than 1 pixel: of those that both images see, of all,
        and of those near a jump in depth; None where the pair has no such mask.
    """

    experiment: str
    scene: str
    protocol: str
    method: str
    rule: str
    level: float
    power: int | None
    bits: int | None
    neighborhood: int | None
    window: int
    penalty: float
    nonocc: float
    all: float | None
    disc: float | None


def reading(
    cell: Cell, scores: Scores, *, experiment: str, protocol: str, rule: str, level: float
) -> Reading:
    """Return the record of a point, from the cell that it shows and the scores of that."""
    settings = cell.settings
    is_phase = settings.cost == "phase"
    return Reading(
        experiment=experiment,
        scene=cell.scene,
        protocol=protocol,
        method=settings.cost,
        rule=rule,
        level=level,
        power=settings.power if is_phase else None,
        bits=settings.bits if is_phase else None,
        neighborhood=settings.neighborhood if is_phase else None,
        window=settings.window,
        penalty=cast("float", settings.penalty),
        nonocc=scores.nonocc,
        all=scores.all,
        disc=scores.disc,
    )


def curve(readings: Iterable[Reading], **wanted: str | float) -> dict[float, float]:
    """Return the % of bad non-occluded pixels by level, of the points with these attributes."""
    return {
        each.level: each.nonocc
        for each in readings
        if all(getattr(each, name) == value for name, value in wanted.items())
    }

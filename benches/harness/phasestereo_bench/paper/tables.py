"""Tables of what was compared, chosen and measured, in text."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from phasestereo_bench.paper.claims import GAIN
from phasestereo_bench.paper.readings import curve
from phasestereo_bench.report.tables import MISSING, Entry, Table

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from phasestereo_bench.paper.claims import Case, Flatness
    from phasestereo_bench.paper.prototype import Figure
    from phasestereo_bench.paper.readings import Reading
    from phasestereo_bench.paper.study import Study
    from phasestereo_bench.paper.wording import Claim

__all__ = [
    "bits_table",
    "cases_table",
    "choices_table",
    "claims_table",
    "in_figure_2",
    "prototype_table",
]


def claims_table(found: Sequence[Claim]) -> Table:
    """Return the verdicts."""
    rows = [
        (claim.name, finding.way, finding.verdict.value, finding.holds_at)
        for claim in found
        for finding in claim.findings
    ]
    return _table(("claim", "settings", "verdict", "holds at"), rows, labels=3)


def cases_table(found: Sequence[Case]) -> Table:
    """Return how phase codes fare in every case of one way to set the methods up."""
    header = (
        *("pair", "left image", "the paper's rival", "better at", "better than both at"),
        *("gain at the larger blurs, points", f"{GAIN:g} points or more at"),
    )
    return _table(header, map(_case_row, found), labels=3)


def _case_row(case: Case) -> Sequence[str]:
    gains, larger = list(case.gains.values()), list(case.larger_gains.values())
    over_best = case.gains_over_best.values()
    return (
        case.scene.title(),
        case.experiment.title,
        case.experiment.rival.name,
        f"{sum(gain > 0 for gain in gains)} of {len(gains)}",
        f"{sum(gain > 0 for gain in over_best)} of {len(gains)}",
        f"{min(larger):+.1f} to {max(larger):+.1f}",
        f"{sum(gain >= GAIN for gain in larger)} of {len(larger)}",
    )


def bits_table(found: Sequence[Flatness]) -> Table:
    """Return the figures of Figure 3."""
    bits = list(found[0].bad)
    rows = [
        (
            line.protocol,
            line.scene.title(),
            f"{line.sigma:g}",
            *(f"{line.bad[b]:.1f}" for b in bits),
            f"{line.spread:.1f}",
        )
        for line in found
    ]
    header = ("settings", "pair", "sigma", *(f"b = {b}" for b in bits), "spread")
    return _table(header, rows, labels=2)


def prototype_table(study: Study) -> Table:
    """Return the prototype's figures beside what was measured."""
    header = (
        *("pair", "left image", "level", "method", "window", "penalty"),
        *("prototype", "here", "difference", "by the suite's recipe", "in Figure 2, tied"),
    )
    rows = []
    for figure, measured, suite in study.prototype:
        beside = in_figure_2(figure, study.readings)
        rows.append(
            (
                figure.cell.scene.title(),
                figure.experiment.title,
                f"{figure.experiment.symbol} = {figure.level:g}",
                figure.method.name + (f", L = {figure.rule}" if figure.rule else ""),
                str(figure.cell.settings.window),
                f"{cast('float', figure.cell.settings.penalty):g}",
                f"{figure.published:.1f}",
                f"{measured:.1f}",
                f"{round(measured - figure.published, 1) + 0:+.1f}",  # + 0: no minus before zero
                f"{suite:.1f}",
                MISSING if beside is None else f"{beside:.1f}",
            )
        )
    return _table(header, rows, labels=4)


def in_figure_2(figure: Figure, readings: Sequence[Reading]) -> float | None:
    """Return what Figure 2 has in place of a figure of the prototype, if anything."""
    line = curve(
        readings,
        experiment=figure.experiment.key,
        scene=figure.cell.scene,
        protocol="tied",
        method=figure.method.cost,
        rule=figure.rule,
    )
    return line.get(float(figure.level))


def choices_table(study: Study) -> Table:
    """Return the settings that were chosen on the sharp pairs."""
    header = (
        *("pair", "method", "unit of the penalty", "fixed: L", "window", "penalty"),
        *("bad, %", "tied: penalty", "bad, %"),
    )
    rows = []
    for whose, choice in study.choices.items():
        is_phase = whose.method.cost == "phase"
        rows.append(
            (
                whose.scene.title(),
                whose.method.name + (f", k = {whose.power}" if is_phase else ""),
                whose.method.unit,
                str(choice.fixed.neighborhood) if is_phase else MISSING,
                str(choice.fixed.window),
                f"{cast('float', choice.fixed.penalty):g}",
                f"{choice.fixed_bad:.1f}",
                f"{choice.penalty:g}",
                f"{choice.penalty_bad:.1f}",
            )
        )
    return _table(header, rows, labels=3)


def _table(header: Sequence[str], rows: Iterable[Sequence[str]], *, labels: int) -> Table:
    return Table(tuple(header), tuple(tuple(map(Entry, row)) for row in rows), labels)

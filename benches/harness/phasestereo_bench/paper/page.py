"""Writes the results of the experiments: Figures 2 and 3, and a page of all tables."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from phasestereo.io.drafts import replace_text
from phasestereo_bench.paper.claims import (
    CLAIMS,
    SETUPS,
    bits_table,
    cases,
    cases_table,
    claims_table,
    judge_claims,
    lines,
    settings_table,
)
from phasestereo_bench.paper.experiments import EXPERIMENTS, NSAD, PROTOCOLS, SAD
from phasestereo_bench.paper.study import SCENES, Reading, Study, curve
from phasestereo_bench.report.markdown import markdown_table, markdown_text
from phasestereo_bench.report.origin import made_with
from phasestereo_bench.report.plots import figure_of, save_plot
from phasestereo_bench.store import read_store

Panels = Mapping[str, Mapping[str, Mapping[Any, float]]]


_RIVALS = {SAD.name: "black", NSAD.name: "gray"}  # in every panel; others take the usual colors

_INTRODUCTION = """
Pedone & Heikkilä blur the left image of a stereo pair, and compare phase codes with sums of
absolute differences (*Blur and Contrast Invariant Fast Stereo Matching*, ACIVS 2008). Here are
their experiments on their pairs. Bad pixels are more than 1 px off, of those that both images see.

Methods are set up without a look at any blurred pair. *Fixed*: the settings that are the best on
the sharp pair, at all levels of blur. *Tied*: window and neighborhood L follow from the size of the
blur, as in the paper, the first by the paper's own rule; the penalty is the best on the sharp pair.

A claim is reproduced if it holds at all levels of blur, or for all lines of Figure 3; for that of
5 points "in many cases", half of the levels in the upper half of the range are enough. Two thirds
as many reproduce it in part.
"""


def write_study(study: Study, store: Path, folder: Path) -> list[Path]:
    """Write the figures and the page; replace those of an earlier run.

    Parameters
    ----------
    study
        The measured study.
    store
        The file where `run_study` kept the records, with their machine and software.
    folder
        An existing folder to write to.

    Returns
    -------
    list of Path
        The files, ``paper.md`` last.

    Raises
    ------
    OSError
        If a file cannot be read or written.
    """
    files = _draw_figures(study.readings, folder)
    environments = [line for line in read_store(store) if line.get("kind") == "environment"]
    page = folder / "paper.md"
    replace_text(page, _page(study, environments))
    return [*files, page]


def _page(study: Study, environments: Sequence[Mapping[str, Any]]) -> str:
    """Return the page as Markdown."""
    readings = study.readings
    tables = {
        "The claims": claims_table(judge_claims(readings)),
        **{f"Gains, {setup.name}": cases_table(cases(readings, setup)) for setup in SETUPS},
        "Figure 3: bad pixels in % by the bits b of the phase": bits_table(lines(readings)),
        "Settings chosen on the sharp pairs": settings_table(study),
    }

    trial = "**This is a quick trial of few levels and settings: no verdict on the paper.**"
    parts = ["# The paper's experiments, measured again", _INTRODUCTION.strip()]
    parts += [trial] if study.quick else []
    parts.append("\n".join(f"- {name}: “{markdown_text(q)}”" for name, q in CLAIMS.items()))

    for title, table in tables.items():
        parts += [f"## {title}", markdown_table(table)]
    parts.append("## Figures")
    parts += [f"![Figure {n}, {p}](figure{n}_{p}.svg)" for n in (2, 3) for p in PROTOCOLS]

    return "\n\n".join([*parts, made_with(environments)]) + "\n"


def _draw_figures(readings: Sequence[Reading], folder: Path) -> list[Path]:
    """Draw Figures 2 and 3 in the paper's layout: a column for Cones, one for Tsukuba."""
    files = []
    for protocol in PROTOCOLS:
        blur: dict[str, dict[str, dict[float, float]]] = {}
        for each in EXPERIMENTS:
            for scene in SCENES:
                where = {"experiment": each.key, "scene": scene, "protocol": protocol}
                blur[f"{scene.title()}: {each.title}, {each.symbol}"] = {
                    method.name + (f", L = {rule}" if rule else ""): curve(
                        readings, **where, method=method.cost, rule=rule
                    )
                    for _, method, rule in each.series(protocol)
                }

        bits: dict[str, dict[str, dict[int, float]]] = {}
        for line in lines(readings):
            if line.protocol == protocol:
                panel = bits.setdefault(f"{line.scene.title()}: bits b of the phase", {})
                panel[f"sigma = {line.sigma:g}"] = line.bad

        files.append(_draw(blur, folder / f"figure2_{protocol}.svg"))
        files.append(_draw(bits, folder / f"figure3_{protocol}.svg"))

    return files


def _draw(panels: Panels, path: Path) -> Path:
    """Draw lines by name in panels by title, two in a row."""
    height = len(panels) // 2
    figure = figure_of(8, 2.4 * height)
    grid = figure.subplots(height, 2, squeeze=False)

    for axes, (title, named) in zip(grid.flat, panels.items(), strict=True):
        for name, line in named.items():
            axes.plot(
                list(line),
                list(line.values()),
                "o-",
                markersize=3,
                label=name,
                color=_RIVALS.get(name),
            )

        axes.set_title(title, fontsize=9)
        axes.set_ylabel("bad pixels, %")
        axes.set_ylim(bottom=0)
        axes.grid(visible=True, alpha=0.3)
        axes.legend(fontsize=6)

    save_plot(figure, path)
    return path

"""The paper's figures in the paper's layout: a column for Cones, one for Tsukuba."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from phasestereo.io.files import replacing
from phasestereo.picture import colorize
from phasestereo_bench.paper.cells import SCENES
from phasestereo_bench.paper.claims import flatness
from phasestereo_bench.paper.experiments import BITS, EXPERIMENTS, GAUSS
from phasestereo_bench.paper.methods import PHASE
from phasestereo_bench.paper.readings import curve

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from phasestereo_bench.paper.experiments import Experiment, Series
    from phasestereo_bench.paper.maps import SceneMaps
    from phasestereo_bench.paper.readings import Reading

__all__ = ["save_bits", "save_comparison", "save_maps"]

# Blue, vermilion and gray, which everybody can tell apart (Okabe & Ito, Color Universal Design).
_LINES: Mapping[tuple[str, int], Mapping[str, Any]] = {
    ("phase", 0): {"color": "#0072b2", "linewidth": 2.4, "marker": "o", "zorder": 4},
    ("phase", 1): {
        "color": "#56b4e9",
        "linewidth": 1.6,
        "marker": "o",
        "markerfacecolor": "white",
        "zorder": 3,
    },
    ("sad", 0): {"color": "#d55e00", "linewidth": 1.6, "marker": "s", "zorder": 2},
    ("nsad", 0): {"color": "#8c8c8c", "linewidth": 1.6, "marker": "^", "zorder": 1},
}
_SHADES = ("#56b4e9", "#0072b2", "#003b5c")  # of the three amounts of blur in Figure 3
_STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#606060",
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "grid.color": "#e4e4e4",
    "lines.markersize": 4,
    "legend.frameon": False,
    "svg.hashsalt": "phasestereo",  # the same results give the same file
}
_WIDTH, _DPI = 7.8, 160
_ERROR = "bad pixels (%)"


def save_comparison(readings: Sequence[Reading], protocol: str, stem: Path) -> list[Path]:
    """Draw Figure 2, error against blur, a row for each experiment; write it as PNG and SVG.

    Parameters
    ----------
    readings
        Of a study.
    protocol
        Which of them.
    stem
        Path without suffix.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    with _figure((_WIDTH, 2.1 * len(EXPERIMENTS) + 0.5)) as figure:
        panels = figure.subplots(len(EXPERIMENTS), len(SCENES), squeeze=False)
        for row, experiment in zip(panels, EXPERIMENTS, strict=True):
            for scene, axes in zip(SCENES, row, strict=True):
                _draw_lines(axes, readings, experiment, scene, protocol)
                axes.set(
                    title=f"{scene.title()}: {experiment.title}", xlabel=_greek(experiment.axis)
                )
                axes.locator_params(axis="x", integer=True)
                axes.set_ylim(bottom=0)
            row[0].set_ylabel(_ERROR)
        _add_legend(figure, panels[0][0])
        return _save(figure, stem)


def save_bits(readings: Sequence[Reading], protocol: str, stem: Path) -> list[Path]:
    """Draw Figure 3, error against the bits of the phase; write it as PNG and SVG.

    Arguments, result and errors as of `save_comparison`.
    """
    with _figure((_WIDTH, 2.9)) as figure:
        row = figure.subplots(1, len(SCENES))
        for scene, axes in zip(SCENES, row, strict=True):
            lines = [
                each
                for each in flatness(readings)
                if (each.scene, each.protocol) == (scene, protocol)
            ]
            for line, colour in zip(lines, _SHADES, strict=False):
                bits, bad = list(line.bad), list(line.bad.values())
                label = _greek(f"sigma = {line.sigma:g} pixels")
                axes.plot(bits, bad, "o-", color=colour, linewidth=2, label=label)
            axes.set(title=scene.title(), xlabel="bits of the phase, b", xticks=BITS)
            axes.set_ylim(bottom=0)
        row[0].set_ylabel(_ERROR)
        _add_legend(figure, row[0])
        return _save(figure, stem)


def save_maps(rows: Sequence[SceneMaps], stem: Path) -> list[Path]:
    """Draw Figure 5, disparity maps in colour, a row for each pair; write it as PNG and SVG.

    Parameters
    ----------
    rows
        As `make_maps` returns them.
    stem
        Path without suffix.

    Returns
    -------
    list of Path
        The files; errors as of `save_comparison`.
    """
    columns = len(rows[0].found) + 2
    heights = [row.left.shape[0] / row.left.shape[1] for row in rows]
    width = 12.0
    size = (width, sum(width / columns * height + 0.3 for height in heights))
    with _figure(size) as figure:
        panels = figure.subplots(len(rows), columns, height_ratios=heights, squeeze=False)
        for row, axes in zip(rows, panels, strict=True):
            _draw_row(row, axes)
        return _save(figure, stem)


def _draw_lines(
    axes: Any, readings: Sequence[Reading], experiment: Experiment, scene: str, protocol: str
) -> None:
    for series in experiment.series(protocol):
        line = curve(
            readings,
            experiment=experiment.key,
            scene=scene,
            protocol=protocol,
            method=series.method.cost,
            rule=series.rule,
        )
        number = experiment.rules.index(series.rule) if series.rule else 0
        style = _LINES[series.method.cost, number]
        axes.plot(list(line), list(line.values()), label=_label(experiment, series), **style)


def _draw_row(row: SceneMaps, axes: Any) -> None:
    """Draw the maps of a pair, in colours that run from its smallest to its largest disparity."""
    known = row.truth[np.isfinite(row.truth)]
    ends = {"low": float(known.min()), "high": float(known.max())}
    pictures = {f"{row.scene.title()}, left image": row.left}
    for each in row.found:
        pictures[f"{each.name}: {each.bad:.1f} % bad"] = colorize(each.disparity, **ends)
    pictures["truth"] = colorize(row.truth, **ends)
    for panel, (title, picture) in zip(axes, pictures.items(), strict=True):
        panel.imshow(picture, interpolation="none")
        colour = _LINES["phase", 0]["color"] if title.startswith(PHASE.name) else "black"
        panel.set_title(f"{title[0].upper()}{title[1:]}", color=colour)
        panel.set_axis_off()


def _label(experiment: Experiment, series: Series) -> str:
    """Name a line; the legend takes its names from a row of motion, where the rules are others."""
    if not series.rule:
        return series.method.name
    label = f"{series.method.name}, L = {series.rule}"
    is_first = series.rule == experiment.rules[0]
    return _greek(f"{label} (Gaussian: {GAUSS.rules[0]})") if is_first else label


def _greek(text: str) -> str:
    """Return text with the letter in place of its name, as matplotlib spells it."""
    return text.replace("4 sigma", "4sigma").replace("sigma", r"$\sigma$")


def _add_legend(figure: Any, axes: Any) -> None:
    """Put a legend above all panels, where it covers none."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), columnspacing=1.4)


@contextmanager
def _figure(size: tuple[float, float]) -> Iterator[Any]:
    """Provide a figure of a size in inches which no global state knows of, in the common style."""
    import matplotlib  # noqa: PLC0415  # slow to import, and most of the harness does without
    from matplotlib.figure import Figure  # noqa: PLC0415  # slow to import, and most of the harness does without

    with matplotlib.rc_context(_STYLE):
        yield Figure(size, layout="constrained")


def _save(figure: Any, stem: Path) -> list[Path]:
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # keeps the layout, which would be found again for each file
    files = [stem.with_suffix(suffix) for suffix in (".png", ".svg")]
    for path in files:
        # No date: the same results give the same file.
        metadata = {"Date": None} if path.suffix == ".svg" else {}
        with replacing(path) as file:
            figure.savefig(file, format=path.suffix[1:], dpi=_DPI, metadata=metadata)
    return files

"""Plots the means of all methods, and holds the parts that all plots of this package share.

Every method keeps its color and its mark in all plots: phase codes are blue, and methods that know
the blur are hollow. Figures are matplotlib objects that pyplot does not manage.
"""

from collections.abc import Collection, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any, NamedTuple

from phasestereo.io.drafts import replacing
from phasestereo_bench.methods import TRUE_BLUR
from phasestereo_bench.report.cells import METRICS
from phasestereo_bench.report.results import Results, knows_blur
from phasestereo_bench.report.tables import groups, means, overall, scene_count

# Color-blind people can distinguish Okabe and Ito's colors; only our methods are blue.
_OURS = ("#0b66c3", "#56b4e9", "#0a2f66", "#7d9bd1")
_OTHERS = ("#d55e00", "#e69f00", "#009e73", "#cc79a7", "#777777", "#a6761d", "#000000")
_OUR_MARKS, _OTHER_MARKS = "os^Dh", "vPX<>*"  # no common divisor with the number of colors
RIVAL = "opencv:sgbm"
"""The method to compare ours with, if the results have it."""

INK, SOFT, GRID = "#1f2328", "#59636e", "#e3e7eb"
_DPI = 200


class Style(NamedTuple):
    """The color and the mark of a method."""

    color: str
    mark: str
    hollow: bool

    def marker(self, size: float) -> dict[str, Any]:
        """Return the keywords of a line that consists of markers."""
        return {
            "marker": self.mark,
            "markersize": 0.8 * size if self.hollow else size,
            "markeredgewidth": 0.2 * size if self.hollow else 0.08 * size,
            "markeredgecolor": self.color if self.hollow else "white",
            "markerfacecolor": "none" if self.hollow else self.color,
            "linestyle": "none",
            "zorder": 3,
        }


def styles(results: Results, metric: str) -> dict[str, Style]:
    """Return the style of each method.

    Our best method has the color that stands out. A method that knows the blur is drawn like the
    method itself, but hollow.
    """
    stems = {method: method.removesuffix(TRUE_BLUR) for method in results.methods}

    best = leader(results, metric, results.ours)
    ours = dict.fromkeys(stems[method] for method in (best, *results.ours) if method is not None)
    known = [RIVAL] if RIVAL in stems.values() else []  # so its color is always the same
    others = dict.fromkeys(stem for stem in (*known, *stems.values()) if stem not in ours)

    looks = dict(zip(ours, zip(cycle(_OURS), cycle(_OUR_MARKS), strict=False), strict=False))
    looks |= dict(zip(others, zip(cycle(_OTHERS), cycle(_OTHER_MARKS), strict=False), strict=False))

    return {method: Style(*looks[stem], knows_blur(method)) for method, stem in stems.items()}


def leader(results: Results, metric: str, methods: Collection[str]) -> str | None:
    """Return the best method over all blurs that does not know the blur; None without any."""
    values = overall(results, metric).values
    running = [method for method in methods if method in values and not knows_blur(method)]
    return min(running, key=lambda m: METRICS[metric].rank(values[m]), default=None)


def draw_means(results: Results, metric: str) -> Any:
    """Draw each method's mean over the scenes, with a line for each degradation.

    Returns
    -------
    matplotlib.figure.Figure

    """
    rows, looks = groups(results), styles(results, metric)
    figure = figure_of(9.0, 1.3 + max(0.4 * len(rows), 0.24 * len(results.methods)))
    axes, labels, uniform = figure.add_subplot(), [], scene_count(results, metric)

    for line, (name, degradations) in enumerate(rows.items()):
        scenes, values = means(results, metric, degradations)
        labels.append(name if uniform else f"{name}  ({scenes})")
        for method, value in values.items():
            axes.plot([value], [line], **looks[method].marker(9))

    for method in results.methods:
        axes.plot([], [], label=method, **looks[method].marker(9))

    rule(axes, labels)
    axes.set_xlim(left=min(0, axes.get_xlim()[0]))
    axes.set_xlabel(f"{METRICS[metric].label}: {METRICS[metric].better}", color=SOFT)
    over = uniform or "scenes (how many)"

    title = f"Means over {over}, {results.state}"
    figure.suptitle(title, x=0.01, ha="left", size=12, weight="bold", color=INK)
    figure.legend(loc="outside right upper", frameon=False, handletextpad=0.2)

    return figure


def save_plot(figure: Any, path: Path) -> None:
    """Write a figure in the format of the suffix, the same bytes every time.

    Raises
    ------
    OSError
        If the file cannot be written.
    ValueError
        If its name ends neither in .svg nor in .png.
    """
    kind = path.suffix.removeprefix(".")
    if kind not in ("svg", "png"):
        raise ValueError(f"output: got {path}; accepts names that end in .svg or .png")
    undated = {"Date": None} if kind == "svg" else {}
    import matplotlib  # noqa: PLC0415  # slow to import, and most of the harness does without

    context = matplotlib.rc_context({"svg.hashsalt": "phasestereo", "svg.fonttype": "none"})
    with context, replacing(path) as file:
        figure.savefig(file, format=kind, dpi=_DPI, metadata=undated)


def figure_of(width: float, height: float) -> Any:
    """Return a figure of this size in inches."""
    from matplotlib.figure import Figure  # noqa: PLC0415  # slow to import, and most of the harness does without

    return Figure(figsize=(width, height), layout="constrained", facecolor="white")


def rule(axes: Any, labels: Sequence[str]) -> None:
    """Give the axes one line and label per row, the first on top, and nothing else."""
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(len(labels) - 0.5, -0.5)
    axes.tick_params(length=0, colors=INK, labelsize=9)

    axes.grid(color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_visible(False)

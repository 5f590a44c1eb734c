"""Shows in three pictures and a table where our presets win and where other methods win.

It uses only the file of numbers that `export` writes, so it runs nothing.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

from phasestereo_bench.report.cells import METRIC, METRICS
from phasestereo_bench.report.documents import small_print
from phasestereo_bench.report.markdown import markdown_table
from phasestereo_bench.report.origin import made_with
from phasestereo_bench.report.plots import GRID, INK, SOFT, figure_of, rule, save_plot
from phasestereo_bench.report.tables import MISSING, Entry, Table, figures
from phasestereo_bench.rigs import RIGS
from phasestereo_bench.tables.headline import largest_sharp
from phasestereo_bench.tables.plan import AUTO

Numbers = Mapping[str, Any]
Dots = tuple[str, Mapping[str, float]]

_LOOKS = {
    AUTO: ("robust, nothing given", "#0b66c3", "o"),
    "fast": ("fast", "#56b4e9", "s"),
    "paper": ("paper", "#0a2f66", "^"),
    "opencv:bm": ("StereoBM", "#a6761d", "v"),
    "opencv:sgbm-3way": ("StereoSGBM, 3 paths", "#e69f00", "P"),
    "opencv:sgbm-5way": ("StereoSGBM, 5 paths", "#cc79a7", "*"),
    "opencv:sgbm": ("StereoSGBM, 8 paths", "#d55e00", "X"),
    "hitnet": ("HITNet", "#009e73", "h"),
    "prepared:hitnet": ("HITNet, prepared pair", "#66c2a5", "H"),
    "fused:hitnet": ("robust and HITNet", "#7b3294", "D"),
    "mccnn": ("MC-CNN", "#777777", "<"),
}
"""The methods to show: title, color, mark."""

_SURFACES = ("rooms, 0.5 MP", "large planes", "scenes as they are")
_SHOWN = (AUTO, "opencv:sgbm", "hitnet", "fused:hitnet")
_OFF = "more than 1 px off, %: less is better"
_WORDS = (
    "More than 1 px off, %, non-occluded pixels: less is better. Means over the faults of a group "
    "of rigs and over the scenes that were run. s / MP and MB: of the largest sharp pair on one "
    "thread, per megapixel, and the rise of the memory. Bold: the best."
)


def read_numbers(path: Path) -> Numbers:
    """Return the numbers written by `export`.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If the file has other contents.
    """
    numbers = json.loads(path.read_text("utf-8"))
    if not isinstance(numbers, dict) or not {"suites", "costs"} <= set(numbers):
        raise ValueError(f"{path}: these are not the numbers that bench tables writes")
    return numbers


def draw_comparison(numbers: Numbers, folder: Path) -> list[Path]:
    """Draw the pictures for which there are numbers, and return their paths.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    drawn = {
        "compare-time.svg": _draw_time(numbers),
        "compare-faults.svg": _draw_faults(numbers),
        "compare-pixels.svg": _draw_pixels(numbers),
    }
    for name, figure in drawn.items():
        if figure is not None:
            save_plot(figure, folder / name)
    return [folder / name for name, figure in drawn.items() if figure is not None]


def comparison_text(numbers: Numbers) -> str:
    """Return as Markdown the table of groups of faults, time and memory, and the text below it."""
    ran = {cost["environment"] for cost in _costs(numbers)}
    environments = [each for each in numbers["environments"] if each["id"] in ran]
    table = markdown_table(comparison_table(numbers))
    return f"{table}\n\n{small_print(f'{_WORDS} Times: {made_with(environments)}')}"


def comparison_table(numbers: Numbers) -> Table:
    """Return groups of faults, time and memory down, and methods with two groups across."""
    groups: dict[str, dict[str, list[float]]] = {"sharp": _means(numbers, "sharp", "sharp")}
    for suite, name, values in _faults(numbers):
        of_group = groups.setdefault(RIGS[suite][name].group, {})
        for method, value in values.items():
            of_group[method] = [*of_group.get(method, []), *value]

    there = [m for m in _LOOKS if sum(m in found for found in groups.values()) > 1]
    rows = []
    for group, found in groups.items():
        means = {method: fmean(found[method]) for method in there if method in found}
        rows.append((Entry(group), *figures(there, means, METRICS[METRIC])))

    for title, field, scale, form in (
        ("s / MP", "seconds", 1e6, ".2g"),
        ("MB", "peak_bytes", 1e-6, ".0f"),
    ):
        costs = [largest_sharp(_costs(numbers), method) or {} for method in there]
        each = [cost["pixels"] if cost and field == "seconds" else 1 for cost in costs]
        taken = [
            f"{cost[field] * scale / per:{form}}" if cost.get(field) else MISSING
            for cost, per in zip(costs, each, strict=True)
        ]
        rows.append((Entry(title), *map(Entry, taken)))

    return Table(("", *(_LOOKS[method][0] for method in there)), tuple(rows))


def _draw_time(numbers: Numbers) -> Any:
    """Draw errors on sharp pairs against time."""
    errors = {m: fmean(v) for m, v in _means(numbers, "sharp", "sharp").items()}
    times = {m: cost for m in errors if (cost := largest_sharp(_costs(numbers), m)) is not None}
    shown = [method for method in _LOOKS if method in times]
    if not shown:
        return None

    figure = figure_of(7.0, 4.0)
    axes = figure.add_subplot()
    for method in shown:
        title, color, mark = _LOOKS[method]
        spot = (1e9 * times[method]["seconds"] / times[method]["pixels"], errors[method])
        axes.plot(*spot, mark, color=color, markersize=9)
        # If other marks are close on the right, the label goes on the left.
        beside, side = ((-7, 4), "right") if method == "opencv:sgbm-3way" else ((7, 4), "left")
        axes.annotate(title, spot, beside, textcoords="offset points", ha=side, color=INK, size=9)

    axes.set_xscale("log")
    axes.margins(x=0.25, y=0.12)
    axes.set_ylim(bottom=0)
    axes.grid(color=GRID)
    ran = times[shown[0]]["environment"]
    machine = next(each["cpu"] for each in numbers["environments"] if each["id"] == ran)
    axes.set_xlabel(f"milliseconds a megapixel, one thread of {machine}", color=SOFT)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_ylabel(f"sharp pairs, {_OFF}", color=SOFT)
    return figure


def _draw_faults(numbers: Numbers) -> Any:
    """Draw all faults of the suites of rigs, one panel a suite."""
    panels: dict[str, list[Dots]] = {}
    for suite, name, found in _faults(numbers):
        dots = name, {method: fmean(values) for method, values in found.items()}
        panels.setdefault(suite, []).append(dots)
    return _panels(panels, 4.8)


def _draw_pixels(numbers: Numbers) -> Any:
    """Draw kinds of pixels, one panel for each row of the suite of surfaces with several kinds."""
    panels = {}
    for row, shares in numbers.get("surfaces", {}).items():
        if row in _SURFACES:
            kinds = dict.fromkeys(kind for found in shares.values() for kind in found)
            panels[row] = [(k, {m: v[k] for m, v in shares.items() if k in v}) for k in kinds]
    return _panels(panels, 3.8)


def _panels(panels: Mapping[str, Sequence[Dots]], width: float) -> Any:
    """Draw a row of marks for each name, in panels by title; None without any."""
    if not panels:
        return None

    figure = figure_of(width * len(panels), 1.3 + 0.19 * max(map(len, panels.values())))
    drawn = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, (name, rows) in zip(drawn, panels.items(), strict=True):
        for line, (_, values) in enumerate(rows):
            for method in [method for method in _SHOWN if method in values]:
                title, color, mark = _LOOKS[method]
                axes.plot(values[method], line, mark, color=color, markersize=6, label=title)

        rule(axes, [label for label, _ in rows])
        axes.set_xlim(left=0)
        axes.set_xlabel(_OFF, color=SOFT)
        axes.set_title(name, loc="left", color=INK, size=11)

    handles, labels = drawn[-1].get_legend_handles_labels()
    legend = dict(zip(labels, handles, strict=True))
    figure.legend(
        legend.values(), legend, loc="outside lower center", ncols=len(legend), frameon=False
    )
    return figure


def _faults(numbers: Numbers) -> Iterator[tuple[str, str, Mapping[str, list[float]]]]:
    """Yield suite, name and values by method for every fault with numbers."""
    for suite in RIGS:
        for name in numbers["suites"].get(suite, {}).get("bad_1", {}):
            if name in RIGS[suite] and name != "sharp":
                yield suite, name, _means(numbers, suite, name)


def _means(numbers: Numbers, suite: str, row: str) -> dict[str, list[float]]:
    """Return the values of the scenes by method, for methods that have all of them."""
    found = numbers["suites"].get(suite, {}).get("bad_1", {}).get(row, {})
    return {method: values for method, values in found.items() if None not in values}


def _costs(numbers: Numbers) -> list[Mapping[str, Any]]:
    """Return the costs on the latest processor; costs of other processors are not comparable."""
    cpus = {each["id"]: each["cpu"] for each in numbers["environments"]}
    costs = [(cost, cpus[cost["environment"]]) for cost in numbers["costs"]]
    return [cost for cost, cpu in costs if cpu == costs[-1][1]]

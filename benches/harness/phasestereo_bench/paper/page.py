"""The page about the experiments, as sections of blocks that any format can show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from phasestereo_bench.paper.cells import SCENES
from phasestereo_bench.paper.claims import FLAT, GAIN, WAYS, case_of, cases, flatness
from phasestereo_bench.paper.experiments import EXPERIMENTS, MAPS_LEVEL, MOTION_Y, SMALLEST
from phasestereo_bench.paper.methods import METHODS
from phasestereo_bench.paper.prototype import TOLERANCE
from phasestereo_bench.paper.study import levels_of
from phasestereo_bench.paper.tables import (
    bits_table,
    cases_table,
    choices_table,
    claims_table,
    in_figure_2,
    prototype_table,
)
from phasestereo_bench.paper.wording import claims, shortfalls

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from phasestereo_bench.paper.study import Study
    from phasestereo_bench.report.tables import Table

__all__ = ["Item", "Picture", "Section", "sections"]


class Item(NamedTuple):
    """An item of a list: what it is about, and text."""

    lead: str
    text: str


class Picture(NamedTuple):
    """A file of the page's folder, and its caption."""

    file: str
    caption: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A part of a page; what is empty is left out, and the order is that of the fields."""

    title: str
    level: int = 2
    text: Sequence[str] = ()
    items: Sequence[Item] = ()
    table: Table | None = None
    after: Sequence[Item] = ()
    pictures: Sequence[Picture] = ()
    code: str = ""
    closing: Sequence[str] = ()


def sections(study: Study, environments: Sequence[Mapping[str, Any]]) -> list[Section]:
    """Return the page.

    Parameters
    ----------
    study
        What was measured.
    environments
        With what, lines of the store.
    """
    return [
        *_claims(study),
        *_figures(),
        *_cases(study),
        _bits(study),
        _prototype(study),
        _recipe(study),
        _settings(study),
        _again(environments),
    ]


def _claims(study: Study) -> list[Section]:
    found = claims(study.readings)
    parts = [
        Section(
            title="The claims",
            text=[
                "A claim is reproduced if it holds at all levels of blur, or for all lines of "
                f"Figure 3; for that of {GAIN:g} points “in many cases”, half of the larger blurs "
                "are enough. It is reproduced in part if it holds at two thirds as many. The "
                "larger blurs are the levels in the upper half of an experiment's range; levels "
                "without any blur do not count."
            ],
            table=claims_table(found),
        )
    ]
    for claim in found:
        items = [
            Item(f"{finding.way}: {finding.verdict.value}", f"{finding.text}.")
            for finding in claim.findings
        ]
        parts.append(Section(title=f"“{claim.quote}”", level=3, items=items))
    return parts


def _figures() -> list[Section]:
    tied = "Window and L tied to the size of the blur, as in the paper"
    fixed = "Window, L and penalty as they are best on the sharp pair, at all levels"
    return [
        Section(
            title="Figure 2: error against blur",
            text=[
                "Bad pixels are those more than 1 pixel off, of those that both images see. All "
                "methods share the shiftable windows and the dynamic programming; they differ in "
                "what they compare two pixels by."
            ],
            pictures=[Picture("figure2_tied.svg", tied), Picture("figure2_fixed.svg", fixed)],
        ),
        Section(
            title="Figure 3: error against the bits of the phase",
            pictures=[Picture("figure3_tied.svg", tied), Picture("figure3_fixed.svg", fixed)],
        ),
        Section(
            title=f"Figure 5: disparity maps of the third experiment at blur factor {MAPS_LEVEL:g}",
            text=["Far is blue, near is red, gray is unknown."],
            pictures=[Picture("figure5_tied.png", tied), Picture("figure5_fixed.png", fixed)],
        ),
    ]


def _cases(study: Study) -> list[Section]:
    """Return a section for each way to set the methods up: gains, and reasons where they lack."""
    parts = [
        Section(
            title="Case by case",
            text=[
                "Gains are percentage points of bad pixels by which phase codes are better than "
                "what the paper compares them with: SAD, and normalised SAD where the contrast "
                "changes. Below each table is where a claim does not hold (phase codes lose, or "
                f"gain less than {GAIN:g} points at the larger blurs), with the likely reason."
            ],
        )
    ]
    for way in WAYS:
        found = cases(study.readings, way)
        after = [
            Item(f"{shortfall.name}, {levels}", f"{reason}.")
            for shortfall in shortfalls(study.readings, found)
            for levels, reason in shortfall.reasons
        ]
        title = f"{way.name[0].upper()}{way.name[1:]}"
        parts.append(Section(title=title, level=3, table=cases_table(found), after=after))
    return parts


def _bits(study: Study) -> Section:
    text = (
        "Bad pixels in percent by the bits b of the phase, under Gaussian blur. “Fairly constant” "
        f"is taken to mean that they spread over no more than {FLAT:g} points. The penalty doubles "
        "with every bit, as the distances between codes do."
    )
    return Section(
        title="Figure 3 in numbers", text=[text], table=bits_table(flatness(study.readings))
    )


def _prototype(study: Study) -> Section:
    differences = [abs(each.measured - each.figure.published) for each in study.prototype]
    beside = [(in_figure_2(each.figure, study.readings), each) for each in study.prototype]
    apart = [abs(value - each.figure.published) for value, each in beside if value is not None]
    text = [
        "An earlier prototype, in NumPy, left figures of some of these cells, but not all of its "
        "settings: penalties, some windows, and the very shape of the motion and the disk. Those "
        "used here were found by trying which give its figures again, so that this comparison "
        f"tells that they can be had, not that they must be. With them {_within(differences)}.",
        "Two columns more tell what such figures hang on. “In Figure 2, tied”: the same rules for "
        "window and L, but the penalty that the method chose on the sharp pair, so that nothing is "
        "fitted to the prototype's figures but the shape of the motion and the disk: "
        f"{_within(apart)}. “By the suite's recipe”: the settings of "
        "the prototype on images degraded as the one-sided-blur suite does, where a motion of n is "
        "a path of n - 1 pixels, from the centre of the first to that of the last, a disk has the "
        "radius (n - 1) / 2, and noise of 1 gray level is added. The shorter path and the smaller "
        "disk are easier; the noise is harder on phase codes where a Gaussian leaves little.",
        "With motion along y the prototype saw SAD ahead from n = 15 on, and noted no more. Here, "
        f"by L = 2n + 1, SAD is ahead {_ahead_along_y(study)}.",
    ]
    return Section(title="Beside the prototype's figures", text=text, table=prototype_table(study))


def _within(differences: Sequence[float]) -> str:
    """Say how many differences are small, and the largest."""
    close = sum(difference <= TOLERANCE for difference in differences)
    return (
        f"{close} of {len(differences)} figures are within {TOLERANCE:g} points, and the largest "
        f"difference is {max(differences):.1f}"
    )


def _ahead_along_y(study: Study) -> str:
    """Say from which length of a motion along y on phase codes lose."""
    told = []
    for scene in SCENES:
        gains = case_of(study.readings, MOTION_Y, scene, WAYS[0]).gains
        won = max((level for level, gain in gains.items() if gain > 0), default=0)
        behind = [level for level in gains if level > won]
        told.append(f"on {scene.title()} {f'from n = {behind[0]:g}' if behind else 'nowhere'}")
    return " and ".join(told)


def _recipe(study: Study) -> Section:
    levels = [
        Item(
            f"Experiment {each.number}, {each.title}",
            f"{each.symbol} = {_listed(levels_of(each, quick=study.quick))}; descriptor k = "
            f"{each.power}, b = 2, r = 2, s = 1.",
        )
        for each in EXPERIMENTS
    ]
    return Section(
        title="What was done to the images",
        text=[
            "The left image is degraded, the right one left as it is. Degradations act on every "
            "channel in floating point, borders being continued by reflection, then round to 8 "
            "bits. No noise is added.",
        ],
        items=[
            *levels,
            Item("Motion of n", "a box of exactly n pixels, whose transform is first zero at 1/n."),
            Item("Gaussian", "cut at 4 sigma."),
            Item(
                "Third experiment",
                "the image in 4 x 4 equal areas, area (i, j) showing version (i + j) mod 4 of: "
                "0.6 I + 20; motion of n along x; I; a disk of diameter n.",
            ),
        ],
    )


def _settings(study: Study) -> Section:
    grid = study.grid
    penalties = "; ".join(
        f"{method.name} {_listed(method.penalties)} {method.unit}" for method in METHODS
    )
    return Section(
        title="Settings, and how they were chosen",
        text=[
            "No method has seen a blurred pair before: all choices were made on the sharp one, for "
            "each pair and method by itself, and hold at all levels."
        ],
        items=[
            Item(
                "Fixed by the sharp pair",
                f"the best of all combinations of windows of {_listed(grid.windows)} pixels, "
                f"penalties ({penalties}) and, for phase codes, L of "
                f"{_listed(grid.neighborhoods)} pixels.",
            ),
            Item(
                "Tied to the blur",
                "the window has the size of the blur, n or 4 sigma + 1 pixels, and L that of its "
                f"rule, but both {SMALLEST} at least and rounded up to odd numbers. The penalty is "
                f"the best of the same ones on the sharp pair with window and L of {SMALLEST}.",
            ),
            Item(
                "The rules for L",
                "the paper asks for twice the size of the blur or more (equation 9). For a motion "
                "of n pixels, L = 2n + 1 puts the highest frequency of the codes, 2 / L, just "
                "below the first zero of the motion's transform, 1 / n; L = 3n puts it at two "
                "thirds of that. A Gaussian's transform has no zeros; L = 4 sigma + 1 holds two "
                "standard deviations to either side.",
            ),
            Item(
                "The same for all",
                "the best of five windows, costs averaged over them, and dynamic programming along "
                "rows under the ordering constraint, with one penalty for any change of disparity; "
                "integer disparities, 0 to 63 on Cones and 0 to 15 on Tsukuba.",
            ),
            Item(
                "Normalised SAD",
                "every channel less its mean, over its standard deviation, in the window around "
                "the pixel.",
            ),
        ],
        table=choices_table(study),
    )


def _again(environments: Sequence[Mapping[str, Any]]) -> Section:
    return Section(
        title="Again",
        text=[
            "Beside this page are results.jsonl (every cell that was measured), experiment1.csv to "
            "experiment3.csv, figure3.csv, claims.csv, prototype.csv, settings.csv, the figures as "
            "PNG and SVG, and the disparity maps of Figure 5 as PFM in figure5_maps. All of it "
            "comes from one command:"
        ],
        code="phasestereo bench paper FOLDER",
        closing=[
            *map(_made_with, environments),
            "The paper: M. Pedone, J. Heikkilä, Blur and Contrast Invariant Fast Stereo Matching, "
            "ACIVS 2008, LNCS 5259, p. 883-890. The pairs: Middlebury stereo datasets (Scharstein "
            "& Szeliski 2002 and 2003), Tsukuba by the University of Tsukuba.",
        ],
    )


def _made_with(environment: Mapping[str, Any]) -> str:
    versions = environment["versions"].items()
    used = ", ".join(f"{name} {version}" for name, version in versions if version)
    commit = f", commit {environment['commit']}" if environment["commit"] else ""
    return f"Measured on {environment['date']} on {environment['cpu']} with {used}{commit}."


def _listed(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)

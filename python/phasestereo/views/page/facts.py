"""The words and numbers on the page."""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo import _core
from phasestereo._images import Map
from phasestereo.metrics import Score
from phasestereo.metrics.scores import unit_of
from phasestereo.result import Result
from phasestereo.rig.blur import Blur, BlurEstimate
from phasestereo.settings import PRESETS, Settings
from phasestereo.views.page.embedding import picture_uri

_NAMES = {"avgerr": "mean error (avgerr, EPE)"}
_BINS = 120
_TENTHS = 10
_THRESHOLDS = np.geomspace(0.05, 32.0, 80)
_ALIKE = "#8c8c8c"
_AREAS = ("#e69f00", "#56b4e9", "#009e73", "#cc79a7", "#d55e00", "#0072b2", "#f0e442")
_CHARTS = {
    "disparities": ("Disparities", "Histogram of the disparities"),
    "errors": ("Errors", "Share of the pixels that are off by more than so much"),
    "reliability": ("Is the confidence right?", "Share of right disparities by confidence"),
    "confidences": ("Confidences", "Histogram of the confidences"),
}
_KINDS = {
    "gaussian": "Gaussian of standard deviation {size:.2f} px",
    "disk": "out of focus, a disk of radius {size:.2f} px",
    "annulus": "out of focus, an annulus of outer radius {size:.2f} px",
    "motion": "motion by {size:.1f} px at {angle:.0f}\N{DEGREE SIGN}",
    "other": "of another shape, root mean square radius {size:.2f} px",
}


@dataclass(frozen=True, slots=True)
class Area:
    """A kind of relative blur, its share of the image, and its display."""

    words: str
    share: float
    color: str
    psf: str | None


@dataclass(frozen=True, slots=True)
class BlurFacts:
    """The diagnosis of the blur: a sentence, its areas, a map of them, and figures."""

    verdict: str
    areas: list[Area]
    map: str
    figures: list[tuple[str, str]]


def blur_facts(blur: BlurEstimate, size: tuple[int, int]) -> BlurFacts:
    """Describe the estimated blur of a pair of images of this size."""
    areas = [
        Area(_words(kind), share, _color(kind, number), _psf_uri(kind))
        for number, (kind, share) in enumerate(zip(blur.blurs, blur.areas(), strict=True))
    ]

    figures = [
        ("certainty", f"{blur.certainty:.2f} of 1"),
        ("contrast, left / right", f"{blur.contrast:.2f}"),
        ("noise, left", f"{blur.noise[0]:.3g}"),
        ("noise, right", f"{blur.noise[1]:.3g}"),
    ]
    return BlurFacts(_verdict(blur), areas, _map_uri(blur, areas, size), figures)


def _color(kind: Blur, number: int) -> str:
    return _ALIKE if kind.side == "none" else _AREAS[number % len(_AREAS)]


def _verdict(blur: BlurEstimate) -> str:
    sides = {kind.side for kind in blur.blurs}
    if sides == {"none"}:
        return "No relative blur: neither image is softer than the other."

    if any(kind.other for kind in blur.blurs):
        return "Relative blur: each image has a blur that the other one does not have."

    softer = sorted(sides - {"none"})
    which = f"the {softer[0]} image is" if len(softer) == 1 else "now one image, now the other is"
    where = "" if len(blur.blurs) == 1 else ", not everywhere alike"
    return f"Relative blur: {which} softer than the other{where}."


def _words(kind: Blur) -> str:
    if kind.side == "none":
        return "no relative blur"

    own = f"{kind.side} image: {_KINDS[kind.kind].format(size=kind.size, angle=kind.angle)}"
    return own if kind.other is None else f"{own}; {_words(kind.other)}"


def _psf_uri(kind: Blur) -> str | None:
    """Draw a point-spread function, dark on light."""
    if kind.psf is None:
        return None
    share = np.clip(kind.psf / max(float(kind.psf.max()), 1e-12), 0, 1)
    return picture_uri(np.round(255 * (1 - share)).astype(np.uint8))


def _map_uri(blur: BlurEstimate, areas: list[Area], size: tuple[int, int]) -> str:
    """Draw every pixel in the color of its tile's area."""
    table = np.array([[int(a.color[i : i + 2], 16) for i in (1, 3, 5)] for a in areas], np.uint8)
    return picture_uri(table[blur.label_map(size)])


def metric_rows(score: Score) -> list[tuple[str, str]]:
    """Return metrics by name in readable form, NaN as a dash; avgerr and EPE are one number."""
    numbers = score.as_dict()
    pixels = numbers.pop("pixels")
    del numbers["EPE"]  # for the whole range; equals avgerr where nothing is clipped
    words = {
        _NAMES.get(name, name): (
            f"{value:.2f} {unit_of(name)}" if math.isfinite(value) else "\N{EN DASH}"
        )
        for name, value in numbers.items()
    }
    return [("pixels scored", f"{pixels:,.0f}"), *words.items()]


def setting_rows(settings: Settings) -> list[tuple[str, str]]:
    """Return all settings in Python syntax."""
    return [(name, repr(value)) for name, value in asdict(settings).items()]


def preset_of(settings: Settings) -> str | None:
    """Return the name of the preset with these settings, if one matches."""
    return next((name for name, preset in PRESETS.items() if preset == settings), None)


def timing_rows(timings: Mapping[str, float]) -> list[tuple[str, str, float]]:
    """Return stages, their times in words, and their share of the whole in percent."""
    total = sum(timings.values())
    return [
        (
            stage,
            f"{1e3 * seconds:.1f} ms" if seconds < 1 else f"{seconds:.2f} s",
            100 * seconds / total if total > 0 else 0.0,
        )
        for stage, seconds in timings.items()
    ]


def versions() -> list[tuple[str, str]]:
    """Return the settings and versions of the result."""
    return [
        ("phasestereo", _core.__version__),
        ("NumPy", np.__version__),
        ("Python", platform.python_version()),
        ("system", f"{platform.system()} {platform.machine()}"),
    ]


def scored_pixels(truth: Map, mask: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
    """Return the mask of the pixels that metrics count."""
    known = np.isfinite(truth)
    return known if mask is None else known & mask


def charts(
    result: Result, truth: Map | None, scored: NDArray[np.bool_] | None
) -> dict[str, dict[str, Any]]:
    """Return the numbers of the charts: the spread of disparities, errors and confidences."""
    found = {}
    if np.isfinite(result.disparity).any():
        found["disparities"] = _histogram(result.disparity, truth)

    if truth is not None and scored is not None and scored.any():
        error = np.abs(result.disparity[scored].astype(np.float64) - truth[scored])
        # Sorted errors give the share at every threshold; a missing estimate is never good.
        present = np.sort(error[np.isfinite(error)])
        good = np.searchsorted(present, _THRESHOLDS, side="right")
        wrong = 100 * (1 - good / error.size)
        found["errors"] = {"thresholds": _THRESHOLDS.tolist(), "wrong": wrong.tolist()}
        if result.confidence is not None:
            found["reliability"] = _reliability(result.confidence[scored], error)
    elif result.confidence is not None:
        counts, edges = np.histogram(result.confidence, _TENTHS * 5, (0.0, 1.0))
        share = 100 * counts / result.confidence.size
        found["confidences"] = {"edges": edges.tolist(), "shares": share.tolist()}

    return found


def _histogram(disparity: Map, truth: Map | None) -> dict[str, Any]:
    known = disparity[np.isfinite(disparity)]
    wanted = known[:0] if truth is None else truth[np.isfinite(truth)]

    either = np.concatenate([known, wanted])
    low, high = float(either.min()), float(either.max())
    edges = np.linspace(low, high if high > low else low + 1.0, _BINS + 1)

    found: dict[str, Any] = {"edges": edges.tolist()}
    for name, values in (("found", known), ("wanted", wanted)):
        if values.size:
            found[name] = (100 * np.histogram(values, edges)[0] / disparity.size).tolist()
    return found


def _reliability(
    confidence: Map, error: NDArray[np.float64]
) -> dict[str, list[float | int | None]]:
    """Return the share of right pixels among those of each tenth of the confidences."""
    tenth = np.minimum(confidence * _TENTHS, _TENTHS - 1).astype(np.intp)
    counts = np.bincount(tenth, minlength=_TENTHS)
    right = np.bincount(tenth[error <= 1.0], minlength=_TENTHS)
    shares = [r / n if n else None for r, n in zip(right.tolist(), counts.tolist(), strict=True)]

    return {
        "middles": ((np.arange(_TENTHS) + 0.5) / _TENTHS).tolist(),
        "right": shares,
        "pixels": counts.tolist(),
    }


def chart_titles(shown: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return the key, the title and the description of each chart."""
    return [(key, *_CHARTS[key]) for key in shown]


def readout(
    result: Result, truth: Map | None, *, exact: bool, metric: bool, gray: tuple[bool, bool]
) -> list[tuple[str, str]]:
    """Return the key and the name of each value to show for a pixel."""
    left, right = ("gray" if one else "RGB" for one in gray)
    rows = [
        ("pixel", "Pixel", True),
        ("disparity", "Disparity d", True),
        ("match", "Right x = x \N{MINUS SIGN} d", True),
        ("confidence", "Confidence", result.confidence is not None),
        ("uncertainty", "Error bar", result.uncertainty is not None),
        ("flags", "Flags", True),
        ("truth", "Truth", truth is not None),
        ("error", "d \N{MINUS SIGN} truth", truth is not None),
        ("depth", "Depth", metric),
        ("left", f"Left {left}", exact),
        ("right", f"Right {right}", exact),
    ]
    return [(key, name) for key, name, is_shown in rows if is_shown]

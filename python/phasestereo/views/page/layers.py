"""Layers to view pixel by pixel: each with its colors, its scale and its values."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo._images import Map
from phasestereo.result import MAPS, Flag, Result, count_flags
from phasestereo.views.page.embedding import Coding, coding_of, packed
from phasestereo.views.picture import (
    CONFIDENCE_COLORS,
    DISPARITY_COLORS,
    ERROR_COLORS,
    GOOD,
    UNCERTAINTY_COLORS,
    limits,
    longest,
)

_WORST = 4.0  # error in pixels at and above which the color is the darkest

# Colors that people with any color vision can distinguish (after Okabe and Ito), and the text.
FLAGS = {
    Flag.MASKED: ("#5a5a5a", "the left pixel is masked"),
    Flag.NO_CANDIDATE: ("#2b2b2b", "nothing valid to compare it with"),
    Flag.OUTSIDE: ("#0072b2", "the match lies outside the right image"),
    Flag.MATCH_MASKED: ("#56b4e9", "the match lies on a masked pixel"),
    Flag.OCCLUDED: ("#e69f00", "most likely the right image does not see it"),
    Flag.MISMATCHED: ("#d55e00", "the match belongs to another pixel"),
    Flag.LOW_CONFIDENCE: ("#cc79a7", "the confidence is below the limit"),
    Flag.SPECKLE: ("#009e73", "part of a small region that stands out"),
    Flag.AMBIGUOUS: ("#8250df", "another disparity fits nearly as well"),
    Flag.COARSE: ("#a0a0a0", "a smaller copy of the pair is more likely to be right there"),
    Flag.INFERRED: ("#7f4f24", "a flat area that shows nothing to match: a plane"),
    Flag.SECOND: ("#2a9d8f", "the map of a second matcher is more likely to be right there"),
    Flag.FILLED: ("#f0e442", "it has the disparity of the background beside"),
}


@dataclass(frozen=True, slots=True)
class Layer:
    """A map of numbers to look at.

    Parameters
    ----------
    key
        Its name in the page.
    label
        Its name for readers.
    unit
        Of its values; "" if they have none.
    low, high
        Values at the ends of the colors; beyond them the colors stay.
    lookup
        256 RGB colors from low to high, 3 bytes each, by base64.
    places
        Decimal places of its values.
    hint
        The meaning of the colors.
    missing
        The meaning of gray pixels.
    """

    key: str
    label: str
    unit: str
    low: float
    high: float
    lookup: str
    places: int
    hint: str
    missing: str


@dataclass(frozen=True, slots=True)
class FlagKind:
    """A flag: its bit, its name, its number of pixels, and its display."""

    bit: int
    name: str
    pixels: int
    share: float
    color: str
    meaning: str


def layers_of(result: Result, truth: Map | None) -> list[Layer]:
    """Return the layers of numbers that a result has, in the order of their buttons."""
    # Both maps have the same ends, so that their colors compare.
    ends = _robust_ends(result.disparity if truth is None else truth, result.disparity)
    near = "near is red, far is blue"
    depth = colors(DISPARITY_COLORS)
    found = [Layer("disparity", "Disparity", "px", *ends, depth, 2, near, "no estimate")]

    if result.confidence is not None:
        sure = "about the probability that the disparity is within 1 px"
        lookup = colors(CONFIDENCE_COLORS)
        found.append(Layer("confidence", "Confidence", "", 0, 1, lookup, 2, sure, "no estimate"))

    if result.uncertainty is not None:
        bar = "the true disparity is within so much, with a probability of 90 %"
        lookup, end = colors(UNCERTAINTY_COLORS), longest(result.uncertainty)
        found.append(
            Layer("uncertainty", "Error bars", "px", 0, end, lookup, 2, bar, "no estimate")
        )

    if truth is not None:
        wrong = f"|disparity - truth|: up to {GOOD:g} px is white"
        lookup = colors(ERROR_COLORS, white=GOOD / _WORST)
        found.append(Layer("error", "Error", "px", 0, _WORST, lookup, 2, wrong, "not scored"))
        found.append(Layer("truth", "Truth", "px", *ends, depth, 2, near, "unknown"))
    return found


def flag_kinds(flags: NDArray[np.uint16]) -> list[FlagKind]:
    """Return every flag of any pixel, reasons before the fillings they led to."""
    counts = count_flags(flags)
    return [
        FlagKind(flag.value, flag.words, counts[flag], counts[flag] / flags.size, color, meaning)
        for flag, (color, meaning) in FLAGS.items()
        if counts[flag]
    ]


def colors(name: str, *, white: float = 0.0) -> str:
    """Return 256 colors of a map of matplotlib; a first share may be white."""
    lookup = require("matplotlib", extra="report").colormaps[name]
    table = lookup(np.arange(256), bytes=True)[:, :3].copy()
    table[: round(white * 255) + 1 if white else 0] = 255
    return base64.b64encode(table.tobytes()).decode()


def views(layers: list[Layer]) -> list[tuple[str, str]]:
    """Return the keys and labels of all views, in the order of their buttons."""
    maps = [(layer.key, layer.label) for layer in layers]
    pair = [("left", "Left image"), ("right", "Right image")]
    place = sum(key in MAPS for key, _ in maps)  # flags come after the maps of a result
    return [*pair, *maps[:place], ("flags", "Flags"), *maps[place:]]


def arrays_of(
    result: Result,
    truth: Map | None,
    scored: NDArray[np.bool_] | None,
    step: int,
    codings: Mapping[str, Coding],
) -> dict[str, str]:
    """Encode the page's layers, every step-th pixel of every step-th row, as text."""
    coded = {"disparity": result.disparity, "uncertainty": result.uncertainty, "truth": truth}
    thin = (slice(None, None, step), slice(None, None, step))
    found: dict[str, NDArray[Any] | None] = {
        **{
            name: None if values is None else codings[name].encode(values)
            for name, values in coded.items()
        },
        "flags": result.flags,
        "confidence": None
        if result.confidence is None
        else np.rint(255 * result.confidence).astype(np.uint8),
        "scored": None if scored is None else scored.astype(np.uint8),
    }

    return {name: packed(array[thin]) for name, array in found.items() if array is not None}


def codings_of(result: Result, truth: Map | None) -> dict[str, Coding]:
    """Return the coding of the float maps, the same for disparities and their truth."""
    disparities = coding_of(result.disparity, truth)
    return {
        "disparity": disparities,
        "truth": disparities,
        "uncertainty": coding_of(result.uncertainty),
    }


def _robust_ends(*maps: Map) -> tuple[float, float]:
    """Return the ends of the colors from the first map with any value."""
    for values in maps:
        known = values[np.isfinite(values)]
        if known.size:
            low, high = limits(known)
            return (low, high) if high > low else (low - 0.5, low + 0.5)
    return 0.0, 1.0

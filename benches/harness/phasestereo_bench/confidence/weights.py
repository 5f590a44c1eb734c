"""The learned weights, as the core has them: a file of Rust."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from phasestereo.io.drafts import replacing
from phasestereo_bench.confidence.learning import Weights, learn, observed_of
from phasestereo_bench.confidence.observation import PRESETS
from phasestereo_bench.confidence.regression import Numbers

_FILE = """//! Learned by `phasestereo bench confidence`, which writes this file.

use super::Weights;

/// The weights by what chose the disparities: four paths, two, or pixels and rows by themselves.
pub const WEIGHTS: [Weights; 3] = [
{weights}];
"""
_WEIGHTS = """    Weights {{
        odds: [
{odds}        ],
        knots: [
{knots}        ],
        bars: {bars},
    }},
"""


def learned_weights(records: Sequence[Mapping[str, Any]]) -> list[Weights]:
    """Return the weights that fit the records best, those of each preset.

    Raises
    ------
    ValueError
        If none of the matches of a preset can be scored.
    """
    found = []
    for preset in PRESETS:
        pairs = observed_of([record for record in records if record["preset"] == preset])
        if not pairs:
            raise ValueError(f"records: got no match with a pixel that can be scored by {preset}")
        found.append(learn(pairs))
    return found


def write_weights(weights: Sequence[Weights], path: Path) -> None:
    """Write weights as the core has them.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    several = [
        _WEIGHTS.format(
            odds="".join(f"            {_listed(row)},\n" for row in one.odds),
            knots="".join(f"            {_listed(row)},\n" for row in one.knots),
            bars=_listed(one.bars),
        )
        for one in weights
    ]
    text = _FILE.format(weights="".join(several))
    with replacing(path) as file:
        file.write(text.encode())


def _listed(numbers: Numbers) -> str:
    return "[" + ", ".join(repr(round(float(number), 4) + 0.0) for number in numbers) + "]"

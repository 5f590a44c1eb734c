"""The learned weights, as the core has them: a file of Rust."""

from __future__ import annotations

from typing import TYPE_CHECKING

from phasestereo.io.files import replacing
from phasestereo_bench.confidence.learning import learn, observed_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path
    from typing import Any

    from phasestereo_bench.confidence.learning import Numbers, Weights

_FILE = """//! Learned by `phasestereo bench confidence`, which writes this file.

use super::Weights;

/// The weights that calibrate all confidences.
pub const WEIGHTS: Weights = Weights {{
    odds: [
{odds}    ],
    knots: [
{knots}    ],
    bars: {bars},
}};
"""


def learned_weights(records: Sequence[Mapping[str, Any]]) -> Weights:
    """Return the weights that fit the records best.

    Raises
    ------
    ValueError
        If none of the matches can be scored.
    """
    pairs = observed_of(records)
    if not pairs:
        raise ValueError("records: got no match with a pixel that can be scored")
    return learn(pairs)


def write_weights(weights: Weights, path: Path) -> None:
    """Write weights as the core has them.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    text = _FILE.format(
        odds="".join(f"        {_listed(row)},\n" for row in weights.odds),
        knots="".join(f"        {_listed(row)},\n" for row in weights.knots),
        bars=_listed(weights.bars),
    )
    with replacing(path) as file:
        file.write(text.encode())


def _listed(numbers: Numbers) -> str:
    return "[" + ", ".join(repr(round(float(number), 4) + 0.0) for number in numbers) + "]"

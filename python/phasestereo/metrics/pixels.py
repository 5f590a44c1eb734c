"""Common code of all scores of disparity maps: the scored pixels, and refusals."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from phasestereo._images import as_numbers

Floats = npt.NDArray[np.floating]
Values = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


def scored_values(estimate: Floats, truth: Floats, mask: Mask | None) -> tuple[Values, Values]:
    """Return estimate and truth of the scored pixels, 1-D float64; a missing estimate is NaN."""
    scored = scored_pixels(estimate, truth, mask)
    values = np.asarray(estimate)[scored].astype(np.float64)
    values[~np.isfinite(values)] = np.nan
    return values, np.asarray(truth)[scored].astype(np.float64)


def scored_pixels(estimate: Floats, truth: Floats, mask: Mask | None) -> Mask:
    """Return the mask of scored pixels of a checked estimate, truth and mask: at least one."""
    size = as_numbers(estimate, "estimate", "f").shape
    known = np.isfinite(as_numbers(truth, "truth", "f", size))
    scored: Mask = known if mask is None else known & as_numbers(mask, "mask", "b", size)

    if not scored.any():
        raise ValueError(
            f"nothing is left to score: of {known.size} pixels {np.count_nonzero(known)} have a "
            f"known truth, and the mask holds none of them"
        )

    return scored

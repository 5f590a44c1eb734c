"""How well a confidence separates right from wrong disparities.

This module computes numbers and curves from a confidence, an estimate, a truth and a mask.
Conventions are those of `phasestereo.metrics`: a pixel is scored where the mask is True and the
truth finite, and it is *wrong* where the estimate is off by more than a threshold, or missing. Only
the order of confidences matters, not their scale, so that any two measures can be compared; it must
be known (finite, or infinite) at every scored pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from phasestereo._images import as_numbers
from phasestereo._numbers import as_number
from phasestereo.metrics.pixels import (
    Floats,
    Mask,
    Values,
    scored_pixels,
    scored_values,
)

Indices = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Sparsification:
    """The share of wrong pixels among the most confident ones.

    Attributes
    ----------
    density
        Share of the scored pixels that is kept, from above 0 to 1; shape (N,), rising. It has one
        entry per distinct confidence: pixels of equal confidence are kept or dropped together.
    bad
        Percentage of wrong pixels among these; shape (N,).
    area
        Mean of `bad` over all densities, in percent, with pixels of equal confidence in random
        order; smaller is better.
    least
        The area of a confidence that ranks every right pixel before every wrong one: the minimum.
    """

    density: Values
    bad: Values
    area: float
    least: float


def roc_area(
    confidence: Floats,
    estimate: Floats,
    truth: Floats,
    *,
    threshold: float = 1.0,
    mask: Mask | None = None,
) -> float:
    """Return the area under the ROC curve of a confidence that separates right from wrong pixels.

    It is the probability that of a random right and a random wrong pixel, the right one has the
    higher confidence; ties count half. 1 for a perfect confidence, 0.5 for a useless one. Computed
    exactly from ranks (J. A. Hanley, B. J. McNeil: The Meaning and Use of the Area under a Receiver
    Operating Characteristic Curve, Radiology 143, 1982).

    Parameters
    ----------
    confidence
        Floats (H, W), on any scale; higher is more trusted. NaN is allowed only where no pixel is
        scored.
    estimate
        Disparities, floats (H, W), pixels; a non-finite one is missing, and wrong.
    truth
        True disparities, floats (H, W); pixels where they are not finite are not scored.
    threshold
        A pixel is wrong if its error exceeds this, in pixels; finite, at least 0.
    mask
        Bools (H, W), True = score; everywhere by default.

    Returns
    -------
    float
        From 0 to 1; NaN if all scored pixels are right, or all are wrong.

    Raises
    ------
    TypeError
        If an array or the threshold is of the wrong type.
    ValueError
        If shapes differ, a confidence is NaN, the threshold is negative or not finite, or no pixel
        is left to score.
        is left to score.
    """
    confidences, right = _judged(confidence, estimate, truth, threshold, mask)
    rights = np.count_nonzero(right)
    pairs = rights * (right.size - rights)
    if not pairs:
        return math.nan

    inverse, counts = _ties(confidences)
    # Mean ranks of ties, and their sums, are multiples of a half far below 2^52: exact.
    ranks = np.cumsum(counts) - (counts - 1) / 2
    above = ranks[inverse[right]].sum() - rights * (rights + 1) / 2

    return float(above / pairs)


def sparsification(
    confidence: Floats,
    estimate: Floats,
    truth: Floats,
    *,
    threshold: float = 1.0,
    mask: Mask | None = None,
) -> Sparsification:
    """Return the share of wrong pixels as less and less confident pixels are kept.

    X. Hu, P. Mordohai: A Quantitative Evaluation of Confidence Measures for Stereo Vision, PAMI 34
    (11), 2012, section 4. Unlike the area under the ROC curve, the area under this curve depends on
    the total share of wrong pixels.

    Parameters
    ----------
    confidence, estimate, truth, threshold, mask
        As for `roc_area`.

    Returns
    -------
    Sparsification
        The curve, its area and the least possible area.

    Raises
    ------
    TypeError, ValueError
        As `roc_area`.
    """
    confidences, right = _judged(confidence, estimate, truth, threshold, mask)
    inverse, counts = _ties(-confidences)
    wrong = np.bincount(inverse[~right], minlength=counts.size)
    kept, bad = np.cumsum(counts), np.cumsum(wrong)
    ideal = np.clip(np.arange(1, right.size + 1) - np.count_nonzero(right), 0, None)

    return Sparsification(
        density=kept / right.size,
        bad=100.0 * bad / kept,
        area=_area(np.cumsum(np.repeat(wrong / counts, counts))),
        least=_area(ideal.astype(np.float64)),
    )


def _area(wrong: Values) -> float:
    """Return the mean percentage of wrong pixels among the first one, the first two and so on."""
    return float(100.0 * np.mean(wrong / np.arange(1, wrong.size + 1)))


def _ties(values: Values) -> tuple[Indices, Indices]:
    """Return the rank of each value among the distinct ones, and their counts."""
    _, inverse, counts = np.unique(values, return_inverse=True, return_counts=True)
    return inverse, counts


def _judged(
    confidence: Floats, estimate: Floats, truth: Floats, threshold: float, mask: Mask | None
) -> tuple[Values, Mask]:
    """Return the confidences of the scored pixels, and which of these are right."""
    limit = as_number("threshold", threshold, least=0)
    scored = scored_pixels(estimate, truth, mask)

    confidences = as_numbers(confidence, "confidence", "f", scored.shape)[scored].astype(np.float64)
    unknown = np.count_nonzero(np.isnan(confidences))
    if unknown:
        raise ValueError(
            f"confidence must be known wherever a pixel is scored, got NaN at {unknown} such "
            f"pixels: a missing estimate has the least"
        )

    values, wanted = scored_values(estimate, truth, mask)
    return confidences, np.abs(values - wanted) <= limit  # False for a missing estimate

"""Shared by both calibrations: logistic odds, lines through points, and the quantile of bars."""

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float64]

KNOTS, FIRST_KNOT = 10, -4.0
"""Points of the logarithm of a bar, one for each logarithm of the odds from the first on."""
COVERED = 0.9
"""Share of the errors that a bar holds."""

_TURNS = 25
# px of a logarithm, of the first turns and later: the closer, the more exact, but the less steady.
_FIRST, _LEAST, _LATER = 8, 0.1, 0.02


def sigmoid(z: Numbers) -> Numbers:
    """Compute the probability with these logarithms of the odds."""
    return np.asarray(1 / (1 + np.exp(-z.clip(-30, 30))))


def rounded(value: float, digits: int) -> str:
    """Write a number as Rust does, zero without a sign."""
    return repr(round(float(value), digits) + 0.0)


def listed(values: Numbers, digits: int) -> str:
    """Write numbers as an array of Rust."""
    return f"[{', '.join(rounded(value, digits) for value in values)}]"


def between_knots(z: Numbers) -> Numbers:
    """Compute the shares of the points in each logarithm of the odds, (N, KNOTS): two at most."""
    place = np.clip(z - FIRST_KNOT, 0, KNOTS - 1)
    return np.maximum(1 - np.abs(place[:, None] - np.arange(KNOTS)), 0)


def quantile(
    design: Numbers, target: Numbers, weight: Numbers, smooth: Numbers, start: Numbers
) -> Numbers:
    """Fit the factors of which `COVERED` of the targets lie below, by reweighted least squares."""
    found = start
    for turn in range(_TURNS):
        off = target - design @ found
        least = _LEAST if turn < _FIRST else _LATER
        pull = weight * np.where(off > 0, COVERED, 1 - COVERED) / np.maximum(np.abs(off), least)
        curve = (design * pull[:, None]).T @ design + smooth
        found = np.asarray(np.linalg.solve(curve, design.T @ (pull * target)))
    return found

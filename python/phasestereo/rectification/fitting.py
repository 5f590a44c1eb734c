"""The camera pair that brings matches onto the same rows: robustly, since some matches are wrong.

First the matches that agree on roughly where rows are (MSAC over an affine model, whose cameras are
far away), then all numbers of the model by Gauss-Newton steps, damped, that weigh down matches
far from the others (Tukey's biweight) and numbers far from what they usually are::

    least sum(weight * (rows / spread)^2) / 6 + sum(numbers^2)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phasestereo.rectification.features import Matches, Points
from phasestereo.rectification.model import DISTORTION, SIZE, Model

_SAMPLES = 2000
_NEAR = 0.012  # of the width: rows that agree roughly, with distortion and perspective left in
_STEEP = 0.5  # rows per column or row: cameras that are no stereo pair
_STARTS = 0.0, -1.5, 1.5  # of k1: a fit may end at a distortion of the wrong sign
_STEPS = 40
_ABSOLUTE_STEPS = 5
_CUT = 4.7  # robust standard deviations: matches beyond do not count
_FLOOR = 0.05  # pixels: no match is more exact, and errors that all share are not averaged out
_ALIKE = 6.0  # matches beside each other that err alike, and count as one
_DELTA = 1e-4
_SETTLED = 1e-3  # usual deviations: a step that is small
_DAMPINGS = 8
_LIKELY = 3.0  # pixels: for a choice among fits, a match that is farther off is wrong


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A camera pair fitted to matches.

    Parameters
    ----------
    model
        The camera pair.
    weights
        Of the matches, 0 to 1; 0: it does not count.
    spread
        Robust standard deviation of their rows, pixels.
    covariance
        Of the model's numbers, (SIZE, SIZE).
    """

    model: Model
    weights: Points
    spread: float
    covariance: Points

    @property
    def agree(self) -> NDArray[np.bool_]:
        """Which matches count."""
        return self.weights > 0

    def error(self, matches: Matches) -> float:
        """Return the standard error of rows at these places, root mean square, pixels."""
        jacobian = _jacobian(self.model, matches, self.model.rows(matches))
        variances = np.einsum("ij,jk,ik->i", jacobian, self.covariance, jacobian)
        return float(np.sqrt(variances.mean()))


def consensus(matches: Matches, width: int) -> NDArray[np.bool_]:
    """Return which matches agree on an affine model of rows: ``right y = a + b x + c y + d x'``."""
    (x, y), (x_right, y_right) = (points.T / width for points in matches)
    terms = np.stack([np.ones_like(x), x_right - 0.5, y - 0.5, x - x_right], axis=1)
    values = y_right - y

    # MSAC: four matches determine a model; all samples are solved at once.
    chosen = np.random.default_rng(0).integers(0, x.size, (_SAMPLES, 4))
    samples, aims = terms[chosen], values[chosen]
    turned = samples.transpose(0, 2, 1)
    normal = turned @ samples + np.diag([1e-9, 1e-3, 1e-3, 1e-3])  # level if nothing determines it
    models = np.linalg.solve(normal, turned @ aims[..., np.newaxis])[..., 0]

    models = models[(np.abs(models[:, 1:]) < _STEEP).all(axis=1)]
    if not len(models):
        return np.zeros(x.size, np.bool_)

    off = np.abs(models @ terms.T - values) / _NEAR
    best: NDArray[np.bool_] = off[np.minimum(off, 1).sum(axis=1).argmin()] < 1
    return best


def fitted_anew(matches: Matches, size: tuple[int, int]) -> Fit:
    """Fit a camera pair of which nothing is known, from several starts."""
    fits = []
    for start in _STARTS:
        numbers = np.zeros(SIZE)
        numbers[DISTORTION] = start
        fits.append(fitted(matches, Model(numbers, size)))
    return min(fits, key=lambda fit: _unlikely(fit, matches))


def _unlikely(fit: Fit, matches: Matches) -> float:
    off = np.minimum(np.abs(fit.model.rows(matches)), _LIKELY)
    return float(np.mean(off) + (fit.model.numbers**2).sum() / len(off))


def fitted(matches: Matches, model: Model) -> Fit:
    """Fit a camera pair, beginning with one that is roughly right."""
    numbers, damping = model.numbers, 1e-3
    rows = model.rows(matches)

    for step in range(_STEPS):
        spread = float(1.4826 * np.median(np.abs(rows))) + _FLOOR
        weights = _weights(rows / spread, robust=step >= _ABSOLUTE_STEPS)
        scaled = weights / (_ALIKE * spread**2)

        jacobian = _jacobian(model, matches, rows)
        normal = jacobian.T @ (scaled[:, np.newaxis] * jacobian) + np.eye(SIZE)
        slope = jacobian.T @ (scaled * rows) + numbers
        before = scaled @ rows**2 + numbers @ numbers

        # Levenberg and Marquardt: the damping grows until a step is an improvement.
        moved = 0.0
        for _ in range(_DAMPINGS):
            change = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), slope)
            tried = Model(numbers - change, model.size)
            off = tried.rows(matches)
            if np.isfinite(off).all() and scaled @ off**2 + tried.numbers @ tried.numbers <= before:
                model, numbers, rows = tried, tried.numbers, off
                moved, damping = float(np.abs(change).max()), max(damping / 5, 1e-9)
                break
            damping *= 10

        if moved < _SETTLED and step > _ABSOLUTE_STEPS:
            break

    covariance: Points = np.linalg.inv(normal).astype(np.float64)
    return Fit(model, weights, spread, covariance)


def _weights(off: Points, *, robust: bool) -> Points:
    if robust:
        weights: Points = np.maximum(0, 1 - (off / _CUT) ** 2) ** 2
        return weights
    return 1 / np.maximum(np.abs(off), 0.5)


def _jacobian(model: Model, matches: Matches, rows: Points) -> Points:
    """Return how rows change with each number of the model, (N, SIZE)."""
    columns = [
        (Model(model.numbers + _DELTA * unit, model.size).rows(matches) - rows) / _DELTA
        for unit in np.eye(SIZE)
    ]
    return np.stack(columns, axis=1)

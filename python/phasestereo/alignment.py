"""Vertical misalignment of a pair, found from the images alone: shift, rotation, scale.

Here belongs what tells how far the rows of a pair are from corresponding to each other, and what
evens it out: a linear model of the vertical displacement, fitted to blocks that were followed from
one image into the other (`phasestereo.tracking`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from phasestereo.rough import LEAST_SIZE
from phasestereo.tracking import BLOCK, tracked

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from phasestereo.tracking import Tracks

    Plane = NDArray[np.float32]
    Floats = NDArray[np.float64]

_LEAST_BLOCKS = 24
_LARGEST_ERROR = 0.5  # pixels: beyond it, nothing is known
_STEPS = 20  # of reweighting; the first ones are those of least absolute deviations
_ABSOLUTE_STEPS = 6
_CUT = 4.0  # residuals beyond it, in robust standard deviations, do not count
_FLOOR = 0.02  # pixels: no correlation is more exact
_BIAS = 0.02  # of a pixel of the copy: error that no averaging over blocks removes


@dataclass(frozen=True, slots=True)
class Alignment:
    """How the rows of the right image lie to those of the left: what is at y there is at y + v.

    ``v = vertical + slope_x * x + slope_y * y`` with (x, y) in pixels from the image's centre, x
    midway between where the two images show a point.

    Parameters
    ----------
    vertical
        Pixels at the centre: positive where the right image shows things lower.
    slope_x
        Pixels per pixel: that of a right image rotated clockwise (as displayed) is positive.
    slope_y
        Pixels per pixel: that of a right image with a larger scale is positive.
    error
        Standard error of v, in pixels, root mean square over the image.
    blocks
        Number of blocks that agree with the model.
    size
        Rows and columns of the images.
    """

    vertical: float
    slope_x: float
    slope_y: float
    error: float
    blocks: int
    size: tuple[int, int]

    @property
    def rotation(self) -> float:
        """Rotation of the right image against the left, degrees, clockwise as displayed.

        A shear that raises one side looks just like it: their difference is horizontal, where the
        scene's depth hides it.
        """
        return float(np.rad2deg(np.arctan(self.slope_x)))

    @property
    def scale(self) -> float:
        """Height of things in the right image, as a multiple of that in the left."""
        return 1 + self.slope_y

    @property
    def rms(self) -> float:
        """Root mean square of v over the image, pixels: what a matcher suffers from."""
        half_rows, half_cols = ((size - 1) / 2 for size in self.size)
        tilts = (self.slope_x * half_cols) ** 2 + (self.slope_y * half_rows) ** 2
        return float(np.sqrt(self.vertical**2 + tilts / 3))


def measure_alignment(left: Plane, right: Plane) -> Alignment | None:
    """Measure how the rows of a pair correspond.

    Parameters
    ----------
    left, right
        Gray images, float32 (H, W), of any scale. Horizontal disparities may be anything up to
        45 % of the width, of either sign.

    Returns
    -------
    Alignment or None
        None where the images are too small, have too little texture or too little in common.
    """
    if min(left.shape) < LEAST_SIZE:
        return None
    size = left.shape[0], left.shape[1]
    fits, most = [], 0
    for tracks in tracked(left, right):
        most = max(most, tracks.x.size)
        fits.append(_fitted(tracks, most, size))
    # Small copies stand blur and noise, large ones are exact: which is best, the errors tell.
    found = [fit for fit in fits if fit is not None and fit.error < _LARGEST_ERROR]
    return min(found, key=lambda fit: fit.error, default=None)


def straightened(right: Plane, alignment: Alignment, factor: int = 1) -> Plane:
    """Return the right image with its rows where the left image has them.

    Parameters
    ----------
    right
        Float32 (H, W): the image, or a copy of it made smaller by `factor`.
    alignment
        As measured on the images of full size.
    factor
        Of the reduction.
    """
    rows, cols = right.shape
    x = factor * (np.arange(cols) + 0.5) - alignment.size[1] / 2
    y = factor * (np.arange(rows) + 0.5) - alignment.size[0] / 2
    shift = alignment.vertical + np.add.outer(alignment.slope_y * y, alignment.slope_x * x)
    place = np.clip(np.arange(rows)[:, np.newaxis] + shift / factor, 0, rows - 1)
    above = np.minimum(place.astype(np.intp), max(rows - 2, 0))
    below = np.minimum(above + 1, rows - 1)
    share = (place - above).astype(np.float32)
    upper, lower = (np.take_along_axis(right, row, axis=0) for row in (above, below))
    mixed: Plane = upper + share * (lower - upper)
    return mixed


def _fitted(tracks: Tracks, most: int, size: tuple[int, int]) -> Alignment | None:
    """Fit the model to the blocks of one copy: robustly, since depth edges lead blocks astray.

    `most` is how many blocks there were in the smaller copies. Where only few of them are found
    again, as in a blurred image, these may be there by chance: the error grows by as much.
    """
    if tracks.x.size < _LEAST_BLOCKS:
        return None
    half_rows, half_cols = size[0] / 2, size[1] / 2
    x = (tracks.x + tracks.dx / 2 + 0.5) / half_cols - 1
    y = (tracks.y + tracks.dy / 2 + 0.5) / half_rows - 1
    terms = np.stack([np.ones_like(x), x, y], axis=1)
    parameters, weights, spread = _robust_fit(terms, tracks.dy, tracks.weight)
    agree = weights > 0
    blocks = int(np.count_nonzero(agree))
    if blocks < max(_LEAST_BLOCKS, tracks.x.size // 2):
        return None
    normal = terms[agree].T @ terms[agree]
    if np.linalg.cond(normal) > 1e4:  # all of them along one line
        return None
    # Blocks that overlap do not err independently.
    overlap = max(1.0, BLOCK * tracks.factor / tracks.spacing)
    excess = np.sqrt(overlap * most / tracks.x.size)
    squares = np.array([1, 1 / 3, 1 / 3])  # means of those of the terms over the image
    error = excess * spread * np.sqrt(squares @ np.diag(np.linalg.inv(normal)))
    return Alignment(
        vertical=float(parameters[0]),
        slope_x=float(parameters[1] / half_cols),
        slope_y=float(parameters[2] / half_rows),
        error=float(np.hypot(error, _BIAS * tracks.factor)),
        blocks=blocks,
        size=size,
    )


def _robust_fit(terms: Floats, values: Floats, given: Floats) -> tuple[Floats, Floats, float]:
    """Fit by least squares, reweighted: first as absolute deviations, then with Tukey's biweight.

    Returns
    -------
    The parameters, the last weights (0: outliers), and the robust standard deviation.
    """
    weights = given
    parameters: Floats = np.zeros(terms.shape[1])
    spread = 0.0
    for step in range(_STEPS):
        root = np.sqrt(weights)
        solved = np.linalg.lstsq(terms * root[:, np.newaxis], values * root, rcond=None)[0]
        parameters = solved.astype(np.float64)
        residuals = np.abs(values - terms @ parameters)
        spread = float(1.4826 * np.median(residuals)) + _FLOOR
        if step < _ABSOLUTE_STEPS:
            weights = given / np.maximum(residuals, 0.1 * spread)
        else:
            weights = given * np.maximum(0, 1 - (residuals / (_CUT * spread)) ** 2) ** 2
    return parameters, weights, spread

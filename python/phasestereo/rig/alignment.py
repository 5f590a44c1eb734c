"""Vertical misalignment of a pair, estimated from the images: a smooth field of offsets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Alignment:
    """The vertical offset v of the right image: a point at y in the left is at y + v there.

    With X and Y from -1 to 1 over the columns of the right and the rows of the left image, and
    R2 = X^2 + Y^2,

        v = c0 + c1 X + c2 Y + c3 X Y + c4 X^2 + c5 Y^2 + c6 Y R2 + c7 X R2

    where c3 to c7, from keystone and lens distortion, are 0 unless they explain much. If rows sway
    from one to the next, as with a shaking rolling shutter, a spline of the row is added.

    Parameters
    ----------
    coefficients
        The eight factors c, in pixels.
    error
        Standard error of v, in pixels, root mean square over the image.
    blocks
        Number of blocks, found in both images, that agree with the field.
    spread
        Robust standard deviation of these blocks from the field, pixels.
    errors
        Standard error of v in the middle of each sixteenth of the height, from the top, pixels,
        root mean square over the columns.
    size
        Rows and columns of the images.
    applied
        Whether the right image was straightened by the field: resampled along its columns so that
        rows correspond. False if v is nearly 0, or the match does not improve.
    sway
        The factors of the spline of the row, pixels: 19 of a cubic B-spline with uniform knots a
        sixteenth of the height apart. Empty: rows do not sway.

    Examples
    --------
    >>> found = ps.match(left, right).alignment
    >>> found.vertical, found.rotation, found.rms  # pixels, degrees, pixels
    """

    coefficients: tuple[float, ...]
    error: float
    blocks: int
    spread: float
    errors: tuple[float, ...]
    size: tuple[int, int]
    applied: bool = False
    sway: tuple[float, ...] = ()

    @property
    def vertical(self) -> float:
        """Offset at the center, pixels: positive if things are lower in the right image."""
        return self.coefficients[0]

    @property
    def slope_x(self) -> float:
        """Pixels per pixel along x, at the center; positive: right image turned clockwise."""
        return self.coefficients[1] / (self.size[1] / 2)

    @property
    def slope_y(self) -> float:
        """Pixels per pixel along y, at the center; positive: the right image is larger."""
        return self.coefficients[2] / (self.size[0] / 2)

    @property
    def rotation(self) -> float:
        """Rotation of the right image against the left, degrees, clockwise as displayed.

        A shear that raises one side looks the same: they differ only horizontally, where the
        scene's depth hides the difference.
        """
        return float(np.rad2deg(np.arctan(self.slope_x)))

    @property
    def scale(self) -> float:
        """Height of things in the right image, as a multiple of that in the left."""
        return 1 + self.slope_y

    @property
    def rms(self) -> float:
        """Root mean square of v over the image, pixels: the offset that harms a matcher."""
        y, x = (np.arange(0, length, max(1, length // 40)) for length in self.size)
        return float(np.sqrt(np.mean(self.offsets(x[np.newaxis], y[:, np.newaxis]) ** 2)))

    @property
    def residual(self) -> float:
        """The offset left in the match, pixels rms; the error of v if straightened."""
        return self.error if self.applied else self.rms

    def offsets(self, x: NDArray[np.generic], y: NDArray[np.generic]) -> NDArray[np.float64]:
        """Return v at columns `x` of the right and rows `y` of the left image, pixels."""
        # X and Y of the model at the centers of pixels: the edges of the image are at -1 and 1.
        unit_x = (np.asarray(x, np.float64) + 0.5) / (self.size[1] / 2) - 1
        unit_y = (np.asarray(y, np.float64) + 0.5) / (self.size[0] / 2) - 1
        square = unit_x * unit_x + unit_y * unit_y

        terms = (
            np.ones_like(square),
            unit_x,
            unit_y,
            unit_x * unit_y,
            unit_x * unit_x,
            unit_y * unit_y,
            unit_y * square,
            unit_x * square,
        )
        total = np.zeros_like(square)
        for factor, term in zip(self.coefficients, terms, strict=True):
            total = total + factor * term
        return total + self._swaying((unit_y + 1) / 2)

    def _swaying(self, fraction: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the spline at fractions of the height, pixels."""
        if not self.sway:
            return np.zeros_like(fraction)

        factors, last = np.array(self.sway), len(self.sway) - 4
        place = np.clip(fraction, 0, 1) * (last + 1)
        first = np.minimum(place.astype(np.intp), last)
        u = place - first

        weights = (
            (1 - u) ** 3,
            3 * u**3 - 6 * u**2 + 4,
            3 * (1 - u) ** 3 - 6 * (1 - u) ** 2 + 4,
            u**3,
        )
        parts = (weight * factors[first + at] for at, weight in enumerate(weights))
        return np.asarray(sum(parts) / 6)

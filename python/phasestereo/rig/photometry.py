"""How the intensities of a pair compare: gain and gamma, saturation, texture.

Here belongs what gray levels say, whatever shows them: intensities as fractions of their range, the
response curve between the two images, and the shares of pixels that carry little information.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from phasestereo._images import Pixels

    Plane = NDArray[np.float32]
    Floats = NDArray[np.float64]
    Mask = NDArray[np.bool_]

_LUMA = np.array([0.299, 0.587, 0.114], dtype=np.float32)
_ENDS = 0.1, 99.9  # percentiles: the range of all but bytes, as `Settings.intensity_range` has it
_SAMPLES = 2**20  # pixels: of larger images, every so many rows

_WINDOW = 25  # pixels: a disk of radius 8 moves little light across its border
_STRIDE = 8
_USABLE = 0.005, 0.985  # of the range: pixels of the right image beyond it may be clipped
_LEAST_SHARE = 0.5  # of a window's pixels
_LEAST_WINDOWS = 12
_TOP = 0.95  # of the range: windows that reach it in the left image may be clipped
_FITTED_TOP = 0.9  # the same as the fit expects it: that does not favor windows by their noise
_ABOVE_MEAN = 1.5  # standard deviations of a window: where its brightest pixels are taken to be
_TOLERANCE = 0.004  # of the range: residual of a window without contrast
_UNEVEN = 0.1  # of a window's variance: what its pixels may be misplaced by
_GAMMAS = 0.2, 5.0
_PRIOR = 0.5  # standard deviation of gamma around 1, where windows do not determine it
_OVERLAP = 10.0  # windows that share each pixel
_ABSOLUTE_STEPS = 8
_STEPS = 30
_CUT = 4.0

_BLOCK = 8  # pixels: texture is looked for in squares of this side
_QUIET = 2.0  # times the noise: contrast that is no texture
_FLAT = 0.002  # of the range, half a gray level of 8 bits: the same, however little noise there is


@dataclass(frozen=True, slots=True)
class Saturation:
    """Shares of an image's pixels, 0 to 1, a channel of which is at an end of the values it has.

    Parameters
    ----------
    dark, bright
        At the least and at the largest value.
    """

    dark: float
    bright: float


def fractions(left: Pixels, right: Pixels) -> tuple[Plane, Plane, float]:
    """Return a pair as gray fractions of its range of intensities, and the length of that range.

    The range is 0 to 255 for bytes; for all else that in which both images lie, but for 0.1 % at
    either end. What lies beyond it is clipped.

    Parameters
    ----------
    left, right
        Pixels (H, W, C) of one type: the narrowest that holds their values.

    Raises
    ------
    ValueError
        If a pixel is NaN or infinite.
    """
    low, high = _ends(left, right)
    length = high - low if high > low else 1.0
    return _gray(left, low, length), _gray(right, low, length), length


def response(left: Plane, right: Plane, disparity: Plane) -> tuple[float, float]:
    """Fit ``left = gain * right ** gamma`` over corresponding areas.

    Means over windows are compared, so that a few pixels of error, or blur in one of the images,
    matter little; windows that may be clipped are left out, and outliers do not count.

    Parameters
    ----------
    left, right
        Gray images, float32 (H, W), as fractions of the range of intensities.
    disparity
        Rough disparities, float32 (H, W), pixels: left pixel (x, y) is right pixel (x - d, y).
        NaN = unknown.

    Returns
    -------
    gain, gamma
        (1, 1) where there is too little to compare; gamma tends to 1 where there is too little
        contrast to determine it.
    """
    every = max(1, round(left.size / _SAMPLES))  # rows of large images
    windows = _window_statistics(left[::every], right[::every], disparity[::every])

    unclipped = windows.left + _ABOVE_MEAN * windows.spread_left < _TOP
    if np.count_nonzero(unclipped) < _LEAST_WINDOWS:
        return 1.0, 1.0

    return _fit(windows, unclipped)


def saturation(image: Pixels) -> Saturation:
    """Measure how much of an image is at an end of the values that it has.

    An exposure that is too long makes many pixels equal, wherever a camera's scale then ends.

    Parameters
    ----------
    image
        Pixels (H, W, C).
    """
    low, high = image.min(), image.max()
    return Saturation(
        dark=float((image == low).any(axis=2).mean()),
        bright=float((image == high).any(axis=2).mean()),
    )


def low_texture(image: Plane, noise: float) -> float | None:
    """Return the share of an image, 0 to 1, where there is nothing but noise.

    Parameters
    ----------
    image
        Gray image, float32 (H, W), as fractions of the range of intensities.
    noise
        Standard deviation of its noise, likewise.

    Returns
    -------
    float or None
        Share of the 8x8 squares whose standard deviation is below twice the noise, or below half
        a gray level of 8 bits; None for images smaller than one of them.
    """
    rows, cols = (size // _BLOCK for size in image.shape)
    if min(rows, cols) == 0:
        return None

    blocks = image[: rows * _BLOCK, : cols * _BLOCK].reshape(rows, _BLOCK, cols, _BLOCK)
    contrast = blocks.std(axis=(1, 3), dtype=np.float64)
    return float((contrast < max(_QUIET * noise, _FLAT)).mean())


def _ends(left: Pixels, right: Pixels) -> tuple[float, float]:
    """Return the range of intensities of a pair."""
    if left.dtype == np.uint8:
        return 0.0, 255.0

    for name, image in (("left", left), ("right", right)):
        if not np.isfinite(image).all():
            raise ValueError(f"{name}: got NaN or infinite pixels; accepts finite ones")

    sample = np.concatenate([_sampled(image).ravel() for image in (left, right)])
    low, high = np.percentile(sample.astype(np.float64), _ENDS)
    return float(low), float(high)


def _sampled(image: Pixels) -> Pixels:
    return image[:: max(1, round(image.shape[0] * image.shape[1] / _SAMPLES))]


def _gray(image: Pixels, low: float, length: float) -> Plane:
    """Return an image as gray fractions of a range, clipped to it.

    Floats are brought into the range before they become float32, which may not hold them.
    """
    if image.dtype == np.uint8:
        pixels = image.astype(np.float32) / np.float32(length)
    else:
        pixels = np.clip(image / length - low / length, 0, 1).astype(np.float32)
    return pixels @ _LUMA if image.shape[2] == 3 else pixels[:, :, 0]


@dataclass(frozen=True, slots=True, eq=False)
class _WindowStatistics:
    """Means and standard deviations of corresponding windows, (N,), fractions of the range."""

    left: Floats
    right: Floats
    spread_left: Floats
    spread_right: Floats


def _window_statistics(left: Plane, right: Plane, disparity: Plane) -> _WindowStatistics:
    """Gather the statistics of all windows of which enough is known."""
    cols = left.shape[1]

    known = np.isfinite(disparity)
    match = np.arange(cols) - np.rint(np.where(known, disparity, 0)).astype(np.intp)
    known &= (match >= 0) & (match < cols)

    # Clipped pixels of the right image would bend the curve.
    there = np.take_along_axis(right, np.clip(match, 0, cols - 1), axis=1)
    known &= (there > _USABLE[0]) & (there < _USABLE[1])

    counts = _sums(known.astype(np.float64))
    enough = counts >= _LEAST_SHARE * _WINDOW**2
    counts = counts[enough]

    def mean(values: Plane) -> Floats:
        return _sums(np.where(known, values, 0.0))[enough] / counts

    mean_left, mean_right = mean(left), mean(there)
    return _WindowStatistics(
        left=mean_left,
        right=mean_right,
        spread_left=np.sqrt(np.maximum(mean(left**2) - mean_left**2, 0)),
        spread_right=np.sqrt(np.maximum(mean(there**2) - mean_right**2, 0)),
    )


def _sums(values: Floats) -> Floats:
    """Return the sums over all windows: none where the image is smaller than one."""
    # A summed-area table with a border of zeros: its corners give the sum over any window.
    table = np.pad(values, ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    y, x = (np.arange(0, max(size - _WINDOW + 1, 0), _STRIDE) for size in values.shape)
    sums: Floats = table[np.ix_(y + _WINDOW, x + _WINDOW)] + table[np.ix_(y, x)]
    sums -= table[np.ix_(y, x + _WINDOW)] + table[np.ix_(y + _WINDOW, x)]
    return sums


def _fit(windows: _WindowStatistics, unclipped: Mask) -> tuple[float, float]:
    """Fit gain and gamma by Gauss-Newton on the logarithm of the gain, and on gamma.

    The weights are those of absolute deviations first, to come near from anywhere, then Tukey's
    biweight, which ignores outliers.
    """
    dark = windows.right
    gain, gamma = float(np.median(windows.left[unclipped]) / np.median(dark[unclipped])), 1.0

    for step in range(_STEPS):
        settled = step >= _ABSOLUTE_STEPS
        used = _below_top(windows, gain, gamma, unclipped) if settled else unclipped

        expected = _expected(windows, gain, gamma)
        residuals = windows.left - expected
        variance = _variance(windows, gain, gamma)
        scaled = np.abs(residuals) / np.sqrt(variance)
        # 1.4826: the median absolute deviation as a standard deviation.
        scale = float(1.4826 * np.median(scaled[used])) + 0.3
        if settled:
            robust = np.maximum(0, 1 - (scaled / (_CUT * scale)) ** 2) ** 2
        else:
            robust = 1 / np.maximum(scaled, 0.1 * scale)

        # The normal equations. Columns: the derivatives by the logarithm of the gain, and by gamma.
        slopes = np.stack([expected, expected * np.log(dark)], axis=1)
        weighted = slopes * (used * robust / variance)[:, np.newaxis]
        normal, target = slopes.T @ weighted, weighted.T @ residuals

        # The prior keeps gamma near 1 where the windows do not determine it.
        if settled:
            strength = _OVERLAP * (scale / _PRIOR) ** 2
            normal[1, 1] += strength
            target[1] -= strength * (gamma - 1)

        # A tiny ridge: windows may be equally bright. Short steps: the model is far from linear.
        normal += 1e-9 * np.trace(normal) * np.eye(2)

        change = np.clip(np.linalg.solve(normal, target), -0.3, 0.3)

        gain *= float(np.exp(change[0]))
        gamma = float(np.clip(gamma + change[1], *_GAMMAS))
    return gain, gamma


def _expected(windows: _WindowStatistics, gain: float, gamma: float) -> Floats:
    """Return what the left means should be.

    The mean of a power is not the power of the mean; to second order in the spread, this is.
    """
    uneven = np.minimum((windows.spread_right / windows.right) ** 2, 0.5)
    expected: Floats = gain * windows.right**gamma * (1 + gamma * (gamma - 1) / 2 * uneven)
    return expected


def _variance(windows: _WindowStatistics, gain: float, gamma: float) -> Floats:
    """Return how far the means may be off: far where there is an edge in the window."""
    expected = gain * gamma * windows.right ** (gamma - 1) * windows.spread_right
    variance: Floats = _TOLERANCE**2 + _UNEVEN * np.minimum(windows.spread_left, expected) ** 2
    return variance


def _below_top(windows: _WindowStatistics, gain: float, gamma: float, otherwise: Mask) -> Mask:
    """Return the windows that the fit says are not clipped; if they are too few, the others."""
    brightest = windows.right + _ABOVE_MEAN * windows.spread_right
    below: Mask = gain * brightest**gamma < _FITTED_TOP
    return below if np.count_nonzero(below) >= _LEAST_WINDOWS else otherwise

"""Degrades one image exactly, from seeds: blur, contrast, noise, and areas of different ones.

To make a pair one-sided, degrade one image and leave the other alone. Every degradation acts on
each channel in float64, continues borders by reflection (``d c b a | a b c d``), rounds to the
image's integer type, and only then adds noise and rounds again. Coordinates are x to the right and
y down, in pixels.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

Kernel = NDArray[np.float64]

Level = TypeVar("Level", np.uint8, np.uint16)

DISK_SAMPLES = 8  # sub-samples of a pixel in each direction
MOTION_SAMPLES = 16  # samples of the path per pixel of its length
# A tap costs the direct sum 0.9 ns a pixel; the transform takes 45 ns a pixel for most kernels.
MAX_DIRECT_TAPS = 49


def gaussian_psf(sigma: float) -> Kernel:
    """Return the point-spread function of a Gaussian blur, cut at 4 sigma.

    Parameters
    ----------
    sigma
        Standard deviation in pixels, 0 or more; 0 gives the identity.

    Returns
    -------
    float64 array of shape (2 n + 1, 2 n + 1) with n = floor(4 sigma + 1/2), sum 1.
    """
    half = int(4 * sigma + 0.5)
    if half == 0:
        return np.ones((1, 1))

    profile = np.exp(-0.5 * (np.arange(-half, half + 1) / sigma) ** 2)
    profile /= profile.sum()
    return np.multiply.outer(profile, profile)


def disk_psf(radius: float, inner: float | None = None) -> Kernel:
    """Return the point-spread function of defocus, a disk integrated per pixel (8x8 samples).

    Parameters
    ----------
    radius
        Radius in pixels, 0 or more; 0 gives the identity.
    inner
        Radius of a central obstruction, as of a mirror lens, which makes it an annulus.

    Returns
    -------
    float64 array of shape (2 n + 1, 2 n + 1) with n = ceil(radius - 1/2), sum 1.
    """
    half = max(0, int(np.ceil(radius - 0.5)))
    taps = np.arange(-half, half + 1)
    offsets = (np.arange(DISK_SAMPLES) + 0.5) / DISK_SAMPLES - 0.5

    # A tap counts the samples of its pixel that are inside the disk.
    counts = np.zeros((taps.size, taps.size))
    for dy in offsets:
        for dx in offsets:
            square = np.add.outer((taps + dy) ** 2, (taps + dx) ** 2)
            counts += (square <= radius**2) & (square > (-1 if inner is None else inner**2))

    if not counts.any():  # the disk is smaller than the grid of samples
        return np.ones((1, 1))

    counts /= counts.sum()
    return counts


def motion_psf(length: float, angle: float = 0.0) -> Kernel:
    """Return the point-spread function of a straight motion at constant speed.

    The path runs from -(length - 1)/2 to +(length - 1)/2 pixels in 16 length + 1 equal samples
    (rounded to a whole number), each split bilinearly over its four pixels.

    Parameters
    ----------
    length
        Length in pixels, 1 or more; 1 gives the identity.
    angle
        Direction in degrees, any finite number: 0 is along x; positive angles turn from x (right)
        toward y (down), clockwise as the image is displayed, so 90 is along y.

    Returns
    -------
    float64 array of shape (2 n + 1, 2 n + 1) with n = ceil((length - 1) / 2), sum 1.

    Raises
    ------
    ValueError
        If the length is less than 1, or the angle not finite.
    """
    if not (length >= 1 and np.isfinite(angle)):
        raise ValueError(f"length and angle: got {length} and {angle}; accepts 1 and more, finite")

    radians = np.deg2rad(angle)
    half = int(np.ceil((length - 1) / 2))
    path = np.linspace(-(length - 1) / 2, (length - 1) / 2, round(length * MOTION_SAMPLES) + 1)

    # Round, so that right angles are exact: cos(90 degrees) is 6e-17 in floating point.
    x, y = np.round(path * np.cos(radians), 12), np.round(path * np.sin(radians), 12)
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)

    psf = np.zeros((2 * half + 2, 2 * half + 2))  # one more for the far neighbors of the end
    for row, weight_y in ((top, 1 - (y - top)), (top + 1, y - top)):
        for col, weight_x in ((left, 1 - (x - left)), (left + 1, x - left)):
            np.add.at(psf, (row + half, col + half), weight_y * weight_x)

    psf = psf[:-1, :-1].copy()
    psf /= psf.sum()
    return psf


def convolve(image: ArrayLike, psf: ArrayLike) -> NDArray[np.float64]:
    """Convolve each channel with a kernel, borders continued by reflection (d c b a | a b c d).

    Parameters
    ----------
    image
        Array (H, W) or (H, W, C) of integers or finite floats.
    psf
        Kernel (rows, cols), both odd; may be larger than the image.

    Returns
    -------
    float64 array of the image's shape, not rounded; exact to about 1e-13 of the largest value.
    """
    pixels = np.asarray(image, np.float64)
    kernel = _trimmed(np.asarray(psf, np.float64))

    blurred = np.empty(pixels.shape)
    for channel in np.ndindex(pixels.shape[2:]):
        blurred[..., *channel] = _convolve_plane(pixels[..., *channel], kernel)

    return blurred


def _convolve_plane(plane: NDArray[np.float64], kernel: Kernel) -> NDArray[np.float64]:
    up, across = (size // 2 for size in kernel.shape)
    padded = np.pad(plane, ((up, up), (across, across)), mode="symmetric")

    # The cost of a direct sum grows with the taps; the transform costs almost the same for all
    # kernels.
    if np.count_nonzero(kernel) > MAX_DIRECT_TAPS:
        from scipy import signal  # noqa: PLC0415  # slow to import, and most of the harness does without

        return np.asarray(signal.oaconvolve(padded, kernel, mode="valid"))
    blurred = np.asarray(ndimage.convolve(padded, kernel, mode="constant"))
    return blurred[up : up + plane.shape[0], across : across + plane.shape[1]]


def quantize(values: NDArray[np.float64], dtype: type[Level] | np.dtype[Level]) -> NDArray[Level]:
    """Round to the nearest level (ties to even) and clip to the range of uint8 or uint16.

    Raises
    ------
    ValueError
        If a value is NaN.
    """
    if np.isnan(values).any():
        raise ValueError("values must not contain NaN")

    levels = np.dtype(dtype)
    return np.clip(np.rint(values), 0, np.iinfo(levels).max).astype(levels)


@dataclass(frozen=True, slots=True, eq=False)
class Degradation:
    """One way to degrade an image, a callable that takes it: blur, then contrast, then noise.

    ``round(top * gain * (blurred / top)^gamma + offset)``, top = 255 or 65535, and then, if there
    is any noise, a second rounding of the sum of that and the noise. A call takes a uint8 or uint16
    array (H, W) or (H, W, C), and returns a new one of the same shape and dtype. The default is the
    identity.

    Parameters
    ----------
    psf
        Kernel of the blur as for `convolve`, or None.
    gamma
        Exponent of the gray levels relative to white, > 0.
    gain
        Factor, >= 0.
    offset
        Gray levels to add, of the image's type.
    noise
        Standard deviation of the Gaussian noise in gray levels of the image's type, >= 0.
    seed
        Seed of the noise, for ``numpy.random.default_rng``, an integer >= 0.
    """

    psf: Kernel | None = None
    gamma: float = 1.0
    gain: float = 1.0
    offset: float = 0.0
    noise: float = 0.0
    seed: int = 0

    def __call__(self, image: NDArray[Level]) -> NDArray[Level]:
        """Return the degraded image, same shape and dtype."""
        top = float(np.iinfo(image.dtype).max)
        values = image.astype(np.float64) if self.psf is None else convolve(image, self.psf)
        if self.gamma != 1:  # the clip removes values that the transform leaves below zero
            values = top * (np.clip(values, 0, None) / top) ** self.gamma

        degraded = quantize(self.gain * values + self.offset, image.dtype)
        if self.noise == 0:
            return degraded

        grain = np.random.default_rng(self.seed).normal(0.0, self.noise, image.shape)
        return quantize(degraded + grain, image.dtype)


def areas(
    image: NDArray[Level],
    layout: ArrayLike,
    versions: Sequence[Callable[[NDArray[Level]], NDArray[Level]]],
    *,
    noise: float = 0.0,
    seed: int = 0,
) -> NDArray[Level]:
    """Show a different version of the image in different areas, with noise over the whole.

    Each version is computed on the whole image and then cut, so areas meet like two photographs and
    no version sees the border of its area.

    Parameters
    ----------
    image
        uint8 or uint16 array (H, W) or (H, W, C).
    layout
        Integers (rows, cols), the index of the version in each area. The areas are equal: area
        (i, j) covers the image rows H i // rows to H (i + 1) // rows, and columns in the same way.
    versions
        Callables from an image to an image of its shape and dtype, such as `Degradation`.
    noise, seed
        As for `Degradation`; the noise is added once, at the end, over the whole image.
    """
    # Cell i of n covers the pixels from size * i // n to size * (i + 1) // n.
    grid = np.asarray(layout)
    rows, cols = (
        np.repeat(np.arange(n), np.diff(size * np.arange(n + 1) // n))
        for n, size in zip(grid.shape, image.shape[:2], strict=True)
    )
    index = grid[np.ix_(rows, cols)]

    mosaic = np.empty_like(image)
    for number in np.unique(index):
        mosaic[index == number] = versions[number](image)[index == number]

    return Degradation(noise=noise, seed=seed)(mosaic)


def suite(
    *, noise: float = 1.0, seed: int = 0
) -> dict[str, Callable[[NDArray[Any]], NDArray[Any]]]:
    """Return the one-sided-blur suite: degradations by the names of their rows.

    ``sharp`` and ``contrast`` come without noise, all others with Gaussian noise of `noise` gray
    levels. ``mixed`` is 4x4 areas of a linear contrast change, motion, nothing, and defocus.
    """
    blurs = {
        "gauss 2": gaussian_psf(2),
        "gauss 4": gaussian_psf(4),
        "disk 3": disk_psf(3),
        "disk 6": disk_psf(6),
        "motion 9": motion_psf(9),
        "motion 15": motion_psf(15),
    }

    versions = [
        Degradation(gain=0.6, offset=20),
        Degradation(motion_psf(11)),
        Degradation(),
        Degradation(disk_psf(5)),
    ]

    grid = np.add.outer(np.arange(4), np.arange(4)) % 4

    return {
        "sharp": Degradation(),
        **{name: Degradation(psf, noise=noise, seed=seed) for name, psf in blurs.items()},
        "contrast 1.5 0.6": Degradation(gamma=1.5, gain=0.6),
        "mixed": partial(areas, layout=grid, versions=versions, noise=noise, seed=seed),
    }


def _trimmed(kernel: Kernel) -> Kernel:
    """Drop the zeros all around, keeping the center: a motion along x is one row."""
    rows, cols = (np.flatnonzero(kernel.any(axis=axis)) for axis in (1, 0))
    if rows.size == 0:
        return np.zeros((1, 1))

    center_y, center_x = kernel.shape[0] // 2, kernel.shape[1] // 2

    up, across = np.abs(rows - center_y).max(), np.abs(cols - center_x).max()
    return kernel[center_y - up : center_y + up + 1, center_x - across : center_x + across + 1]

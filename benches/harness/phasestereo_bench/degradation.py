"""Seeded, exact degradations of one image: blur, contrast, noise, and areas of different ones.

This is what makes a pair one-sided: degrade one image, leave the other. Every degradation acts on
each channel in float64 with borders continued by reflection (``d c b a | a b c d``), rounds to the
image's integer type, and only then adds noise and rounds again. Coordinates are x to the right and
y down, in pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import ArrayLike, NDArray

    Kernel = NDArray[np.float64]
    Recipe = Callable[[NDArray[Any]], NDArray[Any]]

Level = TypeVar("Level", np.uint8, np.uint16)

MAX_HALF_WIDTH = 1024  # taps on either side of a kernel's center: more than any lens needs
DISK_SAMPLES = 8  # sub-samples of a pixel in each direction
MOTION_SAMPLES = 16  # samples of the path per pixel of its length
# A tap costs the direct sum 0.9 ns a pixel; the transform takes 45 ns a pixel for most kernels.
MAX_DIRECT_TAPS = 49


def gaussian_psf(sigma: float) -> Kernel:
    """Point-spread function of a Gaussian blur, cut at 4 sigma.

    Parameters
    ----------
    sigma
        Standard deviation in pixels, in [0, 256]; 0 gives the identity.

    Returns
    -------
    float64 array of shape (2 n + 1, 2 n + 1) with n = floor(4 sigma + 1/2), sum 1.

    Raises
    ------
    TypeError, ValueError
        If `sigma` is not a number, or out of range or NaN.
    """
    sigma = _number("sigma", sigma, low=0.0, high=MAX_HALF_WIDTH / 4)

    half = int(4 * sigma + 0.5)
    if half == 0:
        return np.ones((1, 1))

    profile = np.exp(-0.5 * (np.arange(-half, half + 1) / sigma) ** 2)
    profile /= profile.sum()
    return np.multiply.outer(profile, profile)


def disk_psf(radius: float) -> Kernel:
    """Point-spread function of defocus: a disk, each tap integrated over its pixel (8x8 samples).

    Parameters
    ----------
    radius
        Radius in pixels, in [0, 1024]; 0 gives the identity.

    Returns
    -------
    float64 array of shape (2 n + 1, 2 n + 1) with n = ceil(radius - 1/2), sum 1.

    Raises
    ------
    TypeError, ValueError
        If `radius` is not a number, or out of range or NaN.
    """
    radius = _number("radius", radius, low=0.0, high=MAX_HALF_WIDTH)

    half = max(0, int(np.ceil(radius - 0.5)))
    taps = np.arange(-half, half + 1)
    offsets = (np.arange(DISK_SAMPLES) + 0.5) / DISK_SAMPLES - 0.5

    # A tap counts the samples of its pixel that are inside the disk.
    counts = np.zeros((taps.size, taps.size))
    for dy in offsets:
        for dx in offsets:
            counts += np.add.outer((taps + dy) ** 2, (taps + dx) ** 2) <= radius**2

    if not counts.any():  # smaller than the grid of samples sees
        return np.ones((1, 1))

    counts /= counts.sum()
    return counts


def motion_psf(length: float, angle: float = 0.0) -> Kernel:
    """Point-spread function of a straight motion at constant speed.

    The path runs from -(length - 1)/2 to +(length - 1)/2 pixels in 16 length + 1 equal samples
    (rounded to a whole number), each split bilinearly over its four pixels.

    Parameters
    ----------
    length
        Length in pixels, in [1, 2049]; 1 gives the identity.
    angle
        Direction in degrees, any finite number: 0 is along x; positive angles turn from x (right)
        towards y (down), clockwise as the image is displayed, so 90 is along y.

    Returns
    -------
    float64 array of shape (2 n + 1, 2 n + 1) with n = ceil((length - 1) / 2), sum 1.

    Raises
    ------
    TypeError, ValueError
        If an argument is not a number, or out of range or NaN.
    """
    length = _number("length", length, low=1.0, high=2 * MAX_HALF_WIDTH + 1)
    radians = np.deg2rad(_number("angle", angle))

    half = int(np.ceil((length - 1) / 2))
    path = np.linspace(-(length - 1) / 2, (length - 1) / 2, round(length * MOTION_SAMPLES) + 1)

    # Rounded so that right angles are exact: cos(90 degrees) is 6e-17 in floating point.
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
        Kernel (rows, cols), both odd, at most 2049; may be larger than the image.

    Returns
    -------
    float64 array of the image's shape, not rounded; exact to about 1e-13 of the largest value.

    Raises
    ------
    TypeError, ValueError
        If an array has a wrong dtype or shape, or contains NaN or infinity.
    """
    pixels = _finite_array("image", image, ndim=(2, 3))
    kernel = _trimmed(_kernel("psf", psf))

    blurred = np.empty(pixels.shape)
    for channel in np.ndindex(pixels.shape[2:]):
        blurred[..., *channel] = _convolve_plane(pixels[..., *channel], kernel)

    return blurred


def _convolve_plane(plane: NDArray[np.float64], kernel: Kernel) -> NDArray[np.float64]:
    up, across = (size // 2 for size in kernel.shape)
    padded = np.pad(plane, ((up, up), (across, across)), mode="symmetric")

    # A direct sum costs by the tap, the transform almost the same for all kernels.
    if np.count_nonzero(kernel) > MAX_DIRECT_TAPS:
        from scipy import signal  # noqa: PLC0415  # slow to import, and most of the harness does without

        return np.asarray(signal.oaconvolve(padded, kernel, mode="valid"))
    from scipy import ndimage  # noqa: PLC0415  # slow to import, and most of the harness does without

    blurred = np.asarray(ndimage.convolve(padded, kernel, mode="constant"))
    return blurred[up : up + plane.shape[0], across : across + plane.shape[1]]


def quantize(values: NDArray[np.float64], dtype: type[Level] | np.dtype[Level]) -> NDArray[Level]:
    """Round to the nearest level (ties to even) and clip to the range of uint8 or uint16.

    Raises
    ------
    TypeError, ValueError
        If `dtype` is another type, or a value is NaN.
    """
    levels = np.dtype(dtype)
    if levels not in (np.uint8, np.uint16):
        raise TypeError(f"dtype must be uint8 or uint16, got {levels}")
    if np.isnan(values).any():
        raise ValueError("values must not contain NaN")

    return np.clip(np.rint(values), 0, np.iinfo(levels).max).astype(levels)


@dataclass(frozen=True, slots=True, eq=False)
class Degradation:
    """One way to degrade an image, to be called with it: blur, then contrast, then noise.

    ``round(top * gain * (blurred / top)^gamma + offset)``, top = 255 or 65535, and then, if there
    is any noise, a second rounding of the sum of that and the noise. Calling it with a uint8 or
    uint16 array (H, W) or (H, W, C) returns a new one of the same shape and dtype; any other
    array is a TypeError or ValueError. The default is the identity.

    Parameters
    ----------
    psf
        Kernel of the blur as for `convolve`, or None; kept as a read-only copy.
    gamma
        Exponent of the gray levels relative to white, > 0.
    gain
        Factor, >= 0.
    offset
        Gray levels of the image's type added.
    noise
        Standard deviation of the Gaussian noise in gray levels of the image's type, >= 0.
    seed
        Of the noise, for ``numpy.random.default_rng``, an integer >= 0.

    Raises
    ------
    TypeError, ValueError
        If an argument has a wrong type or is out of range.
    """

    psf: Kernel | None = None
    gamma: float = 1.0
    gain: float = 1.0
    offset: float = 0.0
    noise: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Check every field once, so that calling can only fail because of the image."""
        if self.psf is not None:
            psf = _kernel("psf", self.psf).copy()
            psf.flags.writeable = False
            object.__setattr__(self, "psf", psf)

        _number("gamma", self.gamma, low=np.finfo(float).tiny)
        _number("gain", self.gain, low=0.0)
        _number("offset", self.offset)
        _number("noise", self.noise, low=0.0)
        _seed(self.seed)

    def __call__(self, image: NDArray[Level]) -> NDArray[Level]:
        """Return the degraded image, same shape and dtype."""
        _check_levels(image)

        top = float(np.iinfo(image.dtype).max)
        values = image.astype(np.float64) if self.psf is None else convolve(image, self.psf)
        if self.gamma != 1:  # the clip removes what the transform leaves below zero
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

    Each version is computed on the whole image and then cut, so that areas meet as two
    photographs would and no version sees the border of its area.

    Parameters
    ----------
    image
        uint8 or uint16 array (H, W) or (H, W, C).
    layout
        Integers (rows, cols), the index of the version each area shows. The areas are equal: area
        (i, j) covers the image rows H i // rows to H (i + 1) // rows and columns likewise; a
        layout of the image's own size is therefore a map of its pixels.
    versions
        Callables from an image to an image of its shape and dtype, such as `Degradation`.
    noise, seed
        As for `Degradation`: added once, at the end, over the whole image.

    Raises
    ------
    TypeError, ValueError
        If an argument has a wrong type, shape or range, or a version changes shape or dtype.
    """
    _check_levels(image)
    index = _layout(layout, image.shape[:2], len(versions))

    mosaic = np.empty_like(image)
    for number in np.unique(index):
        version = versions[number](image)
        if version.shape != image.shape or version.dtype != image.dtype:
            raise ValueError(
                f"versions[{number}] must keep shape {image.shape} and dtype {image.dtype}, "
                f"got {version.shape} and {version.dtype}"
            )
        mosaic[index == number] = version[index == number]

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


def _number(name: str, value: object, *, low: float = -np.inf, high: float = np.inf) -> float:
    if not isinstance(value, Real) or isinstance(value, bool):
        raise TypeError(f"{name} must be a number, got {type(value).__name__}")
    number = float(value)
    if not (np.isfinite(number) and low <= number <= high):
        raise ValueError(f"{name} must be a finite number in [{low:g}, {high:g}], got {number:g}")
    return number


def _seed(value: object) -> None:
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"seed must be an integer, got {type(value).__name__}")
    if value < 0:
        raise ValueError(f"seed must be >= 0, got {value}")


def _finite_array(name: str, values: ArrayLike, *, ndim: tuple[int, ...]) -> NDArray[np.float64]:
    array: NDArray[Any] = np.asarray(values)
    if array.dtype.kind not in "uif":
        raise TypeError(f"{name} must be an array of integers or floats, got dtype {array.dtype}")

    if array.ndim not in ndim or array.size == 0:
        wanted = " or ".join(map(str, ndim))
        raise ValueError(f"{name} must have {wanted} dimensions, none empty, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must not contain NaN or infinity")

    return array.astype(np.float64)


def _kernel(name: str, values: ArrayLike) -> Kernel:
    kernel = _finite_array(name, values, ndim=(2,))
    if any(size % 2 == 0 or size > 2 * MAX_HALF_WIDTH + 1 for size in kernel.shape):
        raise ValueError(
            f"{name} must have odd sides of at most {2 * MAX_HALF_WIDTH + 1}, got {kernel.shape}"
        )
    return kernel


def _trimmed(kernel: Kernel) -> Kernel:
    """Drop the zeros all around, keeping the center: a motion along x is one row."""
    rows, cols = (np.flatnonzero(kernel.any(axis=axis)) for axis in (1, 0))
    if rows.size == 0:
        return np.zeros((1, 1))

    center_y, center_x = kernel.shape[0] // 2, kernel.shape[1] // 2

    up, across = np.abs(rows - center_y).max(), np.abs(cols - center_x).max()
    return kernel[center_y - up : center_y + up + 1, center_x - across : center_x + across + 1]


def _check_levels(image: object) -> None:
    if not isinstance(image, np.ndarray) or image.dtype not in (np.uint8, np.uint16):
        got = image.dtype if isinstance(image, np.ndarray) else type(image).__name__
        raise TypeError(f"image must be a uint8 or uint16 array, got {got}")
    if image.ndim not in (2, 3) or image.size == 0:
        raise ValueError(f"image must be (H, W) or (H, W, C) and not empty, got {image.shape}")


def _layout(layout: ArrayLike, shape: tuple[int, ...], count: int) -> NDArray[np.intp]:
    """Spread a grid of indices over the pixels of an image."""
    grid = np.asarray(layout)

    if grid.dtype.kind not in "ui":
        raise TypeError(f"layout must be an array of integers, got dtype {grid.dtype}")
    if grid.ndim != len(shape) or grid.size == 0 or (np.array(grid.shape) > shape).any():
        raise ValueError(
            f"layout must be (rows, cols), 1 to the image's {shape} of them, got {grid.shape}"
        )
    if grid.min() < 0 or grid.max() >= count:
        raise ValueError(
            f"layout must hold indices of the {count} versions, got {grid.min()} to {grid.max()}"
        )

    # Cell i of n covers the pixels from size * i // n to size * (i + 1) // n.
    rows, cols = (
        np.repeat(np.arange(n), np.diff(size * np.arange(n + 1) // n))
        for n, size in zip(grid.shape, shape, strict=True)
    )

    spread: NDArray[np.intp] = grid[np.ix_(rows, cols)].astype(np.intp)
    return spread

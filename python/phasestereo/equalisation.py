"""What evens out one-sided blur: the versions of both images in which pixels are compared."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from phasestereo import _core
from phasestereo._images import as_array

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike, NDArray

    from phasestereo.blur import Blur, BlurEstimate
    from phasestereo.settings import Settings

    Taps = NDArray[np.float32]

LARGER, LARGEST = 2, 63
"""Pixels by which neighbourhoods and windows are larger where there is blur, and their largest."""

DEVIATIONS = 2.0
"""Standard deviations of the noise that are smoothed away.

Means of bad-1.0 (%) over the 12 scenes of the one-sided-blur suite: sharp, both images with noise
of 5 and 20 gray levels, JPEG of quality 70 and 30, after a disk of 3 px; the right one with noise
of 20: 1.5: 5.17 12.1 28.3 12.8 22.6 14.8 17.2; 2: 5.20 12.0 28.1 12.6 22.2 14.5 16.6.
"""

_LARGEST_DEVIATION = 1e300  # that the core takes

Noise: TypeAlias = float | tuple[float, float]
"""Standard deviations of the noise of both images, or those of the left and of the right one."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Equalisation:
    """Several versions of both images of a pair, and which of them each pixel is compared in.

    A blur that one image alone has is evened out by blurring the other one alike. Where the blur
    differs over the image, so does what evens it out: each pixel of the left image is of a class,
    and its code is that of the left image under the left kernel of its class. It is compared with
    the codes of the right image under the right kernel of the same class.

    Arrays are copied; the copies cannot be written to.

    Parameters
    ----------
    noise
        Standard deviations of the noise of the left and of the right image, in units of their
        pixels; those of gray values where the images have colour. Read with ``weak > 0`` alone; a
        kernel does not change them.
    kernels
        For each class, at most 16, a pair (left, right): what the images are convolved with, a 2-D
        array of float32 or float64 with odd sides up to 129 whose centre is the pixel itself, its
        taps finite, not negative and of sum 1 within 0.001, by which they are divided; or None
        where an image stays as it is. Taps are rounded to steps of 2^-14. The image continues by
        reflection (d c b a | a b c d); masked pixels take the value of the nearest valid one of
        their row before, as they do for all codes. Default: one class of images as they are.
    impulses
        By how much impulses of the left and of the right image stand out at least, in units of the
        pixels: pixels beyond the range of their eight neighbors, without the largest and the
        smallest of these, by more than that range and so much take the median of the neighbors,
        before all else. 0: there are none. Default (0, 0).
    smoothing
        Standard deviations with which the left and the right image are smoothed before they are
        convolved and described, in units of the pixels: by a guided filter over 5 x 5 pixels, which
        keeps what varies more (He, Sun and Tang, *Guided Image Filtering*, PAMI 2013). 0: not at
        all. Default (0, 0).
    labels
        uint8 (rows, cols): the class of each square tile of the left image.
    tile
        Side of the tiles, pixels, from 1. Pixel (x, y) is of the class
        ``labels[min(y // tile, rows - 1), min(x // tile, cols - 1)]``.

    Raises
    ------
    TypeError
        If an argument has the wrong type or dtype.
    ValueError
        If it has a wrong value or shape, or a label names no class.
    """

    noise: tuple[float, float]
    kernels: Iterable[tuple[ArrayLike | None, ArrayLike | None]] = ((None, None),)
    labels: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((1, 1), np.uint8))
    tile: int = 1
    impulses: tuple[float, float] = (0.0, 0.0)
    smoothing: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        """Copy the arrays and check every field, in the core, which owns the ranges."""
        object.__setattr__(self, "kernels", _as_kernels(self.kernels))
        object.__setattr__(self, "labels", _as_labels(self.labels))
        _core.check_versions(self)


def as_equalisation(noise: Noise | None, equalisation: Equalisation | None) -> Equalisation | None:
    """Return what a call tells of the noise of its images and of their versions, if anything.

    Raises
    ------
    TypeError
        If an argument has the wrong type.
    ValueError
        If both are given, or the noise is out of range.
    """
    if equalisation is None:
        return None if noise is None else Equalisation(noise=_as_pair(noise))
    if not isinstance(equalisation, Equalisation):
        kind = type(equalisation).__name__
        raise TypeError(f"equalisation: got {kind}; accepts Equalisation or None")
    if noise is not None:
        raise ValueError(f"noise: got {noise!r} beside equalisation, which tells it; accepts None")
    return equalisation


def asks_for_estimate(
    settings: Settings, noise: Noise | None, equalisation: Equalisation | None
) -> bool:
    """Tell whether a match needs to know more of its images than it was told."""
    needs_noise = settings.weak > 0 and noise is None
    looked_at = settings.equalise or settings.despike or settings.denoise
    return equalisation is None and (looked_at or needs_noise)


def even_out(
    estimate: BlurEstimate, settings: Settings, told: Equalisation | None
) -> tuple[Settings, Equalisation]:
    """Return the settings and the versions of both images that suit what was found out about them.

    Parameters
    ----------
    estimate
        What was found out.
    settings
        The settings asked for.
    told
        What the caller tells of the noise, which then counts.
    """
    noise = _weak_level(estimate) if told is None else told.noise
    impulses = estimate.impulses if settings.despike else (0.0, 0.0)
    given = None if told is None else told.noise
    smoothing = _smoothing(estimate, given) if settings.denoise else (0.0, 0.0)
    plain = Equalisation(noise=noise, impulses=impulses, smoothing=smoothing)
    if not settings.equalise or all(blur.psf is None for blur in estimate.blurs):
        return settings, plain
    kernels = [_kernels(blur) for blur in estimate.blurs]
    largest = LARGEST - LARGER if settings.sizes == 2 else LARGEST  # of two neighborhoods
    neighborhood = min(settings.neighborhood + LARGER, largest)
    window = min(settings.window + LARGER, LARGEST)
    versions = replace(plain, kernels=kernels, labels=estimate.labels, tile=estimate.tile)
    return replace(settings, neighborhood=neighborhood, window=window), versions


def _kernels(blur: Blur) -> tuple[ArrayLike | None, ArrayLike | None]:
    """Return what the images are convolved with: the sharper one with what it lacks."""
    return (blur.psf if blur.side == "right" else None, blur.psf if blur.side == "left" else None)


def _weak_level(estimate: BlurEstimate) -> tuple[float, float]:
    """Return the noise under which a component is weak: one level, at the contrast of each image.

    The noise of the softer image is what is left in both once the sharper one is blurred; and fine
    texture of the sharper one, which looks like noise, is not counted.
    """
    left, right = estimate.noise
    level = {
        "left": left,
        "right": right * estimate.contrast,
        "none": max(left, right * estimate.contrast),
    }[estimate.blur.side]
    return level, level / estimate.contrast


def _smoothing(estimate: BlurEstimate, noise: tuple[float, float] | None) -> tuple[float, float]:
    """Return how both images are smoothed: each by its own noise, and by what compression has lost.

    Where one image is softer, fine texture of the sharper one looks like noise: then the level at
    which components are weak counts. `noise` is what the caller tells.
    """
    if noise is None:
        blurred = any(blur.side != "none" for blur in estimate.blurs)
        noise = _weak_level(estimate) if blurred else estimate.noise
    lost = zip(noise, estimate.coding, strict=True)
    left, right = (min(DEVIATIONS * float(max(each)), _LARGEST_DEVIATION) for each in lost)
    return left, right


def _as_pair(noise: Noise) -> tuple[float, float]:
    return noise if isinstance(noise, tuple) else (noise, noise)


def _as_kernels(kernels: object) -> tuple[tuple[Taps | None, Taps | None], ...]:
    accepted = "a list with a pair (left, right) of 2-D arrays, or None, for each class"
    if not isinstance(kernels, (list, tuple)):
        raise TypeError(f"kernels: got {type(kernels).__name__}; accepts {accepted}")
    for pair in kernels:
        if not isinstance(pair, (list, tuple)):
            raise TypeError(f"kernels: got {type(pair).__name__} for a pair; accepts {accepted}")
        if len(pair) != 2:
            raise ValueError(f"kernels: got {len(pair)} arrays for a pair; accepts {accepted}")
    return tuple((_as_taps(left), _as_taps(right)) for left, right in kernels)


def _as_taps(kernel: ArrayLike | None) -> Taps | None:
    if kernel is None:
        return None
    taps = as_array(kernel, "kernels")
    if taps.dtype.kind != "f" or taps.dtype.itemsize not in (4, 8):
        raise TypeError(f"kernels: got dtype {taps.dtype}; accepts float32 or float64")
    if taps.ndim != 2:
        raise ValueError(f"kernels: got shape {taps.shape}; accepts 2-D arrays or None")
    if np.abs(taps).max(initial=0) > np.finfo(np.float32).max:
        raise ValueError("kernels: got a tap beyond float32; accepts a sum of 1 within 0.001")
    copy = taps.astype(np.float32, order="C")
    copy.flags.writeable = False
    return copy


def _as_labels(labels: ArrayLike) -> NDArray[np.uint8]:
    found = as_array(labels, "labels")
    if found.dtype != np.uint8:
        raise TypeError(f"labels: got dtype {found.dtype}; accepts uint8")
    if found.ndim != 2:
        raise ValueError(f"labels: got shape {found.shape}; accepts (rows, cols)")
    copy = found.astype(np.uint8, order="C")
    copy.flags.writeable = False
    return copy

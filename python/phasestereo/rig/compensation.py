"""Blur compensation: the kernels that convolve both images before their pixels are compared."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo import _core
from phasestereo._images import as_numbers
from phasestereo._numbers import check_type

Taps = NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BlurCompensation:
    """The kernels that even out the blur of only one image, area by area.

    The other image is blurred in the same way. Where the blur varies over the image, so do the
    kernels: each pixel of the left image has a class, and its code is that of the left image under
    the left kernel of its class. It is compared with the codes of the right image under the right
    kernel of the same class.

    Arrays are copied; the copies are read-only.

    Parameters
    ----------
    noise
        Standard deviations of the noise of the left and of the right image, in units of their
        pixels; for color images, of the gray values. Used only with ``noise_threshold > 0``; a
        kernel does not change them.
    kernels
        For each class, at most 16, a pair (left, right): the kernel of each image, a 2-D array of
        float32 or float64 with odd sides up to 129 whose center is the pixel itself. Its taps are
        finite, not negative and of sum 1 within 0.001, and are divided by their sum; or None: the
        image stays unchanged. Taps are rounded to steps of 2^-14. The image continues by reflection
        (d c b a | a b c d); masked pixels take the value of the nearest valid pixel before them in
        their row, as for all codes. Default: one class of unchanged images.
    impulses
        The least difference of impulses in the left and in the right image, in units of the pixels:
        a pixel is an impulse if it leaves the range of its eight neighbors, without the largest and
        the smallest of these, by more than that range plus this difference. It takes the median of
        the neighbors, before anything else. 0: no impulses. Default (0, 0).
    smoothing
        Standard deviations with which the left and the right image are smoothed before they are
        convolved and described, in units of the pixels: by a guided filter over 5 x 5 pixels, which
        keeps stronger variation (He, Sun and Tang, *Guided Image Filtering*, PAMI 2013). 0: no
        smoothing. Default (0, 0).
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
        If it has a wrong value or shape, or a label is not a class.

    Examples
    --------
    >>> mean = np.full((3, 3), 1 / 9)  # the left image is softer: the right one is convolved
    >>> compensation = ps.BlurCompensation(noise=(1, 1), kernels=[(None, mean)])
    >>> ps.match(left, right, known=ps.Known(blur_compensation=compensation))
    """

    noise: tuple[float, float]
    kernels: Iterable[tuple[ArrayLike | None, ArrayLike | None]] = ((None, None),)
    labels: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((1, 1), np.uint8))
    tile: int = 1
    impulses: tuple[float, float] = (0.0, 0.0)
    smoothing: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        """Copy the arrays and check every field in the core, which defines the ranges."""
        object.__setattr__(self, "kernels", _as_kernels(self.kernels))
        object.__setattr__(self, "labels", _as_labels(self.labels))
        _core.check_blur_compensation(self)


def _as_kernels(kernels: Any) -> tuple[tuple[Taps | None, Taps | None], ...]:
    accepted = "a list with a pair (left, right) of 2-D arrays, or None, for each class"

    check_type("kernels", kernels, (list, tuple), accepted)
    for pair in kernels:
        check_type("kernels", pair, (list, tuple), accepted)
        if len(pair) != 2:
            raise ValueError(f"kernels: got {len(pair)} arrays for a pair; accepts {accepted}")

    return tuple((_as_taps(left), _as_taps(right)) for left, right in kernels)


def _as_taps(kernel: ArrayLike | None) -> Taps | None:
    if kernel is None:
        return None

    taps = as_numbers(kernel, "kernels", ("float32", "float64"))
    if np.abs(taps).max(initial=0) > np.finfo(np.float32).max:
        raise ValueError("kernels: got a tap beyond float32; accepts a sum of 1 within 0.001")

    # A read-only copy: checked values stay as they are.
    copy = taps.astype(np.float32, order="C")
    copy.flags.writeable = False
    return copy


def _as_labels(labels: ArrayLike) -> NDArray[np.uint8]:
    copy = as_numbers(labels, "labels", ("uint8",)).astype(np.uint8, order="C")
    copy.flags.writeable = False
    return copy

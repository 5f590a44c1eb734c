"""The sample types and shapes of valid images."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Pixels: TypeAlias = NDArray[np.uint8 | np.uint16 | np.float32]

_EXACT = 2**24  # float32 holds all integers up to here


def channels(shape: tuple[int, ...]) -> int:
    """Return the number of channels of an image of this shape, 0 if the shape is invalid."""
    match shape:
        case _ if 0 in shape:
            return 0
        case (_, _):
            return 1
        case (_, _, 3 | 4 as count):
            return count
    return 0


def look_up(colors: NDArray[np.uint8], samples: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Replace each index by its color; a palette of grays, (N, 3) as any, makes a gray image."""
    if (colors == colors[:, :1]).all():
        return colors[:, 0][samples]
    return colors[samples]


def expand_bits(samples: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Replace bits by 0 and 255, as everything that shows a bit as a gray level does."""
    return samples.astype(np.uint8) * np.uint8(255)


def as_samples(samples: NDArray[Any], valid: NDArray[np.bool_] | None = None) -> Pixels:
    """Return samples of any real type as a type of images, without loss.

    Parameters
    ----------
    samples
        (H, W) or (H, W, C).
    valid
        (H, W), True = counts; None: all do. Other samples may have a value that float32 cannot
        hold, as "no data" often does.

    Raises
    ------
    ValueError
        If the samples are complex, or one that counts is too large for float32.
    """
    native = samples.astype(samples.dtype.newbyteorder("="), copy=False)
    if native.dtype in (np.uint8, np.uint16, np.float32):
        return native
    if native.dtype.kind not in "iuf":
        raise ValueError(f"samples of type {native.dtype}; an image has real numbers")

    with np.errstate(over="ignore"):
        narrow = native.astype(np.float32)

    if native.dtype.kind == "f":
        lost = np.isinf(narrow) & np.isfinite(native)
        why = "the range of float32"
    else:
        lost = (native > _EXACT) | (native < -_EXACT)
        why = "2**24, which float32 would round"

    # The mask gets a channel axis where the samples have one.
    counts = True if valid is None else valid.reshape(valid.shape + (1,) * (native.ndim - 2))
    if (lost & counts).any():
        raise ValueError(f"{native.dtype} samples beyond {why}")
    narrow[lost] = np.nan
    return narrow

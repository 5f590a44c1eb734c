"""What all scores of disparity maps share: which pixels count, and what is refused."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.floating]
Values = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

_MAP_NDIM = 2


def scored_values(estimate: Floats, truth: Floats, mask: Mask | None) -> tuple[Values, Values]:
    """Return estimate and truth of the scored pixels, 1-D float64; a missing estimate is NaN."""
    scored = scored_pixels(estimate, truth, mask)
    values = np.asarray(estimate)[scored].astype(np.float64)
    values[~np.isfinite(values)] = np.nan
    return values, np.asarray(truth)[scored].astype(np.float64)


def scored_pixels(estimate: Floats, truth: Floats, mask: Mask | None) -> Mask:
    """Return the mask of scored pixels of a checked estimate, truth and mask: at least one."""
    estimate, truth = checked_disparities("estimate", estimate), checked_disparities("truth", truth)
    if estimate.ndim != _MAP_NDIM:
        raise ValueError(f"estimate must be 2-D (H, W), got shape {estimate.shape}")
    checked_shape("truth", truth.shape, estimate.shape)

    known = np.isfinite(truth)
    scored = known
    if mask is not None:
        scored = known & checked_mask(mask, estimate.shape)

    if not scored.any():
        raise ValueError(
            f"nothing is left to score: of {truth.size} pixels {np.count_nonzero(known)} have a "
            f"known truth, and the mask holds none of them"
        )

    return scored


def checked_shape(name: str, shape: tuple[int, ...], wanted: tuple[int, ...]) -> None:
    """Raise ValueError if the shape is not that of the estimate."""
    if shape != wanted:
        raise ValueError(f"{name} must have the estimate's shape {wanted}, got {shape}")


def checked_disparities(name: str, disparities: Floats) -> Floats:
    """Return disparities as an array; a TypeError if they are not floats."""
    array = np.asarray(disparities)
    if not np.issubdtype(array.dtype, np.floating):
        raise TypeError(
            f"{name} must be an array of floats (disparities in pixels, NaN = none), got "
            f"{array.dtype}: convert it first (OpenCV's int16 holds d * 16, KITTI's uint16 d * 256)"
        )

    return array


def checked_mask(mask: Mask, shape: tuple[int, ...]) -> Mask:
    """Return a mask as an array; a TypeError or ValueError if it is not bool of this shape."""
    array = np.asarray(mask)
    if array.dtype != np.bool_:
        raise TypeError(f"mask must be an array of bool (True = score), got {array.dtype}")
    checked_shape("mask", array.shape, shape)
    return array

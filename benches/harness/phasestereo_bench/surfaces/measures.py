"""Counts wrong pixels of a map by the kind of their surface, and stripes.

The truth and the left image determine the kinds of pixels, so rendered and real pairs are counted
alike. All lengths are in pixels of the map, except the width of thin things.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from phasestereo_bench.arrays import Floats, Mask
from phasestereo_bench.rendering.casting import near_jumps

KINDS = ("all", "plain", "flat", "slanted", "edge", "thin", "curved")
"""All pixels that count; those without texture; and kinds that do not overlap: flat pixels, slanted
pixels, pixels near an edge, on a thin thing, and on a curved thing."""

JUMP = 2.0  # px between neighbors: an edge of a surface, or a stripe
EDGE_REACH = 2  # px
THIN_SHARE = 0.02  # of the image's width
STEEP = 0.05  # px a px: a surface with this slope or more is slanted
PLAIN, PLAIN_NOISE = 1.5, 2.0  # gray levels of local deviation, and the factor of the noise

_SLOPE_SIGMA = 3.0  # px over which slopes are averaged
_STEP = 1.0  # px between neighbors: a difference this large is not a slope
_ENOUGH = 1e-3


def kinds_of_pixels(
    truth: Floats, scored: Mask, gray: Floats, curved: Mask | None = None
) -> dict[str, Mask]:
    """Sort the pixels that count into `KINDS`.

    Parameters
    ----------
    truth
        Disparities (H, W), px; NaN or infinite = unknown.
    scored
        bool (H, W): the pixels that count, where the truth is known.
    gray
        Left image (H, W), gray levels.
    curved
        bool (H, W): pixels on a curved surface, if they are known.

    Returns
    -------
    dict
        A mask (H, W) for each of `KINDS`; without `curved`, nothing is curved.
    """
    known = np.isfinite(truth)
    scored = scored & known
    # Unknown pixels continue their neighbors.
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    whole = np.asarray(truth, dtype=np.float64)[tuple(nearest)]

    thin = _thin(whole)
    edge = near_jumps(whole, EDGE_REACH) & ~thin
    inside = scored & ~thin & ~edge
    bent = np.zeros_like(scored) if curved is None else curved
    steep = _slopes(whole) >= STEEP

    return {
        "all": scored,
        "plain": scored & _plain(np.asarray(gray, dtype=np.float64)),
        "flat": inside & ~bent & ~steep,
        "slanted": inside & ~bent & steep,
        "edge": scored & edge,
        "thin": scored & thin,
        "curved": inside & bent,
    }


def count_bad(
    disparity: Floats, truth: Floats, kinds: Mapping[str, Mask]
) -> dict[str, dict[str, int]]:
    """Count pixels by kind: "pixels", all; "bad_1" and "bad_2", off by more or without estimate."""
    error = np.abs(np.asarray(disparity, dtype=np.float64) - truth)
    every = np.ones(error.shape, dtype=bool)
    counted = {"pixels": every, "bad_1": ~(error <= 1.0), "bad_2": ~(error <= 2.0)}
    return {
        name: {kind: int((mask & which).sum()) for kind, mask in kinds.items()}
        for name, which in counted.items()
    }


def stripes(disparity: Floats) -> float:
    """Return the share of neighbors in a column that differ by more than 2 px, 0 to 1.

    Only pairs count whose pixels both have an estimate; NaN without any.
    """
    step = np.abs(np.diff(np.asarray(disparity, dtype=np.float64), axis=0))
    both = np.isfinite(step)
    return float((step[both] > JUMP).mean()) if both.any() else float("nan")


def gray_of(image: NDArray[Any]) -> NDArray[np.float64]:
    """Return an image (H, W) or (H, W, 3) as gray levels."""
    if image.ndim == 2:
        return image.astype(np.float64)
    return np.asarray(image[..., :3] @ np.array([0.299, 0.587, 0.114]), dtype=np.float64)


def _thin(truth: Floats) -> Mask:
    """Return the mask of things narrower than a share of the image, in front of both sides."""
    most = max(round(THIN_SHARE * truth.shape[1]), 1)
    return _narrow(truth, most) | _narrow(truth.T, most).T


def _narrow(truth: Floats, most: int) -> Mask:
    """Return the pieces of rows between jumps that are short and nearer than their neighbors.

    A piece that reaches a border of the image is not narrow.
    """
    # A row begins with a piece; the others begin at jumps.
    height, width = truth.shape
    begins = np.ones(truth.shape, dtype=bool)
    begins[:, 1:] = np.abs(np.diff(truth, axis=1)) > JUMP
    first = np.flatnonzero(begins)
    length = np.diff(first, append=truth.size)
    last = first + length - 1

    row = np.ravel(truth)
    before, behind = row[np.maximum(first - 1, 0)], row[np.minimum(last + 1, truth.size - 1)]
    rises = (row[first] - before > JUMP) & (first % width > 0)
    falls = (row[last] - behind > JUMP) & (last % width < width - 1)
    narrow = (length <= most) & rises & falls
    return np.repeat(narrow, length).reshape(height, width)


def _slopes(truth: Floats) -> Floats:
    """Return the steepness of the surface, from differences that are not steps."""
    square = np.zeros(truth.shape)
    for axis in (0, 1):
        rise = np.diff(truth, axis=axis, append=np.take(truth, [-1], axis))
        smooth = (np.abs(rise) <= _STEP).astype(np.float64)
        total, weight = (
            ndimage.gaussian_filter(each, _SLOPE_SIGMA) for each in (rise * smooth, smooth)
        )
        square += (total / np.maximum(weight, _ENOUGH)) ** 2
    return np.sqrt(square)


def _plain(gray: Floats) -> Mask:
    """Return the mask of pixels where 5 x 5 pixels deviate by little more than noise."""
    mean, square = (ndimage.uniform_filter(each, 5) for each in (gray, gray * gray))
    deviation = np.sqrt(np.maximum(square - mean * mean, 0))

    # From the median of a Laplacian, whose standard deviation is sqrt(20) times that of the noise.
    noise = float(np.median(np.abs(ndimage.laplace(gray)))) / (0.6745 * np.sqrt(20))
    return deviation < PLAIN + PLAIN_NOISE * noise

"""Analysis by synthesis, written from its definitions alone, as `oracle` is.

From a map and a pair of which one image is blurred, in areas, to the map by which the blurred image
can best be made again, and to one whose outlines are those of the left image.
"""

# ruff: noqa: N803 -- L is the paper's name

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from support import oracle
from support.oracle_refinement import around, shifted

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Map = NDArray[np.float32]
Side = Literal["left", "right"]
Images = tuple[Floats, Floats]
Kernels = Sequence[tuple[Floats | None, Floats | None]]


def rivals(disparity: Map) -> list[Map]:
    """Return the map, and it eroded and dilated by 9 x 9 pixels where that is over 0.5 off."""
    nearby = [shifted(disparity, dy, dx) for dy in range(-4, 5) for dx in range(-4, 5)]
    others = np.nanmin(nearby, axis=0), np.nanmax(nearby, axis=0)
    differ = (np.where(np.abs(other - disparity) > 0.5, other, disparity) for other in others)
    return [disparity, *(other.astype(np.float32) for other in differ)]


def whole(disparity: Map) -> Ints:
    """Return disparities in whole pixels; 0 elsewhere."""
    return np.rint(np.nan_to_num(disparity)).astype(np.int64)


def shown_left(right: Floats, disparity: Map) -> Floats:
    """Return the left view of the right image."""
    columns = np.arange(right.shape[1]) - whole(disparity)
    return np.take_along_axis(right, np.clip(columns, 0, right.shape[1] - 1), axis=1)


def seen_from_right(disparity: Ints) -> Floats:
    """Return the disparities of the right view: the largest that lead there; NaN where none does.

    A single pixel that none leads to has the larger of those beside it.
    """
    seen = np.full(disparity.shape, np.nan)
    for (y, x), d in np.ndenumerate(disparity):
        if 0 <= x - d < disparity.shape[1]:
            seen[y, x - d] = np.fmax(seen[y, x - d], d)
    beside = np.maximum(shifted(seen, 0, -1), shifted(seen, 0, 1))
    return np.where(np.isnan(seen), beside, seen)


def shown_right(left: Floats, right: Floats, disparity: Map) -> Floats:
    """Return the right view of the left image.

    Where it shows nothing there is the right image, as bright as what is shown in the 16 columns
    on either side of the gap.
    """
    seen = seen_from_right(whole(disparity))
    columns = np.arange(left.shape[1]) + np.nan_to_num(seen).astype(np.int64)
    shown = np.take_along_axis(left, np.clip(columns, 0, left.shape[1] - 1), axis=1)
    shown[np.isnan(seen)] = np.nan

    filled = shown.copy()

    for y, x in np.argwhere(np.isnan(shown)):
        known = np.flatnonzero(~np.isnan(shown[y]))
        start = max(known[known < x], default=-1) + 1
        end = min(known[known > x], default=left.shape[1])

        near = np.arange(max(start - 16, 0), min(end + 16, left.shape[1]))
        brighter = (shown - right)[y, near[~np.isnan(shown[y, near])]]
        filled[y, x] = right[y, x] + (np.floor(brighter.mean()) if len(brighter) else 0)

    return filled


def windows(values: Ints) -> Ints:
    """Return the sums over 15 x 15 pixels, as far as they lie within the image."""
    padded = np.pad(values, 7)
    sums: Ints = np.lib.stride_tricks.sliding_window_view(padded, (15, 15)).sum(axis=(2, 3))
    return sums


def levels(gray: Floats, L: int, threshold: float) -> Ints:
    """Return the levels of the components at the frequencies (0, 1), (1, -1), (1, 0), (1, 1)."""
    return oracle.weak_levels(oracle.spectrum(gray, L, 1, 1), 1, threshold)


def distances(
    images: Images, disparity: Map, kernel: Floats, side: Side, *, L: int, weak: tuple[float, float]
) -> Ints:
    """Return the error of the soft image by a map, pixel by pixel."""
    left, right = images
    if side == "left":
        synthetic = oracle.convolve(shown_left(right, disparity), kernel)
        there, soft = levels(synthetic, L, weak[1]), levels(left, L, weak[0])
    else:
        synthetic = oracle.convolve(shown_right(left, right, disparity), kernel)
        there, soft = levels(synthetic, L, weak[0]), levels(right, L, weak[1])

    differences: Ints = np.abs(there - soft).sum(axis=(2, 3))
    return differences


def synthesize(
    images: Images,
    disparity: Map,
    kernels: Kernels,
    classes: Ints,
    *,
    L: int,
    weak: tuple[float, float],
) -> Map:
    """Return the disparities of those of three maps that explain the soft image best.

    A class whose left kernel alone is given has a soft right image, and the other way about.
    """
    maps = rivals(disparity)
    there = np.stack([whole(one) for one in maps])
    x = np.arange(disparity.shape[1])
    places = [np.clip(x - d, 0, disparity.shape[1] - 1) for d in (there.min(0), there.max(0))]

    unlike = np.zeros((len(maps), *disparity.shape), np.int64)

    for one, sums in zip(maps, unlike, strict=True):
        in_left = np.zeros(disparity.shape, np.int64)

        for index, (left, right) in enumerate(kernels):
            own = classes == index
            if left is None and right is not None:
                in_left[own] = distances(images, one, right, "left", L=L, weak=weak)[own]
            elif left is not None and right is None:
                seen = windows(distances(images, one, left, "right", L=L, weak=weak))
                read = sum(np.take_along_axis(seen, place, axis=1) for place in places)
                sums[own] = np.asarray(read)[own]

        judged = np.isin(
            classes, [i for i, (a, b) in enumerate(kernels) if a is None and b is not None]
        )
        sums[judged] = windows(in_left)[judged]

    best = unlike.argmin(axis=0)
    chosen: Map = np.take_along_axis(np.stack(maps), best[np.newaxis], axis=0)[0]
    return chosen


def outline(disparity: Map, gray: Floats) -> Map:
    """Return the map with weighted medians of 7 x 7 pixels, three apart, within 8 px of jumps.

    Weights fall linearly to 0 at a gray value off by 16 mean differences of neighbors, and as a
    Gaussian of 6 pixels with the distance; they are rounded down to 255ths, disparities are counted
    in eighths of a pixel from the pixel's own.
    """
    jumps = np.zeros(disparity.shape, bool)
    jumps[:, :-1] |= np.abs(np.diff(disparity, axis=1)) > 1
    jumps[:-1] |= np.abs(np.diff(disparity, axis=0)) > 1

    level = np.trunc(gray * (255 / max(16 * oracle.mean_step(gray), 1.0)))
    eighths = np.trunc(np.nan_to_num(disparity) * 8)
    drawn = disparity.copy()

    for y, x in np.argwhere(~np.isnan(disparity)):
        here = int(y), int(x)
        if not any(jumps[there] for there in around(here, disparity.shape, 8)):
            continue

        window = [p for p in around(here, disparity.shape, 9, 3) if not np.isnan(disparity[p])]
        pairs = sorted((eighths[p] - eighths[here], _weight(level, here, p)) for p in window)
        below = np.cumsum([weight for _, weight in pairs])
        middle = int(np.argmax(2 * below >= below[-1]))
        drawn[here] += np.float32(pairs[middle][0] / 8)

    return drawn


def _weight(level: Floats, here: tuple[int, int], there: tuple[int, int]) -> int:
    alike = max(255 - abs(int(level[there]) - int(level[here])), 0)
    squares = (there[0] - here[0]) ** 2 + (there[1] - here[1]) ** 2
    return alike * min(round(256 * float(np.exp(-squares / 72))), 255) // 256

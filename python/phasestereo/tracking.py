"""Blocks of the left image found again in the right one, in both directions, to parts of a pixel.

Here belongs the search for correspondences that need not lie on the same row, from small copies of
the images to the full size; what they say about the pair is for others (`phasestereo.alignment`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from phasestereo.rough import reduced, reduction, rough_disparity

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    Plane = NDArray[np.float32]
    Floats = NDArray[np.float64]
    Indices = NDArray[np.intp]

BLOCK = 21
"""Side of a block, in pixels of the copy it is looked for in."""

_START_WIDTH = 128
_START_ROWS = 6  # pixels of the smallest copy: 5 % of the width either way
_CLEARLY = 1.05  # times as much matched: blur and noise make small differences
_COARSE_WIDTH = 256
_BLOCKS = 900
_FIRST_REACH = 3, 2  # rows and columns searched around what the rough map says
_REACH = 2, 2
_LEAST_CORRELATION = 0.5
_BINOMIAL = np.array([1, 4, 6, 4, 1], dtype=np.float32) / 16


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """Where blocks of the left image lie in the right one; all arrays (N,), float64.

    Parameters
    ----------
    x, y
        Centre of a block in the left image, pixels.
    dx, dy
        What leads from there to its centre in the right image, pixels.
    weight
        How well the correlation fixes ``dy``: the inverse of its variance, of arbitrary scale.
    factor
        Reduction of the copies in which they were found last.
    spacing
        Distance between neighbouring blocks, pixels.
    """

    x: Floats
    y: Floats
    dx: Floats
    dy: Floats
    weight: Floats
    factor: int
    spacing: int


def tracked(left: Plane, right: Plane) -> Iterator[Tracks]:
    """Follow some 900 blocks, and yield where they are in every copy, from small to full size.

    Parameters
    ----------
    left, right
        Gray images, float32 (H, W), at least 48 pixels either way; blur, gain and offset of one of
        them do little harm, vertical displacements of up to 5 % of the width none.
    """
    tracks = _first(left, right)
    reach = _FIRST_REACH
    while tracks.x.size:
        small = _smoothed(reduced(left, tracks.factor)), _smoothed(reduced(right, tracks.factor))
        tracks = _followed(*small, tracks, reach)
        yield tracks
        if tracks.factor == 1:
            return
        tracks = replace(tracks, factor=tracks.factor // 2)
        reach = _REACH


def _first(left: Plane, right: Plane) -> Tracks:
    """Take a grid of blocks from the rough map, where it is known."""
    factor = reduction(left.shape, _COARSE_WIDTH)
    rows = round(_row_offset(left, right) / factor)
    disparity = rough_disparity(reduced(left, factor), _raised(reduced(right, factor), rows))
    step = max(1, int(np.sqrt(disparity.size / _BLOCKS)))
    grid = np.s_[step // 2 :: step, step // 2 :: step]
    y, x = np.indices(disparity.shape)[:, *grid]
    known = np.isfinite(disparity[grid])
    return Tracks(
        x=_from_copy(x[known], factor),
        y=_from_copy(y[known], factor),
        dx=-factor * disparity[grid][known].astype(np.float64),
        dy=np.full(np.count_nonzero(known), float(factor * rows)),
        weight=np.ones(np.count_nonzero(known)),
        factor=factor,
        spacing=step * factor,
    )


def _row_offset(left: Plane, right: Plane) -> int:
    """Return the vertical offset, in pixels, at which most of a small copy can be matched."""
    factor = reduction(left.shape, _START_WIDTH)
    small = reduced(left, factor), reduced(right, factor)
    best, most = 0, 0
    for rows in sorted(range(-_START_ROWS, _START_ROWS + 1), key=abs):
        disparity = rough_disparity(small[0], _raised(small[1], rows))
        matched = int(np.count_nonzero(np.isfinite(disparity)))
        if matched > _CLEARLY * most:
            best, most = rows, matched
    return factor * best


def _raised(image: Plane, rows: int) -> Plane:
    """Return an image moved up by so many rows, its edge repeated."""
    height = image.shape[0]
    return image[np.clip(np.arange(height) + rows, 0, height - 1)]


def _smoothed(image: Plane) -> Plane:
    """Return an image after a 5x5 binomial: parts of a pixel then follow a parabola."""
    for axis in (0, 1):
        lines = np.moveaxis(image, axis, 0)
        padded = np.pad(lines, ((2, 2), (0, 0)), mode="edge")
        count = lines.shape[0]
        summed = sum(w * padded[n : n + count] for n, w in enumerate(_BINOMIAL))
        image = np.moveaxis(np.asarray(summed, np.float32), 0, axis)
    return np.ascontiguousarray(image)


def _followed(left: Plane, right: Plane, tracks: Tracks, reach: tuple[int, int]) -> Tracks:
    """Look for every block around where it was; leave out those that are not found."""
    factor = tracks.factor
    half = BLOCK // 2
    x, y = (_in_copy(place, factor) for place in (tracks.x, tracks.y))
    x_right = np.rint(x + tracks.dx / factor).astype(np.intp)
    y_right = np.rint(y + tracks.dy / factor).astype(np.intp)
    inside = _inside(left.shape, x, y, half, half)
    inside &= _inside(right.shape, x_right, y_right, half + reach[1], half + reach[0])
    x, y, x_right, y_right = (place[inside] for place in (x, y, x_right, y_right))
    blocks = _cut(left, x, y, half, half)
    areas = _cut(right, x_right, y_right, half + reach[1], half + reach[0])
    fine_x, fine_y, weight = _peak(_correlation(blocks, areas, reach))
    found = weight > 0
    return Tracks(
        x=_from_copy(x, factor)[found],
        y=_from_copy(y, factor)[found],
        dx=factor * (x_right - x + fine_x)[found],
        dy=factor * (y_right - y + fine_y)[found],
        weight=weight[found],
        factor=factor,
        spacing=tracks.spacing,
    )


def _in_copy(place: Floats, factor: int) -> Indices:
    return np.asarray(np.rint((place + 0.5) / factor - 0.5), np.intp)


def _from_copy(place: Indices, factor: int) -> Floats:
    return np.asarray(factor * (place + 0.5) - 0.5, np.float64)


def _inside(
    shape: tuple[int, ...], x: Indices, y: Indices, half_x: int, half_y: int
) -> NDArray[np.bool_]:
    across = (x >= half_x) & (x < shape[1] - half_x)
    return across & (y >= half_y) & (y < shape[0] - half_y)


def _cut(image: Plane, x: Indices, y: Indices, half_x: int, half_y: int) -> Plane:
    """Return what surrounds each place, less its mean: (N, rows, cols)."""
    rows = y[:, np.newaxis] + np.arange(-half_y, half_y + 1)
    cols = x[:, np.newaxis] + np.arange(-half_x, half_x + 1)
    cut = image[rows[:, :, np.newaxis], cols[:, np.newaxis, :]]
    return np.asarray(cut - cut.mean(axis=(1, 2), keepdims=True), np.float32)


def _correlation(blocks: Plane, areas: Plane, reach: tuple[int, int]) -> Plane:
    """Return the normalised cross-correlation at every offset: (N, 2 reach + 1, 2 reach + 1)."""
    size = BLOCK * BLOCK
    energy = np.einsum("nij,nij->n", blocks, blocks)
    offsets = 2 * reach[0] + 1, 2 * reach[1] + 1
    correlation = np.zeros((blocks.shape[0], *offsets), np.float32)
    for row, col in product(*map(range, offsets)):
        other = areas[:, row : row + BLOCK, col : col + BLOCK]
        spread = np.einsum("nij,nij->n", other, other) - size * other.mean(axis=(1, 2)) ** 2
        norm = energy * spread
        np.divide(
            np.einsum("nij,nij->n", blocks, other),
            np.sqrt(np.maximum(norm, 0)),
            out=correlation[:, row, col],
            where=norm > np.finfo(np.float32).tiny,
        )
    return correlation


def _peak(correlation: Plane) -> tuple[Floats, Floats, Floats]:
    """Return the place of each maximum (x, y from the middle) and its weight, 0 where it is none.

    A paraboloid through the 3x3 correlations around the largest one tells parts of a pixel. Its
    curvature along y, where x is free to follow, is what fixes y: none along a vertical edge.
    """
    count, rows, cols = correlation.shape
    which = np.arange(count)
    row, col = np.divmod(correlation.reshape(count, rows * cols).argmax(axis=1), cols)
    inner = (row > 0) & (row < rows - 1) & (col > 0) & (col < cols - 1)
    row, col = np.clip(row, 1, rows - 2), np.clip(col, 1, cols - 2)
    at = {
        (dy, dx): correlation[which, row + dy, col + dx].astype(np.float64)
        for dy, dx in product((-1, 0, 1), repeat=2)
    }
    slope_y, slope_x = (at[1, 0] - at[-1, 0]) / 2, (at[0, 1] - at[0, -1]) / 2
    bend_y, bend_x = (at[1, 0] + at[-1, 0] - 2 * at[0, 0], at[0, 1] + at[0, -1] - 2 * at[0, 0])
    twist = (at[1, 1] - at[1, -1] - at[-1, 1] + at[-1, -1]) / 4
    solid = inner & (at[0, 0] > _LEAST_CORRELATION) & (bend_y < 0) & (bend_x < 0)
    determinant = bend_x * bend_y - twist**2
    solid &= determinant > 0
    determinant[~solid], bend_x[~solid] = 1, -1
    y = (twist * slope_x - bend_x * slope_y) / determinant
    x = (twist * slope_y - bend_y * slope_x) / determinant
    solid &= (np.abs(x) < 1) & (np.abs(y) < 1)
    sharpness = -determinant / bend_x
    weight = np.where(solid, sharpness / (1.02 - at[0, 0]), 0)
    return col - cols // 2 + x, row - rows // 2 + y, weight

"""Finds the first hit of each ray: depths, disparities of either view, pixels seen by both."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from phasestereo_bench.arrays import Mask, Plane
from phasestereo_bench.rendering.camera import RIGHT, Camera, Rays
from phasestereo_bench.rendering.shapes import Shape

Window = tuple[int, int, int, int]

GRAZING = 1e-4  # px of disparity: surfaces this close are the same point
JUMP, DISC_REACH = 2.0, 4  # px of disparity, px of image


def windows(
    shapes: Sequence[Shape], camera: Camera, side: int, slack: tuple[float, float] = (0.0, 0.0)
) -> list[Window]:
    """Bound the window of each shape: rows from, to, columns from, to, widened by slack."""
    bounds = []
    for shape in shapes:
        x, y, depth = camera.project(shape.corners(), side)
        if depth.min() <= 0:  # a shape that reaches behind the camera may be anywhere
            bounds.append((0, camera.height, 0, camera.width))
            continue

        top, bottom = np.clip([y.min() - 1, y.max() + 2], 0, camera.height)
        left, right = np.clip([x.min() - 1 + slack[0], x.max() + 2 + slack[1]], 0, camera.width)
        bounds.append((int(top), int(bottom), int(left), int(right)))

    return bounds


def cast(
    shapes: Sequence[Shape], rays: Rays, bounds: Sequence[Window], first_row: int
) -> tuple[NDArray[Any], NDArray[np.uint16]]:
    """Return depth and index of each ray's nearest shape in a band that begins at `first_row`."""
    size = np.broadcast_shapes(rays.x.shape, rays.y.shape)
    depth = np.full(size, np.inf, dtype=rays.x.dtype)
    index = np.zeros(size, dtype=np.uint16)

    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # rays that miss
        for number, (top, bottom, left, right) in enumerate(bounds):
            rows = slice(max(top - first_row, 0), min(bottom - first_row, size[-2]))
            cols = slice(left, right)
            if rows.start >= rows.stop or left >= right:
                continue

            met = shapes[number].hit(rays.window(rows, cols))
            nearer = (met > 0) & (met < depth[..., rows, cols])
            np.copyto(depth[..., rows, cols], met, where=nearer)
            np.copyto(index[..., rows, cols], np.uint16(number), where=nearer)

    return depth, index


def disparities(shapes: Sequence[Shape], camera: Camera, side: int) -> Plane:
    """Return the disparities at the pixel centers of a view."""
    return seen(shapes, camera, side)[0]


def seen(shapes: Sequence[Shape], camera: Camera, side: int) -> tuple[Plane, NDArray[np.uint16]]:
    """Return disparities at the pixel centers of a view, and the index of the shape there."""
    bounds = windows(shapes, camera, side)
    disparity = np.empty((camera.height, camera.width))
    number = np.empty(disparity.shape, dtype=np.uint16)

    for band, columns, rows in camera.bands():
        rays = camera.rays(columns, rows, side)
        depth, number[band] = cast(shapes, rays, bounds, band.start)
        disparity[band] = camera.focal_baseline / depth

    return disparity, number


def visible_in_both(shapes: Sequence[Shape], camera: Camera, truth: Plane) -> Mask:
    """Return whether each left pixel's point is the front-most in the right view."""
    bounds = windows(shapes, camera, RIGHT, slack=(truth.min(), truth.max()))
    visible = np.empty(truth.shape, dtype=bool)

    for band, columns, rows in camera.bands():
        matched = columns - truth[band]
        depth, _ = cast(shapes, camera.rays(matched, rows, RIGHT), bounds, band.start)
        inside = columns >= truth[band].astype(np.float32)  # in the precision of the truth
        visible[band] = (camera.focal_baseline / depth <= truth[band] + GRAZING) & inside

    return visible


def near_jumps(truth: Plane, reach: int = DISC_REACH) -> Mask:
    """Return the pixels within `reach` px of a jump between neighbors of more than `JUMP`."""
    jumps = np.zeros(truth.shape, dtype=bool)
    across, down = (abs(np.diff(truth, axis=axis)) > JUMP for axis in (1, 0))
    for side, jump in (
        (np.s_[:, 1:], across),
        (np.s_[:, :-1], across),
        (np.s_[1:], down),
        (np.s_[:-1], down),
    ):
        jumps[side] |= jump

    # A jump already marks the pixels on both of its sides, which counts as the first step.
    return ndimage.maximum_filter(jumps, size=2 * reach - 1)

"""The first hit of each ray: depths, disparities of either view, and pixels that both views see."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo_bench.arrays import Mask, Plane
from phasestereo_bench.rendering.camera import RIGHT, Camera, Rays
from phasestereo_bench.rendering.shapes import Shape

Window = tuple[int, int, int, int]

GRAZING = 1e-4  # px of disparity within which two surfaces are the same point
JUMP, DISC_REACH = 2.0, 4  # px of disparity, px of image


def windows(
    shapes: Sequence[Shape], camera: Camera, side: int, slack: tuple[float, float] = (0.0, 0.0)
) -> list[Window]:
    """Bound where each shape is seen: rows from, to, columns from, to, these widened by slack."""
    bounds = []
    for shape in shapes:
        x, y, depth = camera.project(shape.corners(), side)
        if depth.min() <= 0:  # reaches behind the camera: may be anywhere
            bounds.append((0, camera.height, 0, camera.width))
            continue

        top, bottom = np.clip([y.min() - 1, y.max() + 2], 0, camera.height)
        left, right = np.clip([x.min() - 1 + slack[0], x.max() + 2 + slack[1]], 0, camera.width)
        bounds.append((int(top), int(bottom), int(left), int(right)))

    return bounds


def cast(
    shapes: Sequence[Shape], rays: Rays, bounds: Sequence[Window], first_row: int
) -> tuple[NDArray[Any], NDArray[np.uint16]]:
    """Depth and index of the nearest shape on each ray of a band that begins at `first_row`."""
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
    """Disparities at the pixel centers of a view."""
    return seen(shapes, camera, side)[0]


def seen(shapes: Sequence[Shape], camera: Camera, side: int) -> tuple[Plane, NDArray[np.uint16]]:
    """Disparities at the pixel centers of a view, and which shape is seen there."""
    bounds = windows(shapes, camera, side)
    disparity = np.empty((camera.height, camera.width))
    number = np.empty(disparity.shape, dtype=np.uint16)

    for band, columns, rows in camera.bands():
        rays = camera.rays(columns, rows, side)
        depth, number[band] = cast(shapes, rays, bounds, band.start)
        disparity[band] = camera.focal_baseline / depth

    return disparity, number


def visible_in_both(shapes: Sequence[Shape], camera: Camera, truth: Plane) -> Mask:
    """Whether the point seen at each left pixel's center is the front-most in the right view."""
    bounds = windows(shapes, camera, RIGHT, slack=(truth.min(), truth.max()))
    visible = np.empty(truth.shape, dtype=bool)

    for band, columns, rows in camera.bands():
        matched = columns - truth[band]
        depth, _ = cast(shapes, camera.rays(matched, rows, RIGHT), bounds, band.start)
        inside = columns >= truth[band].astype(np.float32)  # as those see it who get the truth
        visible[band] = (camera.focal_baseline / depth <= truth[band] + GRAZING) & inside

    return visible


def near_jumps(truth: Plane, reach: int = DISC_REACH) -> Mask:
    """Pixels within this many px of a jump between neighbors of more than `JUMP`."""
    from scipy import ndimage  # noqa: PLC0415  # slow to import, and most of the harness does without

    jumps = np.zeros(truth.shape, dtype=bool)
    across, down = (abs(np.diff(truth, axis=axis)) > JUMP for axis in (1, 0))
    for side, jump in (
        (np.s_[:, 1:], across),
        (np.s_[:, :-1], across),
        (np.s_[1:], down),
        (np.s_[:-1], down),
    ):
        jumps[side] |= jump

    # A jump has marked the pixels on both of its sides, which is the first of the steps.
    return ndimage.maximum_filter(jumps, size=2 * reach - 1)

"""Disparities and a calibration in, a surface out: triangles with the left image on them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from phasestereo._images import as_mask, as_pixels, as_rgb8
from phasestereo._numbers import as_number
from phasestereo.result import Result
from phasestereo.views.triangulation import as_map, check_calibration, triangulated

if TYPE_CHECKING:
    from typing import Any

    from numpy.typing import ArrayLike, NDArray

    from phasestereo.io import Calibration

__all__ = ["Mesh", "surface_mesh"]


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """A surface in the frame of the left camera: X to the right, Y down, Z forward.

    Parameters
    ----------
    points
        float32 (N, 3): corners, in the unit of the baseline.
    faces
        int64 (M, 3): the corners of each triangle, by their row in `points`; counter-clockwise as
        the camera sees them.
    pixels
        float32 (N, 2): column and row of each corner in the picture.
    picture
        uint8 (H, W, 3), RGB: what is on the surface; None: nothing.
    """

    points: NDArray[np.float32]
    faces: NDArray[np.int64]
    pixels: NDArray[np.float32]
    picture: NDArray[np.uint8] | None

    def __repr__(self) -> str:
        """Tell the numbers of corners and triangles: arrays would tell nothing."""
        return f"<Mesh {len(self.points)} points, {len(self.faces)} triangles>"


def surface_mesh(
    disparity: Result | ArrayLike,
    calibration: Calibration,
    *,
    image: ArrayLike | None = None,
    mask: ArrayLike | None = None,
    max_depth: float | None = None,
    max_step: float = 1.0,
) -> Mesh:
    """Turn a disparity map into a surface.

    Parameters
    ----------
    disparity, calibration, mask, max_depth
        As `phasestereo.point_cloud` takes them.
    image
        What is on the surface, as `point_cloud` takes it; None: the left image of the result's
        pair, if it is known.
    max_step
        By how many pixels the disparities of four neighbors may differ that are joined, more than
        0: where they differ by more, one surface ends and another begins.

    Returns
    -------
    Mesh
        Two triangles for each four neighboring pixels that have a depth and are of one surface.

    Raises
    ------
    TypeError, ValueError
        As `point_cloud`; also if max_step is not positive.
    """
    values = as_map(disparity)
    check_calibration(calibration, values.shape)
    depth = calibration.depth(values)
    wanted = np.isfinite(depth)
    if max_depth is not None:
        wanted &= depth <= as_number("max_depth", max_depth, positive=True)
    valid = as_mask(mask, values.shape, "mask")
    if valid is not None:
        wanted &= valid
    points, wanted = triangulated(depth, wanted, calibration)
    if image is None and isinstance(disparity, Result) and disparity.pair is not None:
        image = disparity.pair[0]
    faces = _faces(values, wanted, as_number("max_step", max_step, positive=True))
    rows, cols = np.nonzero(wanted)
    pixels = np.stack([cols, rows], axis=1).astype(np.float32)
    return Mesh(points, faces, pixels, None if image is None else _picture(image, values.shape))


def _faces(values: NDArray[Any], wanted: NDArray[np.bool_], step: float) -> NDArray[np.int64]:
    """Return the triangles between the wanted pixels, numbered row by row."""
    number = np.cumsum(wanted).reshape(wanted.shape) - 1
    corners = [
        (slice(None, -1), slice(None, -1)),
        (slice(None, -1), slice(1, None)),
        (slice(1, None), slice(None, -1)),
        (slice(1, None), slice(1, None)),
    ]
    there = np.logical_and.reduce([wanted[corner] for corner in corners])
    four = np.where(wanted, values, 0)
    parts = [four[corner] for corner in corners]
    joined = there & (np.maximum.reduce(parts) - np.minimum.reduce(parts) <= step)
    a, b, c, d = (number[corner][joined] for corner in corners)
    return np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])


def _picture(image: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    pixels = as_pixels(image, "image")
    if pixels.shape[:2] != shape:
        raise ValueError(f"image: got {pixels.shape[:2]} pixels; accepts the map's {shape}")
    return as_rgb8(pixels)

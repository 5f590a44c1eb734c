"""Disparities and a calibration in, points in space out, with the ends of their error bars."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._images import as_mask, as_pixels, as_rgb8
from phasestereo._numbers import as_number
from phasestereo.io import Calibration
from phasestereo.result import Result
from phasestereo.shapes import PointCloud
from phasestereo.views.depths import YAW, Anchor, as_disparities, as_uncertainty, ranging


def point_cloud(
    disparity: Result | ArrayLike,
    calibration: Calibration,
    *,
    image: ArrayLike | None = None,
    mask: ArrayLike | None = None,
    max_depth: float | None = None,
    yaw: float = YAW,
    anchor: Anchor | None = None,
) -> PointCloud:
    """Turn a disparity map into points in space.

    Parameters
    ----------
    disparity
        A `Result`, or disparities (H, W), real numbers in pixels; NaN where there is no estimate.
    calibration
        The geometry of the pair, of the map's size.
    image
        What the colors are taken from: (H, W) gray, (H, W, 3) RGB or (H, W, 4) RGBA, as `match`
        takes it. uint8 stays as it is; uint16 is shifted down from as many bits as the image uses;
        floats are stretched to what they span, but for 0.1 % of the pixels at either end. None:
        the left image of the result's pair; there are no colors where that is not known.
    mask
        bool (H, W), True = wanted; None: all are. ``result.flags == 0`` leaves out everything that
        was filled in or is not to be trusted.
    max_depth
        Largest depth that is wanted, in the unit of the baseline; None: any.
    yaw, anchor
        How exact the geometry is, as `depth_interval` takes them.

    Returns
    -------
    PointCloud
        One point for each pixel that is wanted and has a depth, row by row from the top left; with
        the ends of its error bar if the result has error bars.
        Pixels without an estimate, and those with d + doffs <= 0, have none.

    Raises
    ------
    TypeError
        If an argument is of a wrong type or dtype.
    ValueError
        If shapes differ from each other or from the calibration's, max_depth is not positive, or
        as `depth_interval`.

    Notes
    -----
    The left pixel (x, y) becomes Z = baseline * fx / (d + doffs), X = (x - cx) * Z / fx and
    Y = (y - cy) * Z / fy: to the precision of float32 what ``cv2.reprojectImageTo3D`` makes of it
    with `Calibration.q`.
    """
    found = triangulate(
        disparity,
        calibration,
        image=image,
        mask=mask,
        max_depth=max_depth,
        yaw=yaw,
        anchor=anchor,
    )
    colors = None if found.picture is None else found.picture[found.kept]
    near, far = (None if end is None else end[found.kept] for end in found.ends)
    return PointCloud(found.points, colors, near, far)


class Triangulation(NamedTuple):
    """The points of a map, (N, 3); the map, the pixels that became points, picture, ends."""

    points: NDArray[np.float32]
    disparity: NDArray[Any]
    kept: NDArray[np.bool_]
    picture: NDArray[np.uint8] | None
    ends: tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]


def triangulate(
    disparity: Result | ArrayLike,
    calibration: Calibration,
    *,
    image: ArrayLike | None,
    mask: ArrayLike | None,
    max_depth: float | None,
    yaw: float,
    anchor: Anchor | None,
) -> Triangulation:
    """Return the points of all pixels that are wanted and have a depth; see `point_cloud`."""
    values = as_disparities(disparity)
    bars = as_uncertainty(disparity, None, values.shape)
    geometry = ranging(values, calibration, uncertainty=bars, yaw=yaw, anchor=anchor)

    near = far = None
    if bars is None:
        depth = geometry.calibration.depth(values)
    else:
        depth, near, far = geometry.interval(values, bars, np.arange(values.shape[1]))
    wanted = np.isfinite(depth)
    if max_depth is not None:
        wanted &= depth <= as_number("max_depth", max_depth, positive=True)  # false for NaN
    valid = as_mask(mask, values.shape, "mask")
    if valid is not None:
        wanted &= valid

    if image is None and isinstance(disparity, Result) and disparity.pair is not None:
        image = disparity.pair[0]
    picture = None if image is None else _picture(image, values.shape)
    points, kept = _points(depth, wanted, calibration)
    return Triangulation(points, values, kept, picture, (near, far))


def _points(
    depth: NDArray[np.float32], wanted: NDArray[np.bool_], calibration: Calibration
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return the points of the wanted pixels, and which of these have finite coordinates."""
    (fx, _, cx), (_, fy, cy), _ = calibration.cam0
    rows, cols = np.nonzero(wanted)
    z = depth[wanted].astype(np.float64)
    points = np.empty((len(z), 3), dtype=np.float32)
    with np.errstate(over="ignore"):  # beyond float32 is infinitely far, and left out
        points[:, 0] = (cols - cx) * z / fx
        points[:, 1] = (rows - cy) * z / fy
    points[:, 2] = z

    finite = np.isfinite(points).all(axis=1)
    kept = wanted.copy()
    kept[wanted] = finite
    return points[finite], kept


def _picture(image: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    pixels = as_pixels(image, "image")
    if pixels.shape[:2] != shape:
        raise ValueError(f"image: got {pixels.shape[:2]} pixels; accepts the map's {shape}")
    return as_rgb8(pixels)

"""Points in space from disparities and a calibration, with the ends of their error bars."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._images import as_pixels, as_rgb8
from phasestereo.io import Calibration
from phasestereo.result import Keep, Result
from phasestereo.shapes import PointCloud
from phasestereo.views.depths import (
    YAW,
    Anchor,
    Depths,
    Selection,
    as_disparities,
    as_uncertainty,
    depths_of,
    ranging,
)

_BAND = 64  # rows to compute at a time


def point_cloud(
    disparity: Result | ArrayLike,
    calibration: Calibration,
    *,
    image: ArrayLike | None = None,
    mask: ArrayLike | None = None,
    keep: Keep = "trusted",
    min_depth: float | None = None,
    max_depth: float | None = None,
    decimate: int = 1,
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
        The image with the colors: (H, W) gray, (H, W, 3) RGB or (H, W, 4) RGBA, as `match` takes
        it. uint8 stays as it is; uint16 is shifted down from the number of bits the image uses;
        floats are stretched from their range without 0.1 % of the pixels at either end. None: the
        left image of the result's pair; if that is not known, the points have no colors.
    mask
        bool (H, W), True = wanted; None: all are.
    keep, min_depth, max_depth, decimate
        Which pixels become points, as `depth_interval` takes them: by default, the trusted ones of
        a result.
    yaw, anchor
        The accuracy of the geometry, as `depth_interval` takes them.

    Returns
    -------
    PointCloud
        One point for each wanted pixel with a depth, row by row from the top left; with the ends of
        its error bar if the result has error bars.
        Pixels without an estimate, and those with d + doffs <= 0, become no point.

    Raises
    ------
    TypeError
        If an argument is of a wrong type or dtype.
    ValueError
        If shapes differ from each other or from the calibration's, a number is out of range, or as
        `depth_interval`.

    Notes
    -----
    The left pixel (x, y) becomes Z = baseline * fx / (d + doffs), X = (x - cx) * Z / fx and
    Y = (y - cy) * Z / fy: to the precision of float32 the same as ``cv2.reprojectImageTo3D`` with
    `Calibration.q`.

    Examples
    --------
    >>> cloud = ps.point_cloud(result, calibration, keep="checked", max_depth=5000)
    """
    found = triangulate(
        disparity,
        calibration,
        Selection(keep=keep, min_depth=min_depth, max_depth=max_depth, decimate=decimate),
        image=image,
        mask=mask,
        yaw=yaw,
        anchor=anchor,
    )
    made = found.depths
    colors = None if found.picture is None else made.picked(found.picture)[found.kept]
    near, far = (None if end is None else end[found.kept] for end in (made.near, made.far))
    return PointCloud(found.points, colors, near, far)


class Triangulation(NamedTuple):
    """The points of a map, (N, 3), the pixels that became points, the left image, the depths."""

    points: NDArray[np.float32]
    kept: NDArray[np.bool_]
    picture: NDArray[np.uint8] | None
    depths: Depths


def triangulate(
    disparity: Result | ArrayLike,
    calibration: Calibration,
    selection: Selection,
    *,
    image: ArrayLike | None,
    mask: ArrayLike | None,
    yaw: float,
    anchor: Anchor | None,
) -> Triangulation:
    """Return the points of all wanted pixels with a depth; see `point_cloud`."""
    values = as_disparities(disparity)
    bars = as_uncertainty(disparity, None, values.shape)
    geometry = ranging(values, calibration, uncertainty=bars, yaw=yaw, anchor=anchor)

    found = depths_of(disparity, geometry, selection, uncertainty=bars, mask=mask)

    if image is None and isinstance(disparity, Result) and disparity.pair is not None:
        image = disparity.pair[0]
    picture = None if image is None else _picture(image, values.shape)
    return Triangulation(*_points(found.depth, found.calibration), picture, found)


def _points(
    depth: NDArray[np.float32], calibration: Calibration
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return the points of the pixels with a depth, and a mask of those with finite coordinates."""
    (fx, _, cx), (_, fy, cy), _ = calibration.cam0
    kept = np.isfinite(depth)
    points = np.empty((np.count_nonzero(kept), 3), dtype=np.float32)
    end = 0
    for top in range(0, len(depth), _BAND):
        rows, cols = np.nonzero(kept[top : top + _BAND])
        z = depth[top + rows, cols].astype(np.float64)
        start, end = end, end + len(z)
        with np.errstate(over="ignore"):  # beyond float32 is infinitely far, and left out
            points[start:end, 0] = (cols - cx) * z / fx
            points[start:end, 1] = (top + rows - cy) * z / fy
        points[start:end, 2] = z

    finite = np.isfinite(points).all(axis=1)
    kept[kept] = finite
    return (points if finite.all() else points[finite]), kept


def _picture(image: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    pixels = as_pixels(image, "image")
    if pixels.shape[:2] != shape:
        raise ValueError(f"image: got {pixels.shape[:2]} pixels; accepts the map's {shape}")
    return as_rgb8(pixels)

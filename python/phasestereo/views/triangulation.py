"""Disparities and a calibration in, points in space out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasestereo._images import as_array, as_mask, as_pixels, as_rgb8
from phasestereo._numbers import as_number
from phasestereo.result import Result

if TYPE_CHECKING:
    from typing import Any

    from numpy.typing import ArrayLike, NDArray

    from phasestereo.io import Calibration


@dataclass(frozen=True, slots=True, eq=False)
class PointCloud:
    """Points in the frame of the left camera: X to the right, Y down, Z forward.

    Parameters
    ----------
    points
        float32 (N, 3), finite: X, Y, Z in the unit of the baseline.
    colors
        uint8 (N, 3), RGB; None: the points have no colors.

    Raises
    ------
    TypeError
        If an array is not of its type.
    ValueError
        If an array is not of its shape, or a coordinate is not finite.
    """

    points: NDArray[np.float32]
    colors: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        """Refuse what no file of points could hold."""
        _check_rows("points", self.points, np.float32)
        if not np.isfinite(self.points).all():
            raise ValueError("points: got infinity or NaN; accepts finite coordinates")
        if self.colors is None:
            return

        _check_rows("colors", self.colors, np.uint8)
        if len(self.colors) != len(self.points):
            got, wanted = len(self.colors), len(self.points)
            raise ValueError(f"colors: got {got} of {wanted} points; accepts one each")

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.points)

    def __repr__(self) -> str:
        """Show the number of points and how far away they are: arrays would say nothing."""
        depth = self.points[:, 2]
        span = f", depth {depth.min():.5g} to {depth.max():.5g}" if len(self) else ""
        return f"<PointCloud {len(self)} points{span}{'' if self.colors is None else ', colored'}>"


def point_cloud(
    disparity: Result | ArrayLike,
    calibration: Calibration,
    *,
    image: ArrayLike | None = None,
    mask: ArrayLike | None = None,
    max_depth: float | None = None,
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

    Returns
    -------
    PointCloud
        One point for each pixel that is wanted and has a depth, row by row from the top left.
        Pixels without an estimate, and those with d + doffs <= 0, have none.

    Raises
    ------
    TypeError
        If an argument is of a wrong type or dtype.
    ValueError
        If shapes differ from each other or from the calibration's, or max_depth is not positive.

    Notes
    -----
    The left pixel (x, y) becomes Z = baseline * fx / (d + doffs), X = (x - cx) * Z / fx and
    Y = (y - cy) * Z / fy: to the precision of float32 what ``cv2.reprojectImageTo3D`` makes of it
    with `Calibration.q`.
    """
    found = triangulate(disparity, calibration, image=image, mask=mask, max_depth=max_depth)
    return PointCloud(found.points, None if found.picture is None else found.picture[found.kept])


class Triangulation(NamedTuple):
    """The points of a map, (N, 3); the map, the pixels that became points, and the picture."""

    points: NDArray[np.float32]
    disparity: NDArray[Any]
    kept: NDArray[np.bool_]
    picture: NDArray[np.uint8] | None


def triangulate(
    disparity: Result | ArrayLike,
    calibration: Calibration,
    *,
    image: ArrayLike | None,
    mask: ArrayLike | None,
    max_depth: float | None,
) -> Triangulation:
    """Return the points of all pixels that are wanted and have a depth; see `point_cloud`."""
    values = _disparities(disparity)
    _check_calibration(calibration, values.shape)

    depth = calibration.depth(values)
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
    return Triangulation(points, values, kept, picture)


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


def _disparities(disparity: Result | ArrayLike) -> NDArray[Any]:
    """Return the disparities of a result, or of what is a map itself."""
    given = disparity.disparity if isinstance(disparity, Result) else disparity
    values = as_array(given, "disparity")

    if values.dtype.kind not in "iuf":
        raise TypeError(f"disparity: got dtype {values.dtype}; accepts real numbers")
    if values.ndim != 2:
        raise ValueError(f"disparity: got shape {values.shape}; accepts (H, W)")

    return values


def _check_calibration(calibration: Calibration, shape: tuple[int, ...]) -> None:
    """Refuse what is no calibration, or one of another size."""
    from phasestereo.io import Calibration  # noqa: PLC0415 - `import phasestereo` reads no files

    if not isinstance(calibration, Calibration):
        got = type(calibration).__name__
        raise TypeError(f"calibration: got {got}; accepts a phasestereo.io.Calibration")
    calibration.check_size(shape)


def _picture(image: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    pixels = as_pixels(image, "image")
    if pixels.shape[:2] != shape:
        raise ValueError(f"image: got {pixels.shape[:2]} pixels; accepts the map's {shape}")
    return as_rgb8(pixels)


def _check_rows(name: str, rows: object, dtype: type) -> None:
    wanted = np.dtype(dtype)
    if not isinstance(rows, np.ndarray) or rows.dtype != wanted:
        got = getattr(rows, "dtype", type(rows).__name__)
        raise TypeError(f"{name}: got {got}; accepts an array of {wanted}")
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise ValueError(f"{name}: got shape {rows.shape}; accepts (N, 3)")

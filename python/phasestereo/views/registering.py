"""Depths in the frame of a third camera, as of a color camera beside the pair."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._extras import require
from phasestereo._images import Map, Mask
from phasestereo._numbers import as_integer
from phasestereo.io.calibration import Calibration
from phasestereo.io.depth import LengthUnit, meters_in
from phasestereo.io.rigs.cameras import INTRINSICS, POSE, Cameras, Matrix
from phasestereo.io.rigs.names import check_rotation
from phasestereo.io.rigs.reading import CalibrationSource
from phasestereo.rectification.reading import read_calibration
from phasestereo.rectification.record import Rectification
from phasestereo.result import Keep, Result
from phasestereo.views.depths import YAW, Anchor, Selection, depths_of, ranging

Boxes: TypeAlias = NDArray[np.int32]

_JOINED = 1.0  # pixels of disparity: neighbors that differ by more are of different surfaces
_LARGEST = 64  # pixels of the third camera that a pixel of the left one covers at most, either way
_SLACK = 1e-3  # pixels: neighbors share an edge, which rounding must not open
_GRID = 24  # rows and columns of pixels by which a rotation is found
_OFF = 2.0  # pixels: more than a calibration of the same left camera is off by
_FAR = 1e6  # pixels: beyond all images
_BAND = 64  # rows that are projected at a time
_RIM = 1.05  # of the widest angle that a distorted camera sees: polynomials turn back beyond it


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ThirdCamera:
    """A camera beside a rectified pair, and where it is.

    Parameters
    ----------
    matrix
        Intrinsics (3, 3), pixels.
    rotation, translation
        (3, 3) and (3,): ``rotation @ X + translation`` leads from the rectified left camera to this
        one.
    width, height
        Size of its images, pixels.
    distortion
        4, 5, 8, 12 or 14 numbers, as ``cv2.projectPoints`` takes them; of a fisheye camera 4.
    fisheye
        Whether the distortion is that of ``cv2.fisheye``.
    unit
        The unit of the translation; None: that of the pair's baseline.

    Raises
    ------
    TypeError
        If width or height is not an integer.
    ValueError
        If a matrix has another shape or numbers that are not finite, or the rotation is invalid.
    """

    matrix: Matrix
    rotation: Matrix
    translation: Matrix
    width: int
    height: int
    distortion: Matrix | None = None
    fisheye: bool = False
    unit: LengthUnit | None = None

    def __post_init__(self) -> None:
        """Refuse invalid cameras, and take array-like numbers."""
        for name, shape in (("matrix", (3, 3)), ("rotation", (3, 3)), ("translation", (3,))):
            given = np.asarray(getattr(self, name), np.float64)
            if given.size != np.prod(shape) or not np.isfinite(given).all():
                raise ValueError(f"{name}: got shape {given.shape}; accepts {shape}, finite")
            object.__setattr__(self, name, given.reshape(shape))
        check_rotation("rotation", self.rotation)
        for name in ("width", "height"):
            as_integer(name, getattr(self, name), least=1)
        lens = np.zeros(0) if self.distortion is None else np.ravel(self.distortion)
        object.__setattr__(self, "distortion", lens.astype(np.float64) if lens.any() else None)

    @classmethod
    def of_pair(
        cls,
        calibration: CalibrationSource | Cameras,
        *,
        rectification: Rectification | None = None,
        size: tuple[int, int] | None = None,
    ) -> Self:
        """Return the right camera of a calibration of the left and the third camera.

        Parameters
        ----------
        calibration
            As `phasestereo.rectify` takes it: a file of ``K1, D1, K2, D2, R, T``, a camchain of
            Kalibr's, matrices by name ...
        rectification
            How the left image was rectified, which turned its camera. None: it was not.
        size
            Columns and rows of the third camera's images. None: those of the calibration.

        Raises
        ------
        TypeError, ValueError, OSError, ImportError
            As `phasestereo.rectify` for the calibration; ValueError also if it says nothing of the
            size or the pose, or its left camera is not the one that was rectified.

        Notes
        -----
        The rotation of the rectified left camera follows from the maps of the rectification: the
        one that leads from the rays of its pixels to those of the pixels that they are read from
        (Kabsch, 1976).
        """
        cameras = read_calibration(calibration)
        if isinstance(cameras, Rectification) or not {*INTRINSICS, *POSE} <= {*cameras.matrices}:
            raise ValueError(
                "calibration: accepts K1, D1, K2, D2, R, T of the left and third camera"
            )
        cols, rows = size or cameras.size or (None, None)
        if cols is None or rows is None:
            raise ValueError("size: got None, and a calibration without one; accepts (cols, rows)")

        matrices = cameras.matrices
        rotation = matrices["R"]
        if rectification is not None:
            rotation = rotation @ _turned(rectification, cameras).T
        return cls(
            matrix=matrices["K2"],
            distortion=matrices["D2"],
            rotation=rotation,
            translation=matrices["T"].ravel(),
            width=cols,
            height=rows,
            fisheye=cameras.fisheye,
            unit=cameras.unit,
        )

    def project(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return column, row and depth, (N, 3), of points (N, 3) of the rectified left camera.

        Columns and rows are NaN of what is behind the camera, or beyond what its lens sees.
        """
        seen = points @ self.rotation.T + self.translation
        ahead = seen[:, 2] > 0
        z = np.where(ahead, seen[:, 2], np.nan)
        flat = seen[:, :2] / z[:, np.newaxis]
        if self.distortion is None:
            found = flat * np.diag(self.matrix)[:2] + self.matrix[:2, 2]
        else:
            flat[~(np.hypot(*flat.T) <= self._rim())] = np.nan
            found = _pixels(flat, self.matrix, self.distortion, fisheye=self.fisheye)
        return np.column_stack([found, seen[:, 2]])

    def rays(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the rays (N, 3), of depth 1 in this camera, of pixels (N, 2)."""
        if self.distortion is None:
            flat = (pixels - self.matrix[:2, 2]) / np.diag(self.matrix)[:2]
        else:
            flat = _undistorted(pixels, self.matrix, self.distortion, fisheye=self.fisheye)
        return np.column_stack([flat, np.ones(len(flat))])

    def _rim(self) -> float:
        """Return the tangent of the widest angle from the axis that is in the image."""
        x, y = np.arange(-1.0, self.width + 1), np.arange(-1.0, self.height + 1)
        sides = [(x, np.full_like(x, end)) for end in (y[0], y[-1])]
        sides += [(np.full_like(y, end), y) for end in (x[0], x[-1])]
        rim = np.concatenate([np.column_stack(side) for side in sides])
        return _RIM * float(np.nanmax(np.hypot(*self.rays(rim)[:, :2].T)))


@dataclass(frozen=True, slots=True, eq=False)
class Registered:
    """Depths as a third camera sees them, each (H, W) of its size.

    Parameters
    ----------
    depth
        float32, in the unit of the baseline, along its own axis; NaN elsewhere.
    near, far
        The depths at the ends of the error bars, as `DepthInterval` has them; None: there are none.
    confidence
        float32, that of the disparity; NaN without a depth. None: not estimated.
    holes
        bool: no depth, though the left camera sees what is there: its estimate is missing, or not
        kept. About where the background beside would be.
    occluded
        bool: no depth, for something hides from the left camera what is there. What is neither, and
        has no depth, is outside the left image.
    source
        int64: the pixel of the left image, as an index into the flat map; -1 elsewhere.
    """

    depth: Map
    near: Map | None
    far: Map | None
    confidence: Map | None
    holes: Mask
    occluded: Mask
    source: NDArray[np.int64]

    @property
    def maps(self) -> dict[str, NDArray[Any]]:
        """The maps that there are but `source`, by their names."""
        names = "depth", "near", "far", "confidence", "holes", "occluded"
        found = {name: getattr(self, name) for name in names}
        return {name: values for name, values in found.items() if values is not None}

    def picked(self, values: NDArray[Any], missing: float = np.nan) -> NDArray[Any]:
        """Return a map (H, W) of the left image as the third camera sees it."""
        return np.where(self.source >= 0, values.ravel()[np.maximum(self.source, 0)], missing)


def register(
    result: Result | ArrayLike,
    calibration: Calibration,
    camera: ThirdCamera,
    *,
    keep: Keep = "trusted",
    min_depth: float | None = None,
    max_depth: float | None = None,
    yaw: float = YAW,
    anchor: Anchor | None = None,
) -> Registered:
    """Return depths, confidences and error bars in the frame of a third camera.

    Parameters
    ----------
    result
        A `Result`, or disparities (H, W), pixels; NaN where there is no estimate.
    calibration
        The geometry of the pair, of the map's size.
    camera
        The third camera.
    keep, min_depth, max_depth, yaw, anchor
        As `depth_interval` takes them: depths are those from the left camera.

    Returns
    -------
    Registered
        Maps of the third camera's size.

    Raises
    ------
    TypeError, ValueError
        As `depth_interval`.
    ImportError
        If the camera has a distortion and OpenCV (the extra ``rectify``) is not installed.

    Notes
    -----
    A pixel of the left image covers the pixels of the third camera up to half the way to its
    neighbors on the same surface, at most 64 either way; of several the nearest wins.

    Examples
    --------
    >>> color = ps.ThirdCamera.of_pair("left_color.yaml", rectification=rectified)
    >>> depth = ps.register(result, calibration, color).depth
    """
    if camera.unit and calibration.unit:
        scale = meters_in(camera.unit) / meters_in(calibration.unit)
        camera = replace(camera, translation=camera.translation * scale, unit=calibration.unit)
    values = np.asarray(result.disparity if isinstance(result, Result) else result)
    bars = result.uncertainty if isinstance(result, Result) else None
    geometry = ranging(values, calibration, uncertainty=bars, yaw=yaw, anchor=anchor)
    selection = Selection(keep=keep, min_depth=min_depth, max_depth=max_depth)
    found = depths_of(result, geometry, selection)
    rig = found.calibration

    # What has no depth is drawn as the background beside it, to see where it may be.
    there = np.isfinite(found.depth)
    boxes, seen = _footprints(_background(found.depth), rig, camera)
    source, z = _nearest(boxes, seen, there, camera)
    known = source >= 0
    depth = np.where(known, z, np.nan).astype(np.float32)
    ends = [
        None if end is None else _moved(end.ravel()[source], source, rig, camera, known)
        for end in (found.near, found.far)
    ]
    sure = None
    if isinstance(result, Result) and result.confidence is not None:
        sure = np.where(known, result.confidence.ravel()[source], np.float32(np.nan))

    holes = ~known & (_nearest(boxes, seen, ~there, camera)[0] >= 0)
    occluded = _in_view(~known & ~holes, depth, rig, camera)
    return Registered(depth, ends[0], ends[1], sure, holes, occluded, source)


def _footprints(depth: Map, rig: Calibration, camera: ThirdCamera) -> tuple[Boxes, Map]:
    """Return the area that each left pixel covers in the third camera, and its depth there.

    Boxes are int32 (4, H, W): left, top, and the first column and row beyond; depths are float32,
    NaN of what the camera does not see.
    """
    rows, cols = depth.shape
    boxes, seen = np.empty((4, rows, cols), np.int32), np.empty((rows, cols), np.float32)
    for top in range(0, rows, _BAND):
        start, stop = max(top - 1, 0), min(top + _BAND + 1, rows)  # with the neighbors' rows
        band = depth[start:stop]
        pixels = np.arange(start * cols, stop * cols)
        points = _left_rays(pixels, rig) * band.reshape(-1, 1).astype(np.float64)
        found = camera.project(points).reshape(*band.shape, 3)
        inner = slice(top - start, top - start + _BAND)
        boxes[:, top : top + _BAND] = _boxes(found, band, rig, camera)[:, inner]
        there = np.isfinite(found[inner, :, 0])
        seen[top : top + _BAND] = np.where(there, found[inner, :, 2], np.nan)
    return boxes, seen


def _nearest(
    boxes: Boxes, seen: Map, chosen: Mask, camera: ThirdCamera
) -> tuple[NDArray[np.int64], Map]:
    """Return of each pixel of the third camera which of the chosen left ones it sees; its depth.

    It is -1 elsewhere.
    """
    size = camera.height * camera.width
    source, z_buffer = np.full(size, -1, np.int64), np.full(size, np.inf, np.float32)
    pixels = np.flatnonzero(chosen & np.isfinite(seen))
    # Far ones first: of several that are assigned to one place, NumPy keeps the last.
    pixels = pixels[np.argsort(-seen.ravel()[pixels], kind="stable")]
    left, top, right, bottom = (side.ravel()[pixels] for side in boxes)
    z = seen.ravel()[pixels]
    for down in range(_LARGEST):
        rows = top + down
        high = (rows < bottom) & (rows >= 0) & (rows < camera.height)
        if not (top + down < bottom).any():
            break
        for across in range(_LARGEST):
            cols = left + across
            inside = high & (cols < right) & (cols >= 0) & (cols < camera.width)
            if not (high & (cols < right)).any():
                break
            one = np.flatnonzero(inside)
            place = rows[one] * camera.width + cols[one]
            nearer = z[one] < z_buffer[place]
            one, place = one[nearer], place[nearer]
            z_buffer[place], source[place] = z[one], pixels[one]
    shape = camera.height, camera.width
    return source.reshape(shape), z_buffer.reshape(shape)


def _boxes(seen: NDArray[np.float64], depth: Map, rig: Calibration, camera: ThirdCamera) -> Boxes:
    """Return the columns and rows that each pixel covers, as `_footprints` has them."""
    with np.errstate(invalid="ignore"):
        shift = rig.focal * rig.baseline / depth.astype(np.float64)
        grown = np.diag(camera.matrix)[:2] / rig.focal * (depth / seen[..., 2])[..., np.newaxis] / 2
    corner = np.zeros((*depth.shape, 2)), np.zeros((*depth.shape, 2))
    for axis in (1, 0):
        step = np.diff(seen[..., :2], axis=axis) / 2
        step[~(np.abs(np.diff(shift, axis=axis)) <= _JOINED)] = np.nan
        pad = [(0, 0)] * 3
        pad[axis] = 0, 1
        after = np.pad(step, pad, constant_values=np.nan)
        before = np.roll(after, 1, axis=axis)
        # Where a surface ends, a pixel is as large as towards its other side, or as it is far.
        plain = grown * camera.rotation[:2, 1 - axis]
        after, before = (
            np.where(np.isnan(one), np.where(np.isnan(other), plain, other), one)
            for one, other in ((after, before), (before, after))
        )
        np.minimum(corner[0], np.minimum(after, -before), out=corner[0])
        np.maximum(corner[1], np.maximum(after, -before), out=corner[1])

    centers = np.nan_to_num(seen[..., :2], nan=-_FAR)
    low = np.ceil(centers + np.nan_to_num(corner[0]) - _SLACK)
    high = np.ceil(centers + np.nan_to_num(corner[1]) - _SLACK)
    none = high <= low  # smaller than a pixel: the one that it is in
    low = np.where(none, np.rint(centers), low)
    high = np.where(none, low + 1, high)
    both = np.concatenate([low, high], axis=2)
    found: Boxes = np.moveaxis(np.clip(both, -_FAR, _FAR), 2, 0).astype(np.int32)
    return found


def _left_rays(pixels: NDArray[np.intp], rig: Calibration) -> NDArray[np.float64]:
    (fx, _, cx), (_, fy, cy), _ = rig.cam0
    rows, cols = np.divmod(pixels, rig.width)
    return np.column_stack([(cols - cx) / fx, (rows - cy) / fy, np.ones(len(pixels))])


def _moved(
    depth: Map, source: NDArray[np.int64], rig: Calibration, camera: ThirdCamera, known: Mask
) -> Map:
    """Return depths along rays of the left camera as depths of the third one; NaN elsewhere."""
    found = np.full(known.shape, np.nan, np.float32)
    along = _left_rays(source[known], rig) @ camera.rotation[2]
    found[known] = along * depth[known] + camera.translation[2]
    return found


def _background(depth: Map) -> Map:
    """Return depths with holes as deep as the farther side of each, along rows, then columns."""
    found = depth
    for turned in (False, True):
        lines = found.T if turned else found
        places = np.arange(lines.shape[1])
        there = np.isfinite(lines)
        before = np.maximum.accumulate(np.where(there, places, -1), axis=1)
        after = np.minimum.accumulate(np.where(there, places, len(places))[:, ::-1], axis=1)[
            :, ::-1
        ]
        sides = [
            np.where(
                (place >= 0) & (place < len(places)),
                np.take_along_axis(lines, np.clip(place, 0, len(places) - 1), 1),
                np.nan,
            )
            for place in (before, after)
        ]
        lines = np.where(there, lines, np.fmax(*sides)).astype(np.float32)
        found = lines.T if turned else lines
    return found


def _in_view(missing: Mask, depth: Map, rig: Calibration, camera: ThirdCamera) -> Mask:
    """Return the pixels without depth that the left image shows, at their neighbors' depth."""
    places = np.argwhere(missing)
    z = _background(depth)[missing].astype(np.float64)[:, np.newaxis]
    rays = camera.rays(places[:, ::-1].astype(np.float64))
    points = (rays * z - camera.translation) @ camera.rotation
    (fx, _, cx), (_, fy, cy), _ = rig.cam0
    ahead = np.where(points[:, 2] > 0, points[:, 2], np.nan)
    x, y = points[:, 0] / ahead * fx + cx, points[:, 1] / ahead * fy + cy
    inside = (x >= -0.5) & (x <= rig.width - 0.5) & (y >= -0.5) & (y <= rig.height - 0.5)
    found = np.zeros(missing.shape, np.bool_)
    found[missing] = inside  # false for NaN
    return found


def _turned(rectification: Rectification, cameras: Cameras) -> Matrix:
    """Return the rotation from the left camera as it is to the rectified one."""
    q, (x, y) = rectification.Q, rectification.maps[0]
    if q is None:
        raise ValueError("rectification: knows no Q; accepts one by a calibration")
    rows, cols = (np.linspace(0, side - 1, min(_GRID, side)).astype(int) for side in x.shape)
    grid = np.ix_(rows, cols)
    inside = rectification.left_mask[grid].ravel()
    read = np.column_stack([x[grid].ravel(), y[grid].ravel()])[inside].astype(np.float64)
    row, col = (part.ravel()[inside] for part in np.meshgrid(rows, cols, indexing="ij"))

    scale = q[1, 1]  # of the second row of Q, which may be that of another focal length
    focal = q[2, 3]
    wanted = np.column_stack(
        [(col + q[0, 3]) / focal, (row * scale + q[1, 3]) / focal, np.ones(len(col))]
    )
    matrices = cameras.matrices
    flat = _undistorted(read, matrices["K1"], matrices["D1"], fisheye=cameras.fisheye)
    given = np.column_stack([flat, np.ones(len(flat))])
    wanted, given = (rays / np.linalg.norm(rays, axis=1)[:, np.newaxis] for rays in (wanted, given))
    u, _, v = np.linalg.svd(wanted.T @ given)
    found: Matrix = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
    off = focal * float(np.sqrt(np.mean(np.sum((wanted - given @ found.T) ** 2, axis=1))))
    if not off <= _OFF:
        raise ValueError(
            f"calibration: its left camera is not the one that was rectified: {off:.1f} px apart"
        )
    return found


def _pixels(
    flat: NDArray[np.float64], matrix: Matrix, lens: Matrix, *, fisheye: bool
) -> NDArray[np.float64]:
    """Return the pixels of rays of depth 1, given by x and y, in a distorted camera, (N, 2)."""
    cv2 = require("cv2", extra="rectify")
    known = np.isfinite(flat).all(axis=1)
    found = np.full(flat.shape, np.nan)
    if known.any():
        rays, none = (
            np.column_stack([flat[known], np.ones(known.sum())])[:, np.newaxis],
            np.zeros(3),
        )
        if fisheye:
            found[known] = cv2.fisheye.projectPoints(rays, none, none, matrix, lens)[0][:, 0]
        else:
            found[known] = cv2.projectPoints(rays, none, none, matrix, lens)[0][:, 0]
    return found


def _undistorted(
    pixels: NDArray[np.float64], matrix: Matrix, lens: Matrix, *, fisheye: bool
) -> NDArray[np.float64]:
    """Return x and y of the rays of depth 1 of pixels of a distorted camera, (N, 2)."""
    if not len(pixels):
        return np.empty((0, 2))
    cv2 = require("cv2", extra="rectify")
    model = cv2.fisheye if fisheye else cv2
    found: NDArray[np.float64] = model.undistortPoints(pixels[:, np.newaxis], matrix, lens)[:, 0]
    return found

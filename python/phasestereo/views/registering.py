"""Depths in the frame of a third camera, such as a color camera beside the pair."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo import _core
from phasestereo._images import Map, Mask
from phasestereo._numbers import as_integer
from phasestereo.io.calibration import Calibration
from phasestereo.io.depth import LengthUnit, meters_in
from phasestereo.io.rigs.cameras import INTRINSICS, POSE, Cameras, Matrix
from phasestereo.io.rigs.names import check_rotation
from phasestereo.io.rigs.reading import CalibrationSource
from phasestereo.rectification.record import Rectification, read_calibration
from phasestereo.result import Keep, Result
from phasestereo.views.depths import YAW, Anchor, Selection, depths_of, ranging

_GRID = 24  # rows and columns of pixels that determine a rotation
_OFF = 2.0  # pixels: more than the error of a calibration of the same left camera


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ThirdCamera:
    """A camera beside a rectified pair, and where it is.

    Parameters
    ----------
    matrix
        Intrinsics (3, 3), pixels.
    rotation, translation
        (3, 3) and (3,): ``rotation @ X + translation`` maps points from the rectified left camera
        to this one.
    width, height
        Size of its images, pixels.
    distortion
        4, 5, 8, 12 or 14 numbers, as ``cv2.projectPoints`` takes them; for a fisheye camera 4.
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

    Examples
    --------
    >>> color = ps.ThirdCamera(
    ...     matrix=np.array([[400.0, 0, 239.5], [0, 400, 179.5], [0, 0, 1]]),
    ...     rotation=np.eye(3),
    ...     translation=np.array([15.0, 0, 0]),
    ...     width=480,
    ...     height=360,
    ... )
    >>> ps.register(result, calibration, color).depth
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
            The rectification of the left image, which turned its camera. None: not rectified.
        size
            Columns and rows of the third camera's images. None: those of the calibration.

        Raises
        ------
        TypeError, ValueError, OSError, ImportError
            As `phasestereo.rectify` for the calibration; ValueError also if it does not give the
            size or the pose, or its left camera is not the rectified one.

        Notes
        -----
        The rotation of the rectified left camera follows from the maps of the rectification: it
        turns the rays of its pixels into the rays of their source pixels (Kabsch, 1976).
        """
        cameras = read_calibration(calibration)
        if isinstance(cameras, Rectification) or not {*INTRINSICS, *POSE} <= {*cameras.matrices}:
            raise ValueError(
                "calibration: accepts K1, D1, K2, D2, R, T of the left and third camera"
            )
        cols, rows = size or cameras.right_size or cameras.size or (None, None)
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


@dataclass(frozen=True, slots=True, eq=False)
class Registered:
    """Depths as a third camera sees them, each (H, W) of its size.

    Parameters
    ----------
    depth
        float32, in the unit of the baseline, along its own axis; NaN elsewhere.
    near, far
        The depths at the ends of the error bars, as in `DepthInterval`; None: no error bars.
    confidence
        float32, that of the disparity; NaN without a depth. None: not estimated.
    holes
        bool: no depth although the left camera sees this place: its estimate is missing, or not
        kept. The position assumes the depth of the background beside it.
    occluded
        bool: no depth because something hides this place from the left camera. All other pixels
        without a depth are outside the left image.
    source
        int64: the pixel of the left image, as an index into the flat map; -1 elsewhere.

    Examples
    --------
    >>> color = ps.ThirdCamera(
    ...     matrix=np.array([[400.0, 0, 239.5], [0, 400, 179.5], [0, 0, 1]]),
    ...     rotation=np.eye(3),
    ...     translation=np.array([15.0, 0, 0]),
    ...     width=480,
    ...     height=360,
    ... )
    >>> found = ps.register(result, calibration, color)
    >>> found.depth, found.holes, found.occluded  # (360, 480)
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
        """All available maps except `source`, by name."""
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

    Notes
    -----
    A pixel of the left image covers the pixels of the third camera up to halfway to its neighbors
    on the same surface, at most 64 either way; where several overlap, the nearest wins.

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

    lens = [] if camera.distortion is None else camera.distortion.tolist()
    (fx, _, cx), (_, fy, cy), _ = rig.cam0
    source, depth, holes, occluded, moved = _core.register_depths(
        found.depth,
        [end for end in (found.near, found.far) if end is not None],
        ((fx, fy), (cx, cy), rig.baseline),
        (camera.matrix, lens, camera.fisheye),
        (camera.rotation, camera.translation),
        (camera.height, camera.width),
    )
    near, far = moved or (None, None)
    made = Registered(depth, near, far, None, holes, occluded, source)
    if isinstance(result, Result) and result.confidence is not None:
        made = replace(made, confidence=made.picked(result.confidence).astype(np.float32))
    return made


def _turned(rectification: Rectification, cameras: Cameras) -> Matrix:
    """Return the rotation from the original left camera to the rectified one."""
    q, (x, y) = rectification.Q, rectification.maps[0]
    if q is None:
        raise ValueError("rectification: knows no Q; accepts one by a calibration")
    rows, cols = (np.linspace(0, side - 1, min(_GRID, side)).astype(int) for side in x.shape)
    grid = np.ix_(rows, cols)
    inside = rectification.left_mask[grid].ravel()
    read = np.column_stack([x[grid].ravel(), y[grid].ravel()])[inside].astype(np.float64)
    row, col = (part.ravel()[inside] for part in np.meshgrid(rows, cols, indexing="ij"))

    scale = q[1, 1]  # of the second row of Q, which may be for another focal length
    focal = q[2, 3]
    wanted = np.column_stack(
        [(col + q[0, 3]) / focal, (row * scale + q[1, 3]) / focal, np.ones(len(col))]
    )
    matrices = cameras.matrices
    lens = matrices["K1"], matrices["D1"].ravel().tolist(), cameras.fisheye
    flat = _core.rays_of_pixels(read, lens)
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

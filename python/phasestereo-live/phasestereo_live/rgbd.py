"""Folders of images and depths for mapping and reconstruction: TUM, nerfstudio, COLMAP.

The left camera is rectified: it has no distortion. Depths and poses are in m.
"""

from __future__ import annotations

import errno
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._extras import require
from phasestereo._images import Map, as_pixels, as_rgb8
from phasestereo._numbers import accept
from phasestereo.io import Calibration, write_depth, write_image
from phasestereo.io.colmap import write_colmap
from phasestereo.io.depth import MILLIMETERS, meters_in
from phasestereo.io.drafts import replace_text
from phasestereo.io.files import StrPath
from phasestereo.views.depths import YAW, Selection, depths_of, ranging
from phasestereo_live._closing import Closing
from phasestereo_live.video.streaming import Frame

__all__ = ["LAYOUTS", "RgbdLayout", "RgbdWriter", "normal_map"]

RgbdLayout: TypeAlias = Literal["tum", "nerfstudio", "colmap"]
"""The names of the files, and the lists beside them."""

LAYOUTS: tuple[RgbdLayout, ...] = get_args(RgbdLayout)

_TUM = 5000.0  # units of depth in a meter
_HALF = 0.5  # pixels: COLMAP and nerfstudio count from the corner of the first pixel
_RADIUS = 2  # pixels: a plane through 5 x 5 pixels gives the normal
_JOINED = 1.0  # pixels of disparity: neighbors that differ by more belong to another surface
_FEWEST = 6  # pixels of that surface
_TO_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])  # Y up, Z backward


@dataclass(frozen=True, slots=True, eq=False)
class _Shot:
    """A written frame: its name, time (s), pose and camera."""

    name: str
    time: float
    pose: NDArray[np.float64]
    camera: Calibration


class RgbdWriter(Closing):
    """Writes frames to a folder of images and depths.

    ``tum`` [1]_: ``rgb/`` and ``depth/`` (16 bits, 5000 units a meter), ``rgb.txt``, ``depth.txt``,
    ``associations.txt``, ``camera.txt`` (fx fy cx cy) and, with poses, ``groundtruth.txt``.
    ``nerfstudio`` [2]_: ``images/``, ``depth/`` (mm) and ``transforms.json``. ``colmap`` [3]_: a
    dense workspace, ``images/``, ``sparse/`` and ``stereo/`` with maps of depths and normals, for
    ``stereo_fusion``. `close` writes the lists, also when an error ends the ``with`` block.

    Parameters
    ----------
    folder
        The folder; the writer makes it. If it exists, it must be empty.
    layout
        One of `LAYOUTS`.

    Raises
    ------
    OSError
        If the folder cannot be made or is not empty.
    ValueError
        If the layout is unknown.

    References
    ----------
    .. [1] TUM RGB-D benchmark, file formats,
       https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats
    .. [2] nerfstudio, data conventions,
       https://docs.nerf.studio/quickstart/data_conventions.html
    .. [3] COLMAP, output format, https://colmap.github.io/format.html

    Examples
    --------
    >>> with RgbdWriter("office", "tum") as writer:
    ...     for frame in stream("left/", "right/"):
    ...         writer.write(frame, calibration)
    """

    def __init__(self, folder: StrPath, layout: RgbdLayout = "tum") -> None:
        accept("layout", layout, LAYOUTS)
        self._folder, self._layout = Path(folder), layout
        self._folder.mkdir(exist_ok=True)
        if any(self._folder.iterdir()):
            raise OSError(errno.ENOTEMPTY, "is not empty", str(folder))
        self._has_poses = False
        self._shots: list[_Shot] = []

    def write(
        self,
        frame: Frame,
        calibration: Calibration,
        *,
        selection: Selection | None = None,
        pose: ArrayLike | None = None,
        name: str | None = None,
    ) -> None:
        """Write a frame: the left image, its depths and, for COLMAP, its normals.

        Parameters
        ----------
        frame
            A frame of `phasestereo_live.stream`.
        calibration
            The geometry of the rectified pair; if it has no unit, m.
        selection
            The depths to keep, in the unit of the baseline; None: the trusted ones.
        pose
            (4, 4), from the rectified left camera to the world, in m. None: the camera does not
            move.
        name
            Name of the image without its suffix, for example from an existing COLMAP model. None:
            the time for TUM, else the number.

        Raises
        ------
        ValueError
            If the calibration is of another size, or the pose is invalid.
        OSError
            If a file cannot be written.
        """
        result, chosen = frame.result, selection or Selection()
        given = np.eye(4) if pose is None else np.asarray(pose, np.float64)
        if given.shape != (4, 4) or not np.isfinite(given).all():
            raise ValueError(f"pose: got shape {given.shape}; accepts (4, 4), finite")
        meters = meters_in(calibration.unit or "m")
        bars = result.uncertainty
        geometry = ranging(result.disparity, calibration, uncertainty=bars, yaw=YAW, anchor=None)
        found = depths_of(result, geometry, chosen)
        camera = found.calibration.in_meters()
        depth = found.depth * np.float32(meters)
        image = found.picked(as_rgb8(as_pixels(frame.left, "left")))

        time = float(frame.index if frame.time is None else frame.time)
        usual = f"{time:.6f}" if self._layout == "tum" else f"frame_{frame.index:05d}"
        shot = _Shot(name or usual, time, given, camera)
        self._has_poses |= pose is not None
        match self._layout:
            case "tum":
                write_image(self._place("rgb", f"{shot.name}.png"), image)
                self._write_png(shot, depth, _TUM)
            case "nerfstudio":
                write_image(self._place("images", f"{shot.name}.png"), image)
                self._write_png(shot, depth, MILLIMETERS)
            case "colmap":
                write_image(self._place("images", f"{shot.name}.png"), image)
                maps = {
                    "depth_maps": np.nan_to_num(depth),
                    "normal_maps": normal_map(depth, camera),
                }
                for folder, values in maps.items():
                    path = self._place(f"stereo/{folder}", f"{shot.name}.png.geometric.bin")
                    write_colmap(path, values)
        self._shots.append(shot)

    def close(self) -> None:
        """Write the lists of all frames; a second call does nothing."""
        shots, self._shots = self._shots, []
        if shots:
            {
                "tum": self._list_tum,
                "nerfstudio": self._list_nerfstudio,
                "colmap": self._list_colmap,
            }[self._layout](shots)

    def _place(self, folder: str, name: str) -> Path:
        place = self._folder / folder
        place.mkdir(parents=True, exist_ok=True)
        return place / name

    def _write_png(self, shot: _Shot, depth: Map, scale: float) -> None:
        """Write depths in 16 bits; a frame without a depth that fits them becomes all 0."""
        held = np.where(depth * scale < np.iinfo(np.uint16).max, depth, np.float32(np.nan))
        path = self._place("depth", f"{shot.name}.png")
        write_depth(path, held, unit="m", depth_scale=scale)

    def _write_text(self, name: str, lines: list[str]) -> None:
        replace_text(self._folder / name, "".join(f"{line}\n" for line in lines))

    def _list_tum(self, shots: list[_Shot]) -> None:
        rgb = [f"{shot.time:.6f} rgb/{shot.name}.png" for shot in shots]
        depth = [f"{shot.time:.6f} depth/{shot.name}.png" for shot in shots]
        self._write_text("rgb.txt", ["# timestamp filename", *rgb])
        self._write_text("depth.txt", ["# timestamp filename", *depth])
        both = [f"{one} {other}" for one, other in zip(rgb, depth, strict=True)]
        self._write_text("associations.txt", both)
        self._write_text("camera.txt", [_numbers(_intrinsics(shots[0].camera))])
        if self._has_poses:
            lines = [
                f"{shot.time:.6f} {_numbers([*shot.pose[:3, 3], *_quaternion(shot.pose)])}"
                for shot in shots
            ]
            self._write_text("groundtruth.txt", ["# timestamp tx ty tz qx qy qz qw", *lines])

    def _list_nerfstudio(self, shots: list[_Shot]) -> None:
        camera = shots[0].camera
        names = "fl_x", "fl_y", "cx", "cy"
        plain: dict[str, Any] = {
            "camera_model": "OPENCV",
            **dict(zip(names, _intrinsics(camera, _HALF), strict=True)),
            "w": camera.width,
            "h": camera.height,
            "frames": [
                {
                    "file_path": f"images/{shot.name}.png",
                    "depth_file_path": f"depth/{shot.name}.png",
                    "transform_matrix": (shot.pose @ _TO_OPENGL).tolist(),
                }
                for shot in shots
            ],
        }
        self._write_text("transforms.json", [json.dumps(plain, indent=1)])

    def _list_colmap(self, shots: list[_Shot]) -> None:
        camera, names = shots[0].camera, [f"{shot.name}.png" for shot in shots]
        size = f"{camera.width} {camera.height}"
        (self._folder / "sparse").mkdir(exist_ok=True)
        line = f"1 PINHOLE {size} {_numbers(_intrinsics(camera, _HALF))}"
        self._write_text("sparse/cameras.txt", [line])
        images = []
        for number, (shot, name) in enumerate(zip(shots, names, strict=True), start=1):
            seen = np.linalg.inv(shot.pose)  # from the world to the camera
            x, y, z, w = _quaternion(seen)
            images += [f"{number} {_numbers([w, x, y, z, *seen[:3, 3]])} 1 {name}", ""]
        self._write_text("sparse/images.txt", images)
        self._write_text("sparse/points3D.txt", [])
        self._write_text("stereo/fusion.cfg", names)


def normal_map(depth: Map, calibration: Calibration) -> Map:
    """Return the normals of surfaces, facing the camera.

    Parameters
    ----------
    depth
        float32 (H, W), in the unit of the baseline; NaN elsewhere.
    calibration
        The geometry of a map of this size.

    Returns
    -------
    ndarray
        float32 (H, W, 3), of length 1 in the frame of the left camera (X to the right, Y down, Z
        forward), with Z < 0 on the axis; 0 where fewer than 6 of 5 x 5 pixels belong to one
        surface, whose disparities differ by no more than 1 px from the middle.

    Notes
    -----
    The inverse depth of a plane is linear in the pixel, ``1 / Z = a x + b y + c``, and its normal
    is ``-(a fx, b fy, c + a cx + b cy)`` except for the length. Least squares over the window find
    the plane.
    """
    rows, cols = depth.shape
    reach = calibration.focal * calibration.baseline
    with np.errstate(divide="ignore"):
        shift = np.pad(reach / depth.astype(np.float64), _RADIUS, constant_values=np.nan)
    middle = shift[_RADIUS:-_RADIUS, _RADIUS:-_RADIUS]
    # Sums over the neighbors on the same surface: 1, x, y, xx, xy, yy, d, xd, yd, about the middle.
    sums = np.zeros((9, rows, cols))
    for y in range(-_RADIUS, _RADIUS + 1):
        for x in range(-_RADIUS, _RADIUS + 1):
            one = shift[_RADIUS + y :, _RADIUS + x :][:rows, :cols] - middle
            joined = np.abs(one) <= _JOINED
            one = np.where(joined, one, 0)
            for place, factor in enumerate((1, x, y, x * x, x * y, y * y)):
                sums[place] += factor * joined
            for place, factor in enumerate((1, x, y), start=6):
                sums[place] += factor * one
    with np.errstate(divide="ignore", invalid="ignore"):
        n, sx, sy, sxx, sxy, syy, sd, sxd, syd = sums
        sxx, sxy, syy = sxx - sx * sx / n, sxy - sx * sy / n, syy - sy * sy / n
        sxd, syd = sxd - sx * sd / n, syd - sy * sd / n
        area = sxx * syy - sxy * sxy
        a, b = (syy * sxd - sxy * syd) / area, (sxx * syd - sxy * sxd) / area
        level = middle + (sd - a * sx - b * sy) / n
        (fx, _, cx), (_, fy, cy), _ = calibration.cam0
        rest = level - a * (np.arange(cols) - cx) - b * (np.arange(rows)[:, np.newaxis] - cy)
        found = -np.stack([a * fx, b * fy, rest], axis=2)
        found /= np.linalg.norm(found, axis=2)[:, :, np.newaxis]
    found[~((n >= _FEWEST) & np.isfinite(found).all(axis=2))] = 0
    return found.astype(np.float32)


def _intrinsics(camera: Calibration, offset: float = 0.0) -> list[float]:
    (fx, _, cx), (_, fy, cy), _ = camera.cam0
    return [fx, fy, cx + offset, cy + offset]


def _numbers(values: list[Any]) -> str:
    return " ".join(f"{float(value):.9g}" for value in values)


def _quaternion(pose: NDArray[np.floating[Any]]) -> list[float]:
    """Return the rotation of a pose as x, y, z, w."""
    turn = require("cv2", extra="live").Rodrigues(pose[:3, :3])[0].ravel()
    angle = float(np.linalg.norm(turn))
    axis = turn / angle if angle else turn
    return [*(np.sin(angle / 2) * axis).tolist(), float(np.cos(angle / 2))]

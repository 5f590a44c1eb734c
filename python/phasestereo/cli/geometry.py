"""The geometry of the pair, which ``phasestereo match`` needs for points and depths."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter, validators
from numpy.typing import NDArray

from phasestereo.cli.errors import option, refusals, refuse_picture, wrong
from phasestereo.cli.options import AT_LEAST_ONE, POSITIVE, as_word
from phasestereo.cli.terminal import say
from phasestereo.io import Calibration, LengthUnit
from phasestereo.io.depth import MILLIMETERS
from phasestereo.io.rigs.reading import read_geometry
from phasestereo.rectification import Rectification
from phasestereo.result import Keep, Result
from phasestereo.shapes import Mesh, PointCloud
from phasestereo.views.depths import (
    YAW,
    Anchor,
    Ranging,
    Selection,
    check_anchor,
    depths_of,
    ranging,
)
from phasestereo.views.meshing import surface_mesh
from phasestereo.views.registering import ThirdCamera, register
from phasestereo.views.triangulation import point_cloud

_WITH_FOCAL = ("baseline", "doffs", "cx", "cy")
_EXACTNESS = ("yaw", "anchor")


def _anchor(word: str) -> Anchor:
    x, y, depth = word.split(",")
    return int(x), int(y), float(depth)


def _size(word: str) -> tuple[int, int]:
    cols, rows = map(int, word.split(","))
    if min(cols, rows) < 1:
        raise ValueError
    return cols, rows


_ANCHOR = as_word(_anchor, "X,Y,DEPTH as one word: 320,240,5.2")
_SIZE = as_word(_size, "COLUMNS,ROWS as one word: 1920,1080")


@dataclass(frozen=True, slots=True, kw_only=True)
class GeometryOptions:
    """The options that give the geometry, which turns disparities into depths.

    Parameters
    ----------
    calib
        Calibration of the rectified pair, of any kind that --rectify takes: calib.txt of Middlebury
        or KITTI, camera_info of both cameras (--calib left.yaml --calib right.yaml) ... Or the
        matrix Q of OpenCV's stereoRectify: .npy, .npz, .txt, or .yml and .xml of FileStorage.
    focal
        Focal length in pixels of two equal cameras; needs ``--baseline``. Default: that of a
        spatial photograph (HEIC).
    baseline
        Distance of the cameras; all depths have its unit. See --unit.
    doffs
        Difference of the principal points, right - left, in pixels. Default 0.
    cx
        Column of the principal point. Default: the center of the image.
    cy
        Row of the principal point. Default: the center of the image.
    unit
        Unit of baseline and depths; nothing is converted. Default: m, or mm for Middlebury's
        calib.txt. For --baseline and OpenCV's files the unit is unknown, and ``--depth FILE.png``
        needs it.
    depth_scale
        Units of ``--depth FILE.png`` in a meter: 1000 (mm, the default), 256 (KITTI) or 5000 (TUM).
    keep
        Pixels that become points and depths: trusted (the default), checked (fewer, more accurate),
        or all.
    min_depth
        Leave out all nearer depths, in the unit of the baseline.
    max_depth
        Leave out all farther depths, in the unit of the baseline.
    decimate
        Write one point or depth per block of N by N pixels: the one with the median disparity.
        Default 1.
    register
        Write the depths of ``--depth`` in the frame of a third camera, such as a color camera.
        Takes a calibration of the left and the third camera, in a form that ``--rectify`` takes, in
        the unit of the baseline. A .npz also has confidence, holes and occluded.
    register_size
        COLUMNS,ROWS of the third camera's images. Default: those of its calibration.
    yaw
        Possible error of the angle between the cameras, in degrees; it widens the error bars of
        depths. 0 if the calibration is exact. Default 0.01.
    anchor
        X,Y,DEPTH: a pixel of known depth, in the unit of the baseline; inf for the sky. All depths
        are corrected to make this one right.
    """

    calib: Annotated[tuple[Path, ...], Parameter(show_default=False)] = ()
    focal: Annotated[float | None, Parameter(validator=POSITIVE)] = None
    baseline: Annotated[float | None, Parameter(validator=POSITIVE)] = None
    doffs: float | None = None
    cx: float | None = None
    cy: float | None = None
    unit: LengthUnit | None = None
    depth_scale: Annotated[float | None, Parameter(validator=POSITIVE)] = None
    keep: Keep | None = None
    min_depth: Annotated[float | None, Parameter(validator=POSITIVE)] = None
    max_depth: Annotated[float | None, Parameter(validator=POSITIVE)] = None
    decimate: Annotated[int | None, Parameter(validator=AT_LEAST_ONE)] = None
    register: Annotated[tuple[str, ...], Parameter(show_default=False)] = ()
    register_size: Annotated[tuple[int, int] | None, _SIZE] = None
    yaw: Annotated[float | None, Parameter(validator=validators.Number(gte=0, lte=10))] = None
    anchor: Annotated[Anchor | None, _ANCHOR] = None

    def check(self, *, wanted: bool) -> None:
        """Refuse options that are incomplete, conflict or have no effect.

        Parameters
        ----------
        wanted
            Whether any output depends on the geometry.
        """
        given = [
            field.name for field in fields(self) if getattr(self, field.name) not in (None, ())
        ]
        sources = [name for name in ("calib", "focal") if name in given]

        if given and not wanted:
            raise wrong(given[0], "has no effect without --ply, --mesh, --depth or --report")
        if len(sources) > 1:
            raise wrong(sources[1], f"got {option(sources[0])}, too; accepts one geometry")

        for name in given:
            if name in _WITH_FOCAL and (self.baseline is None or sources not in ([], ["focal"])):
                raise wrong(name, "has no effect without --focal")
        if "focal" in sources and self.baseline is None:
            raise wrong("focal", "needs --baseline, the distance of the cameras")

        if self.register_size and not self.register:
            raise wrong("register_size", "has no effect without --register")
        if len(self.calib) > 2:
            raise wrong("calib", f"got {len(self.calib)} files; accepts one, or left and right")
        files: dict[str, Sequence[str | Path]] = {"register": self.register, "calib": self.calib}
        for name, paths in files.items():
            for path in paths:
                refuse_picture(name, path)

    def sources(self) -> list[Path | None]:
        """Return the files to read."""
        return [*self.calib, *map(Path, self.register)]

    def read(
        self,
        size: tuple[int, ...],
        rectified: Rectification | None = None,
        focal: float | None = None,
    ) -> "Rig | None":
        """Read the geometry of images of this size, if there is one.

        Parameters
        ----------
        size
            Rows and columns.
        rectified
            The pair's rectification; its geometry is the default.
        focal
            Focal length in pixels from the images' file.

        Raises
        ------
        OSError, ValueError
            If a file is invalid, or its images have another size.
        """
        known = None if rectified is None else rectified.calibration
        calibration = self._calibration(size[0], size[1], self.focal or focal) or known
        if calibration is None:
            for name in (*_EXACTNESS, "decimate", "depth_scale", "register"):
                if getattr(self, name) not in (None, ()):
                    raise wrong(name, "has no effect without a geometry, as --calib gives it")
            return None

        if calibration.unit == "m" and self.unit not in (None, "m"):
            raise wrong("unit", f"got {self.unit}; accepts m, which the calibration is read in")
        calibration = replace(calibration, unit=self.unit or calibration.unit)
        if self.anchor is not None:
            with refusals(options={"anchor"}):
                check_anchor(self.anchor, size)

        yaw = YAW if self.yaw is None else self.yaw
        scale = self.depth_scale or MILLIMETERS
        camera = None
        if self.register:
            with refusals(renamed={"calibration": "register", "size": "register_size"}):
                camera = ThirdCamera.of_pair(
                    self.register, rectification=rectified, size=self.register_size
                )
        return Rig(calibration, self.selection(size), yaw, self.anchor, scale, camera)

    def selection(self, size: tuple[int, ...] | None = None) -> Selection:
        """Return the mask of wanted pixels of images of this size.

        Raises
        ------
        CommandError
            If the range of depths is empty, or an image is smaller than a block.
        """
        if size is not None and self.decimate is not None and self.decimate > min(size[:2]):
            raise wrong("decimate", f"got {self.decimate}; accepts 1 to {min(size[:2])}")
        with refusals(options={"min_depth"}):
            return Selection(
                keep=self.keep or "trusted",
                min_depth=self.min_depth,
                max_depth=self.max_depth,
                decimate=self.decimate or 1,
            )

    def _calibration(self, height: int, width: int, focal: float | None) -> Calibration | None:
        if self.calib:
            found, notes = read_geometry(self.calib, (width, height))
            for note in notes:
                say(f"note: {note}")
            return found
        if self.baseline is None:
            return None
        if focal is None:
            raise wrong("baseline", "has no effect without --focal")
        with refusals(options=("focal", *_WITH_FOCAL)):
            return Calibration.from_focal(
                focal,
                self.baseline,
                width=width,
                height=height,
                doffs=self.doffs or 0.0,
                cx=self.cx,
                cy=self.cy,
            )


@dataclass(frozen=True, slots=True)
class Rig:
    """The camera pair, and the depths wanted of it.

    Parameters
    ----------
    calibration
        The geometry.
    selection
        The pixels that become points and depths.
    yaw, anchor
        The accuracy of the geometry, as in `phasestereo.depth_interval`.
    depth_scale
        Units of a ``.png`` of depths in a meter.
    camera
        The camera in whose frame depths are wanted; None: the left one.
    """

    calibration: Calibration
    selection: Selection
    yaw: float = YAW
    anchor: Anchor | None = None
    depth_scale: float = MILLIMETERS
    camera: ThirdCamera | None = None

    def check(self, disparities: tuple[int, int]) -> None:
        """Refuse a search range (smallest disparity, number) without a wanted depth.

        Raises
        ------
        ValueError
            If no disparity has a depth.
        CommandError
            If no disparity has a wanted depth.
        """
        # The nearest depth in the search must exist, and be wanted.
        largest = sum(disparities) - 1
        if math.isnan(self.calibration.depth(largest)):
            raise ValueError(
                f"no disparity up to {largest} has a depth with doffs = "
                f"{self.calibration.doffs:g}: what is nearer has larger disparities"
            )

        nearest = self.calibration.depth(largest + 1).item()
        limit = self.selection.max_depth
        if limit is not None and nearest > limit:
            raise wrong(
                "max_depth",
                f"got {limit:g}; with disparities up to {largest} nothing is nearer than "
                f"{nearest:g}: it is in the unit of the baseline",
            )

    def farthest(self) -> int:
        """Return the smallest disparity with a wanted depth."""
        rig, limit = self.calibration, self.selection.max_depth
        shift = 0.0 if limit is None else rig.baseline * rig.focal / limit
        return math.floor(shift - rig.doffs) + 1

    def points(self, result: Result, image: NDArray[Any]) -> PointCloud:
        """Return the points of a result in the colors of the image."""
        return point_cloud(
            result,
            self.calibration,
            image=image,
            **asdict(self.selection),
            yaw=self.yaw,
            anchor=self.anchor,
        )

    def surface(self, result: Result, image: NDArray[Any]) -> Mesh:
        """Return the surface of a result, with the image on it."""
        return surface_mesh(
            result, self.calibration, image=image, **asdict(self.selection), anchor=self.anchor
        )

    def ranging(self, result: Result) -> Ranging:
        """Return the converter from a result's disparities to depths."""
        return ranging(
            result.disparity,
            self.calibration,
            uncertainty=result.uncertainty,
            yaw=self.yaw,
            anchor=self.anchor,
        )

    def depths(self, result: Result) -> dict[str, NDArray[Any]]:
        """Return the depths of a result and their ends ``near``, ``far``, if it has error bars.

        In the frame of a third camera, return `phasestereo.Registered.maps`.
        """
        if self.camera is not None:
            options = asdict(replace(self.selection, decimate=1))
            del options["decimate"]
            return register(
                result,
                self.calibration,
                self.camera,
                **options,
                yaw=self.yaw,
                anchor=self.anchor,
            ).maps
        found = depths_of(result, self.ranging(result), self.selection)
        maps = {"depth": found.depth, "near": found.near, "far": found.far}
        return {name: values for name, values in maps.items() if values is not None}

    def of_size(self, shape: tuple[int, int]) -> "Rig":
        """Return the same cameras with smaller images: cropped, not resized."""
        height, width = shape
        small = replace(self.calibration, width=width, height=height)
        return replace(
            self, calibration=small, selection=Selection(keep="all"), anchor=None, camera=None
        )

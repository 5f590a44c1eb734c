"""The geometry of the pair, which ``phasestereo match`` needs for points and depths."""

# No `from __future__ import annotations`: the command line is made of these annotations.

import math
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray

from phasestereo.cli.errors import WRONG_USAGE, CommandError, option, refuse_picture
from phasestereo.cli.options import POSITIVE
from phasestereo.io import Calibration, LengthUnit, read_calibration, read_q
from phasestereo.views.meshing import Mesh, surface_mesh
from phasestereo.views.triangulation import PointCloud, point_cloud

Map = NDArray[np.float32]

_WITH_FOCAL = ("baseline", "doffs", "cx", "cy")


@dataclass(frozen=True, slots=True, kw_only=True)
class GeometryOptions:
    """The options that give the geometry, by which disparities become depths.

    Parameters
    ----------
    calib
        Middlebury's calib.txt; its baseline is in mm unless --unit says otherwise.
    q
        The matrix Q of OpenCV's stereoRectify: .npy, .npz, .txt, or .yml and .xml of FileStorage.
    focal
        Focal length in pixels, of two equal cameras; needs ``--baseline``.
    baseline
        Distance of the cameras, in the unit that all depths are to have.
    doffs
        Difference of the principal points, right - left, in pixels. Default 0.
    cx
        Column of the principal point. Default: that of the image's center.
    cy
        Row of the principal point. Default: that of the image's center.
    unit
        The unit of the baseline, needed for ``--depth FILE.png``, which holds mm.
    max_depth
        Leave out everything further away, in the unit of the baseline.
    """

    calib: Path | None = None
    q: Path | None = None
    focal: Annotated[float | None, Parameter(validator=POSITIVE)] = None
    baseline: Annotated[float | None, Parameter(validator=POSITIVE)] = None
    doffs: float | None = None
    cx: float | None = None
    cy: float | None = None
    unit: LengthUnit | None = None
    max_depth: Annotated[float | None, Parameter(validator=POSITIVE)] = None

    def check(self, *, wanted: bool) -> None:
        """Refuse options that are incomplete, exclude each other or have no effect.

        Parameters
        ----------
        wanted
            Whether anything that comes out depends on the geometry.
        """
        given = [field.name for field in fields(self) if getattr(self, field.name) is not None]
        sources = [name for name in ("calib", "q", "focal") if name in given]

        if given and not wanted:
            raise _wrong(given[0], "has no effect without --ply, --mesh, --depth or --report")
        if len(sources) > 1:
            raise _wrong(sources[1], f"got {option(sources[0])}, too; accepts one geometry")

        for name in given:
            if name in _WITH_FOCAL and "focal" not in sources:
                raise _wrong(name, "has no effect without --focal")
        if "focal" in sources and self.baseline is None:
            raise _wrong("focal", "needs --baseline, the distance of the cameras")

        for name, path in (("calib", self.calib), ("q", self.q)):
            if path is not None:
                refuse_picture(name, path)

    def bound(self) -> int | None:
        """Return the number of disparities that calib.txt gives, if there is one that does.

        Raises
        ------
        OSError, ValueError
            If the file is not what it should be.
        """
        return None if self.calib is None else read_calibration(self.calib).ndisp

    def sources(self) -> list[Path | None]:
        """Return the files that are read."""
        return [self.calib, self.q]

    def read(
        self,
        size: tuple[int, ...],
        disparities: tuple[int, int],
        known: NDArray[Any] | None = None,
    ) -> "Rig | None":
        """Read the geometry of images of this size, if there is one.

        Parameters
        ----------
        size
            Rows and columns.
        disparities
            The smallest disparity searched, and how many are.
        known
            The matrix Q to take where none is given.

        Raises
        ------
        OSError, ValueError
            If a file is not what it should be, is of images of another size, or not a single one
            of the disparities has a depth.
        CommandError
            If not a single one has a depth that is wanted.
        """
        calibration = self._calibration(*size)
        if calibration is None and known is not None:
            calibration = Calibration.from_q(known, width=size[1], height=size[0])
        if calibration is None:
            return None

        try:
            calibration.check_size(size)
        except ValueError as error:
            raise ValueError(f"{self.calib}: {error}") from error

        # The nearest depth that is searched must be there, and wanted.
        largest = sum(disparities) - 1
        if math.isnan(calibration.depth(largest)):
            raise ValueError(
                f"no disparity up to {largest} has a depth with doffs = {calibration.doffs:g}: "
                "what is nearer has larger disparities"
            )

        nearest = calibration.depth(largest + 1).item()
        if self.max_depth is not None and nearest > self.max_depth:
            raise _wrong(
                "max_depth",
                f"got {self.max_depth:g}; with disparities up to {largest} nothing is nearer than "
                f"{nearest:g}: it is in the unit of the baseline",
            )

        unit = self.unit or (None if self.calib is None else "mm")
        return Rig(calibration, unit, self.max_depth)

    def _calibration(self, height: int, width: int) -> Calibration | None:
        if self.calib is not None:
            return read_calibration(self.calib)
        if self.q is not None:
            matrix = read_q(self.q)
            try:
                return Calibration.from_q(matrix, width=width, height=height)
            except ValueError as error:
                raise ValueError(f"{self.q}: {error}") from error

        if self.focal is None or self.baseline is None:
            return None
        return Calibration.from_focal(
            self.focal,
            self.baseline,
            width=width,
            height=height,
            doffs=self.doffs or 0.0,
            cx=self.cx,
            cy=self.cy,
        )


@dataclass(frozen=True, slots=True)
class Rig:
    """The camera pair, the unit of its baseline (None: unknown), and the largest depth wanted."""

    calibration: Calibration
    unit: LengthUnit | None
    max_depth: float | None

    def points(self, disparity: Map, image: NDArray[Any]) -> PointCloud:
        """Return the points of a disparity map in the colors of the image."""
        return point_cloud(disparity, self.calibration, image=image, max_depth=self.max_depth)

    def surface(self, disparity: Map, image: NDArray[Any]) -> Mesh:
        """Return the surface of a disparity map, with the image on it."""
        return surface_mesh(disparity, self.calibration, image=image, max_depth=self.max_depth)

    def depth(self, disparity: Map) -> Map:
        """Return the depths of a disparity map; what is beyond float32 is too far to be wanted."""
        depth = self.calibration.depth(disparity)
        limit = np.inf if self.max_depth is None else self.max_depth
        wanted = np.isfinite(depth) & (depth <= limit)
        return np.where(wanted, depth, np.float32(np.nan))

    def of_size(self, shape: tuple[int, int]) -> "Rig":
        """Return the same cameras with other, smaller images: a cut-out, not a resized one."""
        height, width = shape
        return replace(self, calibration=replace(self.calibration, width=width, height=height))


def _wrong(name: str, message: str) -> CommandError:
    return CommandError(f"{option(name)}: {message}", WRONG_USAGE)

"""Calibrations of rectified pairs: Middlebury's ``calib.txt``, OpenCV's Q, a few numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from numbers import Integral
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._numbers import as_integer, as_number
from phasestereo._tables import as_html
from phasestereo.io.depth import LengthUnit, meters_in

Camera: TypeAlias = tuple[tuple[float, ...], ...]
"""A 3 x 3 matrix of intrinsics by rows, in pixels: [f 0 cx; 0 f cy; 0 0 1]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """The geometry of a rectified pair; the fields are those of ``calib.txt`` [1]_.

    Points and depths are in the frame of the left camera, X right, Y down and Z forward, and in the
    unit of `baseline`.

    Raises
    ------
    TypeError
        If width, height or ndisp is not an integer.
    ValueError
        If a camera is not [fx 0 cx; 0 fy cy; 0 0 1] with positive focal lengths, or baseline,
        width, height or ndisp is not positive, or a number is not finite, or the unit is unknown.

    See Also
    --------
    read_calibration : From a file.

    References
    ----------
    .. [1] Middlebury stereo data sets of 2014, format of the calibration files,
       https://vision.middlebury.edu/stereo/data/scenes2014/
    """

    cam0: Camera
    """Intrinsics of the left camera."""
    cam1: Camera
    """Intrinsics of the right camera."""
    doffs: float
    """Difference of the principal points in x, cx1 - cx0, pixels."""
    baseline: float
    """Distance of the cameras; mm in Middlebury's files."""
    width: int
    """Width of the images, pixels."""
    height: int
    """Height of the images, pixels."""
    ndisp: int | None = None
    """A bound on the number of disparities: all d lie in [0, ndisp - 1]."""
    vmin: float | None = None
    """A tight bound on the smallest disparity, pixels."""
    vmax: float | None = None
    """A tight bound on the largest disparity, pixels."""
    unit: LengthUnit | None = None
    """The unit of `baseline` and of all depths; None: unknown."""

    def __post_init__(self) -> None:
        """Refuse values that cannot be a camera pair."""
        for name in ("cam0", "cam1"):
            # the only way to set a field of a frozen dataclass
            object.__setattr__(self, name, _checked_camera(name, getattr(self, name)))

        for name in ("doffs", "vmin", "vmax"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise ValueError(f"{name} must be finite, got {value}")

        for name in ("baseline", "width", "height", "ndisp"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be positive and finite, got {value}")

        for name in ("width", "height", "ndisp"):
            value = getattr(self, name)
            if value is not None and not isinstance(value, Integral):
                raise TypeError(f"{name} must be an integer, got {value!r}")
        if self.unit is not None:
            meters_in(self.unit)

    @classmethod
    def from_focal(
        cls,
        focal: float,
        baseline: float,
        *,
        width: int,
        height: int,
        doffs: float = 0.0,
        cx: float | None = None,
        cy: float | None = None,
        unit: LengthUnit | None = None,
    ) -> Self:
        """Make the calibration of two equal cameras.

        Parameters
        ----------
        focal
            Focal length, pixels.
        baseline
            Distance of the cameras; its unit is that of all depths.
        width, height
            Size of the images, pixels.
        doffs
            Difference of the principal points in x, right - left, pixels.
        cx, cy
            Principal point of the left camera, pixels; the center of the first pixel is (0, 0).
            None: the center of the image.
        unit
            The unit of the baseline; None: unknown.

        Raises
        ------
        TypeError
            If an argument is not a number, or width or height not an integer.
        ValueError
            If focal, baseline, width or height is not positive, or a number is not finite.
        """
        f = as_number("focal", focal, positive=True)
        offset = as_number("doffs", doffs)
        for name, side in (("width", width), ("height", height)):
            as_number(name, side)  # __post_init__ refuses invalid sizes

        x = (width - 1) / 2 if cx is None else as_number("cx", cx)
        y = (height - 1) / 2 if cy is None else as_number("cy", cy)

        return cls(
            cam0=((f, 0.0, x), (0.0, f, y), (0.0, 0.0, 1.0)),
            cam1=((f, 0.0, x + offset), (0.0, f, y), (0.0, 0.0, 1.0)),
            doffs=offset,
            baseline=as_number("baseline", baseline),
            width=width,
            height=height,
            unit=unit,
        )

    @classmethod
    def from_q(
        cls, q: ArrayLike, *, width: int, height: int, unit: LengthUnit | None = None
    ) -> Self:
        """Make a calibration from the matrix Q of OpenCV's ``stereoRectify`` [2]_.

        Parameters
        ----------
        q
            The 4 x 4 matrix [1 0 0 -cx; 0 1 0 -cy; 0 0 0 f; 0 0 -1/Tx (cx - cx')/Tx], or a multiple
            of it; Tx = -baseline. Its second row may have a factor, which is fx / fy.
        width, height
            Size of the rectified images, pixels.
        unit
            The unit of the baseline; None: unknown.

        Raises
        ------
        TypeError
            If q does not hold real numbers, or width or height is not an integer.
        ValueError
            If q is not such a matrix, or is that of exchanged cameras.

        See Also
        --------
        read_calibration : From the files that hold Q.

        References
        ----------
        .. [2] OpenCV, camera calibration and 3D reconstruction, ``stereoRectify`` and
           ``reprojectImageTo3D``, https://docs.opencv.org/4.x/d9/d0c/group__calib3d.html
        """
        (_, _, _, x), (_, row, _, y), (_, _, _, f), (_, _, inverse, offset) = _checked_q(q)

        # Signs as in Q; its second row may be scaled by fx / fy.
        cx, fy, cy, doffs = -x, f / row, -y / row, offset / inverse
        return cls(
            cam0=((f, 0.0, cx), (0.0, fy, cy), (0.0, 0.0, 1.0)),
            cam1=((f, 0.0, cx + doffs), (0.0, fy, cy), (0.0, 0.0, 1.0)),
            doffs=doffs,
            baseline=1 / inverse,
            width=width,
            height=height,
            unit=unit,
        )

    def decimated(self, factor: int) -> Self:
        """Return the calibration of images reduced by a whole factor.

        Parameters
        ----------
        factor
            Pixels along a row and a column that become one, from 1 to the smaller side. Rows and
            columns that do not fill a block are dropped.

        Raises
        ------
        TypeError
            If it is not an integer.
        ValueError
            If it is out of range.

        Notes
        -----
        Depths stay the same; disparities are divided by the factor. The center of the first block
        is (factor - 1) / 2 pixels from the center of the first pixel, so ``cx`` becomes ``(cx +
        0.5) / factor - 0.5``.
        """
        n = as_integer("decimate", factor, least=1, most=min(self.width, self.height))
        return self._resized(1 / n, 1 / n, (self.width // n, self.height // n))

    @property
    def q(self) -> NDArray[np.float64]:
        """OpenCV's matrix Q of this pair, (4, 4), as ``cv2.reprojectImageTo3D`` takes it."""
        (fx, _, cx), (_, fy, cy), _ = self.cam0
        row, inverse = fx / fy, 1 / self.baseline

        return np.array(
            [
                [1, 0, 0, -cx],
                [0, row, 0, -cy * row],
                [0, 0, 0, fx],
                [0, 0, inverse, self.doffs * inverse],
            ],
            dtype=np.float64,
        )

    def _repr_html_(self) -> str:
        """Show the fields as a table in notebooks, matrices by focal length and center."""
        cameras = {
            name: f"f {fx:.6g} x {fy:.6g} px, center ({cx:.6g}, {cy:.6g})"
            for name, ((fx, _, cx), (_, fy, cy), _) in (("cam0", self.cam0), ("cam1", self.cam1))
        }
        known = {field.name: getattr(self, field.name) for field in fields(self)} | cameras
        rows = [(name, f"{value}") for name, value in known.items() if value is not None]
        words = f"{self.width} x {self.height} pixels"
        return as_html("io.Calibration", words, ("Field", "value"), rows)

    @property
    def focal(self) -> float:
        """Focal length of the left camera, pixels."""
        return self.cam0[0][0]

    def in_meters(self) -> Self:
        """Return the same with the baseline in m; an unknown unit counts as m."""
        return replace(self, baseline=self.baseline * meters_in(self.unit or "m"), unit="m")

    def scaled(self, width: int, height: int) -> Self:
        """Return the calibration of the same images at another size.

        Parameters
        ----------
        width, height
            Size of the images, pixels.

        Raises
        ------
        ValueError
            If the proportions differ by more than a pixel: such images are cropped, not scaled.
        """
        if not fits((self.width, self.height), (width, height)):
            raise ValueError(
                f"calibration: got that of {self.width} x {self.height} pixels; accepts that of "
                f"images with the proportions of {width} x {height}"
            )
        return self._resized(width / self.width, height / self.height, (width, height))

    def _resized(self, x: float, y: float, size: tuple[int, int]) -> Self:
        """Return the calibration of images whose sides were multiplied by these factors."""

        def camera(matrix: Camera) -> Camera:
            # The center of the first pixel is (0, 0), its corner (-0.5, -0.5).
            (fx, _, cx), (_, fy, cy), bottom = matrix
            return (fx * x, 0.0, (cx + 0.5) * x - 0.5), (0.0, fy * y, (cy + 0.5) * y - 0.5), bottom

        return replace(
            self,
            cam0=camera(self.cam0),
            cam1=camera(self.cam1),
            doffs=self.doffs * x,
            width=size[0],
            height=size[1],
            ndisp=None if self.ndisp is None else math.ceil(self.ndisp * x),
            vmin=None if self.vmin is None else self.vmin * x,
            vmax=None if self.vmax is None else self.vmax * x,
        )

    def check_size(self, shape: tuple[int, ...]) -> None:
        """Refuse a map or an image, shape (H, W, ...), of another size than the calibrated one.

        Raises
        ------
        ValueError
            If the size differs: f, cx, cy and doffs hold for one size only.
        """
        if shape[:2] != (self.height, self.width):
            given = " x ".join(map(str, reversed(shape[:2])))
            raise ValueError(
                f"calibration: got that of {self.width} x {self.height} pixels; accepts that of "
                f"the images' {given} (`Calibration.scaled` makes one of resized images)"
            )

    def depth(self, disparity: ArrayLike) -> NDArray[np.float32]:
        """Return the depth of each disparity, Z = baseline * focal / (d + doffs).

        Parameters
        ----------
        disparity
            Disparities of any shape, pixels, right x = left x - d.

        Returns
        -------
        ndarray
            float32 of the same shape, in the unit of `baseline`; NaN where the disparity is not
            finite (no estimate) or d + doffs <= 0 (no point in front of the cameras).

        Raises
        ------
        TypeError
            If the disparities are not real numbers, or an array of int16, OpenCV's sixteenths.
        """
        given = np.asarray(disparity)
        check_pixels(given)

        shift = given.astype(np.float64) + self.doffs
        in_front = np.isfinite(shift) & (shift > 0)
        with np.errstate(over="ignore"):  # values beyond float32 are infinitely far
            ahead = self.baseline * self.focal / np.where(in_front, shift, 1)
            return np.where(in_front, ahead, np.nan).astype(np.float32)


def _checked_camera(name: str, matrix: ArrayLike) -> Camera:
    """Return a matrix as rows of numbers, which compare and hash, unlike arrays."""
    rows = np.asarray(matrix, dtype=np.float64)
    if rows.shape != (3, 3) or not np.isfinite(rows).all() or rows[0, 0] <= 0:
        raise ValueError(
            f"{name} must be 3 x 3 finite numbers, the first the positive focal length, "
            f"got {matrix!r}"
        )

    (_, skew, _), (turn, fy, _), bottom = rows.tolist()
    if fy <= 0 or skew != 0 or turn != 0 or bottom != [0, 0, 1]:
        raise ValueError(
            f"{name} must be [fx 0 cx; 0 fy cy; 0 0 1] as of a rectified camera, got {matrix!r}"
        )

    return tuple(tuple(row) for row in rows.tolist())


_Q_ZEROS = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1), (2, 2), (3, 0), (3, 1))


def _checked_q(q: ArrayLike) -> list[list[float]]:
    """Return the rows of a matrix Q, scaled so that the first element is 1."""
    given = np.asarray(q)
    if given.dtype.kind not in "iuf":
        raise TypeError(f"q must hold real numbers, got dtype {given.dtype}")
    if given.shape != (4, 4) or not np.isfinite(given).all():
        raise ValueError(f"q must be 4 x 4 finite numbers, got {given.tolist()}")

    # Every multiple of Q means the same.
    matrix = given.astype(np.float64) / (given[0, 0] or 1)
    if any(matrix[place] for place in _Q_ZEROS) or not (matrix[[0, 1, 2], [0, 1, 3]] > 0).all():
        raise ValueError(
            "q must be [1 0 0 -cx; 0 1 0 -cy; 0 0 0 f; 0 0 1/baseline doffs/baseline] with f > 0 "
            f"(X to the right, Y down, Z forward), got {given.tolist()}"
        )

    if not matrix[3, 2] > 0:
        raise ValueError(
            f"q must have a positive element [3, 2], which is 1/baseline, got {matrix[3, 2]:g}: "
            "is the left camera on the right of the other one?"
        )

    return matrix.tolist()


def check_pixels(disparity: NDArray[Any]) -> None:
    """Refuse disparities that are not real numbers of pixels.

    Raises
    ------
    TypeError
        If they are something else, or int16, in which OpenCV's matchers count sixteenths.
    """
    if disparity.dtype.kind not in "iuf":
        raise TypeError(f"disparity must hold real numbers, got dtype {disparity.dtype}")
    if disparity.dtype == np.int16 and disparity.ndim:
        raise TypeError(
            "disparity must be in pixels, got int16, in which OpenCV's matchers return sixteenths: "
            "divide by 16.0, or give whole pixels as another type"
        )


def fits(known: tuple[int, int], size: tuple[int, int]) -> bool:
    """Return whether images of two sizes (columns, rows) have the same proportions, to a pixel."""
    (a, b), (w, h) = known, size
    return abs(a * h - b * w) <= max(a, b)


def of_middlebury(text: str) -> Calibration:
    """Return the calibration in lines of ``name=value``, with matrices in brackets; mm.

    Names that `Calibration` does not have are skipped (``isint``, ``dyavg``, ``dymax`` ...).

    Raises
    ------
    ValueError
        If a line is malformed (the message gives its number), a name is missing or given twice, or
        the values are not those of a camera pair.
    """
    values: dict[str, Any] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        try:
            _parse_line(line, values)
        except ValueError as error:
            raise ValueError(f"line {number}, {line.strip()!r}: {error}") from error

    missing = [name for name in _REQUIRED if name not in values]
    if missing:
        raise ValueError(f"no line gives {', '.join(missing)}")
    return Calibration(**values, unit="mm")


def _parse_line(line: str, values: dict[str, Any]) -> None:
    """Add the value of a line to the values."""
    if not line.strip():
        return

    key, equals, text = (part.strip() for part in line.partition("="))
    if not equals or not key:
        raise ValueError("expected name=value")
    if key in values:
        raise ValueError(f"{key} is given twice")

    if key in _PARSERS:
        values[key] = _PARSERS[key](text)


def _parse_camera(text: str) -> Camera:
    if not (text.startswith("[") and text.endswith("]")):
        raise ValueError("expected a matrix [a b c; d e f; g h i]")

    rows = tuple(tuple(map(float, row.split())) for row in text[1:-1].split(";"))
    if [len(row) for row in rows] != [3, 3, 3]:
        raise ValueError("expected a matrix of 3 rows of 3 numbers")

    return rows


_REQUIRED = ("cam0", "cam1", "doffs", "baseline", "width", "height")
_PARSERS: dict[str, Callable[[str], Any]] = {
    "cam0": _parse_camera,
    "cam1": _parse_camera,
    "doffs": float,
    "baseline": float,
    "width": int,
    "height": int,
    "ndisp": int,
    "vmin": float,
    "vmax": float,
}

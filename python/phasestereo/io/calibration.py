"""Calibrations of rectified pairs, as Middlebury's ``calib.txt`` states them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from phasestereo.io.files import decoding

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from phasestereo.io.files import StrPath

Camera: TypeAlias = tuple[tuple[float, ...], ...]
"""A 3 x 3 matrix of intrinsics by rows, in pixels: [f 0 cx; 0 f cy; 0 0 1]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """The geometry of a rectified pair; the fields are those of ``calib.txt`` [1]_.

    Raises
    ------
    ValueError
        If a camera is not a 3 x 3 matrix with a positive focal length, or baseline, width, height
        or ndisp is not positive, or a number is not finite.

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

    def __post_init__(self) -> None:
        """Refuse what cannot be a camera pair."""
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

    @property
    def focal(self) -> float:
        """Focal length of the left camera, pixels."""
        return self.cam0[0][0]

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
            If the disparities are not real numbers.
        """
        given = np.asarray(disparity)
        if given.dtype.kind not in "iuf":
            raise TypeError(f"disparity must hold real numbers, got dtype {given.dtype}")
        shift = given.astype(np.float64) + self.doffs
        in_front = np.isfinite(shift) & (shift > 0)
        with np.errstate(over="ignore"):  # beyond float32 is infinitely far
            ahead = self.baseline * self.focal / np.where(in_front, shift, 1)
            return np.where(in_front, ahead, np.nan).astype(np.float32)


def _checked_camera(name: str, matrix: ArrayLike) -> Camera:
    """Return a matrix as rows of numbers, which compare and hash as arrays do not."""
    rows = np.asarray(matrix, dtype=np.float64)
    if rows.shape != (3, 3) or not np.isfinite(rows).all() or rows[0, 0] <= 0:
        raise ValueError(
            f"{name} must be 3 x 3 finite numbers, the first the positive focal length, "
            f"got {matrix!r}"
        )
    return tuple(tuple(row) for row in rows.tolist())


def read_calibration(path: StrPath) -> Calibration:
    """Read a calibration file of Middlebury's: lines of ``name=value``, matrices in brackets.

    Names that `Calibration` does not have are skipped (``isint``, ``dyavg``, ``dymax`` ...).

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Calibration

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If a line is malformed (the message gives its number), a name is missing or given twice, or
        the values are not those of a camera pair.
    """
    with decoding(path) as file:
        values: dict[str, Any] = {}
        for number, line in enumerate(file.read().decode("utf-8-sig").splitlines(), start=1):
            try:
                _parse_line(line, values)
            except ValueError as error:
                raise ValueError(f"line {number}, {line.strip()!r}: {error}") from error
        missing = [name for name in _REQUIRED if name not in values]
        if missing:
            raise ValueError(f"no line gives {', '.join(missing)}")
        return Calibration(**values)


def _parse_line(line: str, values: dict[str, Any]) -> None:
    """Add what a line says to the values."""
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

"""The tests that makers of depth cameras run on a flat wall at a known distance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasestereo._numbers import as_number
from phasestereo.io import Calibration
from phasestereo.result import Result
from phasestereo.rigs import Check

LIMITS: Mapping[str, float] = {
    "fill": 0.99,
    "accuracy": 2.0,
    "plane": 2.0,
    "subpixel": 0.1,
    "temporal": 1.0,
}
"""The limits that Intel's data sheet of the D400 cameras promises up to 2 m (percent of the
distance, a share of pixels); for sub-pixel errors (pixels), the value in its tuning guide for a
wall with texture."""

_SIDE = 0.8  # of the width and of the height: the part of the image that the data sheet uses


class _Frame(NamedTuple):
    """Measurements of the wall in one frame: shares, pixels, and lengths in the baseline's unit."""

    fill: float
    accuracy: float
    plane: float
    subpixel: float


class Wall:
    r"""A test of depths on a flat wall with texture, as makers of cameras define it.

    The test counts the middle 80 % of the columns and rows, as far as the right camera sees the
    wall there, and in these the trusted pixels.

    ============  =======  ======================================================================
    ``fill``      share    pixels that are trusted
    ``accuracy``  percent  the median of the distances along the optical axis, the wall turned to
                           face the camera, less the true one
    ``plane``     percent  distances of the points from the plane through them, root mean square
    ``subpixel``  px       disparities less those of that plane, root mean square
    ``temporal``  percent  standard deviation of a pixel's depth over the frames, median
    ============  =======  ======================================================================

    Percents refer to the true distance; the first four are medians over the frames.

    Parameters
    ----------
    distance
        The distance of the wall along the optical axis of the left camera, in the unit of the
        baseline.
    calibration
        The geometry of the rectified frames.
    unit
        The unit of the baseline, for use in sentences.

    Raises
    ------
    TypeError, ValueError
        If the distance is not a positive number, or the cameras see no common part of a wall at
        that distance.

    Notes
    -----
    The definitions come from Intel's *Depth quality testing methodology* and its tool
    ``rs-depth-quality``. The plane is fitted to disparities, because a plane in space is linear in
    them, and because their errors all have one size while those of depths do not.

    Examples
    --------
    >>> wall = Wall(1.0, Calibration.from_focal(640, 0.05, width=1280, height=720))
    >>> for left, right in frames:
    ...     wall.add(rig.match(left, right))
    >>> print(*wall.test(), sep="\n")
    """

    def __init__(self, distance: float, calibration: Calibration, *, unit: str = "") -> None:
        self._distance = as_number("distance", distance, positive=True)
        self._calibration = calibration
        self._unit = unit
        self._frames: list[_Frame] = []
        size = calibration.height, calibration.width
        if not self._seen(size).any():
            raise ValueError(
                f"distance: got {self._distance:g} {unit}".rstrip()
                + f", of which the cameras, {calibration.baseline:g} {unit}".rstrip()
                + " apart, see nothing in common; accepts a wall farther away"
            )
        # For each pixel: frames that see it, the mean of its depths, the sum of squared deviations.
        self._counts = np.zeros(size, np.int64)
        self._means = np.zeros(size)
        self._squares = np.zeros(size)

    def add(self, result: Result) -> None:
        """Add a frame.

        Parameters
        ----------
        result
            The match of the frame.

        Raises
        ------
        ValueError
            If its size differs from the calibration's, its images were rectified without a
            calibration, so that this one does not fit them, or it has fewer than three trusted
            pixels on the wall.
        """
        if result.rectified is not None:
            raise ValueError(
                "result: got one of raw images; accepts that of images that a calibration rectified"
            )
        self._calibration.check_size(result.disparity.shape)

        seen = self._seen(result.disparity.shape)
        rows, columns = np.nonzero(seen & result.trusted)
        shifts = result.disparity[rows, columns].astype(np.float64) + self._calibration.doffs
        ahead = shifts > 0
        rows, columns, shifts = rows[ahead], columns[ahead], shifts[ahead]
        if len(shifts) < 3:
            raise ValueError(
                f"result: got {len(shifts)} trusted pixels in front of the cameras; accepts a wall "
                "with texture, which has three at least"
            )

        self._frames.append(self._measured(rows, columns, shifts, pixels=int(seen.sum())))
        self._accumulate(rows, columns, self._reach / shifts)

    def test(self, limits: Mapping[str, float] | None = None) -> tuple[Check, ...]:
        """Compare the measurements with limits.

        Parameters
        ----------
        limits
            Limits that replace those in `LIMITS`, by name: upper limits, but a lower limit for
            "fill".

        Returns
        -------
        tuple of Check
            All quantities. Temporal noise needs more than one frame.

        Raises
        ------
        ValueError
            For another name, or a limit that is negative or not finite.
        """
        given = dict(limits or {})
        for name, limit in given.items():
            if name not in LIMITS:
                raise ValueError(f"limits: got {name!r}; accepts limits of {', '.join(LIMITS)}")
            if not (math.isfinite(limit) and limit >= 0):
                raise ValueError(f"limits: got {name}={limit}; accepts finite ones from 0 on")

        nothing = _Frame(0.0, math.nan, math.nan, math.nan)
        found = _Frame(*np.median(self._frames or [nothing], axis=0).tolist())
        temporal = self._temporal()
        percent = 100 / self._distance
        values = {
            "fill": ("", "share of the wall that is trusted", found.fill),
            "accuracy": ("%", self._said("distance less the true one", found.accuracy),
                         found.accuracy * percent),
            "plane": ("%", self._said("distance from a plane, root mean square", found.plane),
                      found.plane * percent),
            "subpixel": ("px", "disparity less a plane's, root mean square", found.subpixel),
            "temporal": ("%", self._said("depth from frame to frame", temporal),
                         temporal * percent),
        }  # fmt: skip
        every = {**LIMITS, **given}
        return tuple(
            Check(name, *values[name], every[name], _passed(name, values[name][2], every[name]))
            for name in values
        )

    @property
    def _reach(self) -> float:
        """Depth times disparity."""
        return self._calibration.focal * self._calibration.baseline

    def _seen(self, size: tuple[int, ...]) -> NDArray[np.bool_]:
        """Return the pixels that count: the middle, as far as the right camera sees the wall."""
        height, width = size
        top, left = (round(side * (1 - _SIDE) / 2) for side in size)
        first = max(left, math.ceil(self._reach / self._distance - self._calibration.doffs))
        seen = np.zeros(size, np.bool_)
        seen[top : height - top, first : width - left] = True
        return seen

    def _measured(
        self,
        rows: NDArray[np.int64],
        columns: NDArray[np.int64],
        shifts: NDArray[np.float64],
        pixels: int,
    ) -> _Frame:
        (fx, _, cx), (_, fy, cy), _ = self._calibration.cam0
        rays = np.stack([(columns - cx) / fx, (rows - cy) / fy, np.ones(len(shifts))], axis=1)
        normal = np.linalg.lstsq(rays, shifts, rcond=None)[0]
        plane = rays @ normal
        distances = self._reach * (plane / shifts - 1) / np.linalg.norm(normal)
        ahead = self._reach / normal[2] if normal[2] > 0 else math.nan
        return _Frame(
            fill=len(shifts) / pixels,
            accuracy=ahead + float(np.median(distances)) - self._distance,
            plane=_rms(distances),
            subpixel=_rms(shifts - plane),
        )

    def _accumulate(
        self, rows: NDArray[np.int64], columns: NDArray[np.int64], depths: NDArray[np.float64]
    ) -> None:
        """Update means and squares with one more frame, after B. P. Welford, Technometrics 1962."""
        at = rows, columns
        self._counts[at] += 1
        apart = depths - self._means[at]
        self._means[at] += apart / self._counts[at]
        self._squares[at] += apart * (depths - self._means[at])

    def _temporal(self) -> float:
        """Return the standard deviation of depths over the frames; NaN for only one frame."""
        count = len(self._frames)
        always = self._counts == count
        if count < 2 or not always.any():
            return math.nan
        return float(np.median(np.sqrt(self._squares[always] / (count - 1))))

    def _said(self, text: str, length: float) -> str:
        if math.isnan(length):
            return text
        said = f"{text}: {length:.3g} {self._unit}".rstrip()
        return f"{said} at {self._distance:g} {self._unit}".rstrip()


def _passed(name: str, value: float, limit: float) -> bool | None:
    if math.isnan(value):
        return None if name == "temporal" else False
    return value >= limit if name == "fill" else abs(value) <= limit


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))

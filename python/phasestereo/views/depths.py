"""Depths with their error bars: what the matching, and the angle between the cameras, leave open.

A yaw of the right camera that the calibration does not know moves every disparity by nearly as
much, `focal * tan(yaw) * (1 + t**2)` pixels at `t = (x - d - cx1) / fx`. No row shows it, so it can
not be found in a pair: how large it may be is said, or one known distance limits it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._images import Map, as_array
from phasestereo._numbers import as_integer, as_number
from phasestereo.io.calibration import Calibration
from phasestereo.result import Result

Anchor: TypeAlias = tuple[int, int, float]
"""Column and row of a pixel of the left image, and its depth, which may be infinite."""

YAW = 0.01
"""Degrees of yaw that a calibration may be off by, unless more is known.

It is 0.2 px at a focal length of 1100 px, as much as the corners of a calibration target are off
by; a rig that was knocked or has warmed up may be off by ten times as much.
"""

_NINETY = 1.645  # standard deviations on either side hold 90 %
_STEEPEST = 10.0  # degrees; what is off by more is another rig


class DepthInterval(NamedTuple):
    """Depths and the ends of their error bars, each float32 (H, W), in the unit of the baseline.

    Attributes
    ----------
    depth
        Depth; NaN where there is no estimate, or d + doffs <= 0.
    near, far
        The nearest and the farthest depth of the interval that holds the true one with a
        probability of 90 %; infinite where the disparity of that end is not positive, NaN where
        there is no estimate. ``far`` is further from ``depth`` than ``near`` is.
    """

    depth: Map
    near: Map
    far: Map


@dataclass(frozen=True, slots=True)
class Ranging:
    """What turns disparities and their error bars into depths and theirs.

    Parameters
    ----------
    calibration
        The geometry; an anchor has changed its ``doffs``.
    yaw
        Degrees that the angle between the cameras may be off by.
    moved
        Pixels by which an anchor has changed ``doffs``; 0 without one.
    share
        Pixels that the yaw adds to the error bar of a disparity:
        ``share[0] + share[1] * abs(t**2 - share[2])``, with `t` as above.
    """

    calibration: Calibration
    yaw: float
    moved: float
    share: tuple[float, float, float]

    def __str__(self) -> str:
        """Say how exact depths are but for the matching, in degrees and in pixels."""
        if not self.moved:
            return (
                f"depths: a yaw of up to {self.yaw:g} degrees is allowed for, "
                f"{self.share[0]:.2g} px in the middle of the image"
            )
        focal = self.calibration.cam1[0][0]
        turned = math.degrees(self.moved / (1 + self.share[2]) / focal)
        return (
            f"depths: the anchor adds {self.moved:+.2f} px to all disparities, "
            f"as a yaw of {abs(turned):.2g} degrees does"
        )

    def interval(
        self, disparity: ArrayLike, uncertainty: ArrayLike, columns: ArrayLike
    ) -> DepthInterval:
        """Return depths and their ends; see `depth_interval`.

        Parameters
        ----------
        disparity, uncertainty
            Disparities and their error bars, pixels, of one shape.
        columns
            Their columns in the left image, of a shape that fits.
        """
        given = np.asarray(disparity, dtype=np.float64)
        (focal, _, center), _, _ = self.calibration.cam1
        t = (np.asarray(columns) - given - center) / focal
        constant, slope, middle = self.share

        # The yaw is the same for all pixels, so it is added to the bars, not to their squares.
        own = np.asarray(uncertainty, dtype=np.float64)
        bar = own + constant + slope * np.abs(t**2 - middle)
        shift = given + self.calibration.doffs
        depth = self.calibration.depth(given)
        return DepthInterval(depth, self._end(shift + bar), self._end(shift - bar))

    def _end(self, shift: NDArray[np.float64]) -> Map:
        """Return the depth of an end: infinite where nothing is in front of the cameras."""
        reach = self.calibration.baseline * self.calibration.focal
        with np.errstate(over="ignore"):  # beyond float32 is infinitely far
            ahead = np.divide(reach, shift, out=np.full_like(shift, np.inf), where=~(shift <= 0))
            return ahead.astype(np.float32)


def depth_interval(
    disparity: Result | ArrayLike,
    calibration: Calibration,
    *,
    uncertainty: ArrayLike | None = None,
    yaw: float = YAW,
    anchor: Anchor | None = None,
    offset: tuple[float, float] | None = None,
) -> DepthInterval:
    """Return the depth of every pixel, and the ends of its error bar.

    Parameters
    ----------
    disparity
        A `Result`, or disparities (H, W), real numbers in pixels; NaN where there is no estimate.
    calibration
        The geometry of the pair, of the map's size.
    uncertainty
        Error bars of the disparities, (H, W), pixels, 0 or more; None: those of the result.
    yaw
        Degrees, 0 to 10, that the angle between the cameras may be off by. 0.01 is what a careful
        calibration of a stiff rig leaves, 0.2 px at a focal length of 1100 px; 0 if that angle is
        known better than the matching needs it.
    anchor
        A pixel whose distance is known, ``(x, y, depth)`` in the unit of the baseline, infinite for
        the sky: ``doffs`` becomes such that this pixel has this depth. A yaw adds to the error
        bars, then, only as far as it moves other columns by more or less than that one.
    offset
        In place of an anchor, what to add to all disparities, and its standard deviation, pixels,
        as `phasestereo.Rig.offset` has them from its own anchor. A yaw adds to the error bars,
        then, what it does beside the middle of the image.

    Returns
    -------
    DepthInterval
        ``depth``, ``near`` and ``far``, each float32 (H, W).

    Raises
    ------
    TypeError
        If an argument is of a wrong type or dtype.
    ValueError
        If shapes differ from each other or from the calibration's, there are no error bars, a
        number is out of range, or there is no estimate at the anchor.

    Notes
    -----
    The ends are ``near = fx B / (d + doffs + u)`` and ``far = fx B / (d + doffs - u)``. ``u`` is
    the uncertainty of the disparity plus the share of the yaw. The two are added, not their
    squares: the yaw is one and the same for all pixels of a rig, so that, whatever it is up to
    ``yaw``, 90 % of the pixels stay within their bars.

    An anchor takes that share away but for its own error bar, and for what is different in other
    columns: ``fx * tan(a) * abs(t**2 - t_anchor**2)`` pixels, where `a` is `yaw` or, if it is
    larger, the yaw that would explain what the anchor has changed.
    """
    values = as_disparities(disparity)
    bars = as_uncertainty(disparity, uncertainty, values.shape)
    if bars is None:
        raise ValueError(
            "uncertainty: got None, and a result without error bars; accepts an array, or a result "
            "that was matched with confidence=True"
        )
    if anchor is not None and offset is not None:
        raise ValueError("offset: got one beside an anchor; accepts one of them")
    found = ranging(values, calibration, uncertainty=bars, yaw=yaw, anchor=anchor)
    if offset is not None:
        found = _moved(found, offset)
    return found.interval(values, bars, np.arange(values.shape[1]))


def ranging(
    disparity: NDArray[Any],
    calibration: Calibration,
    *,
    uncertainty: NDArray[Any] | None,
    yaw: float,
    anchor: Anchor | None,
) -> Ranging:
    """Return what makes depths of disparities, with a yaw or an anchor; see `depth_interval`."""
    _check_calibration(calibration, disparity.shape)
    slope = calibration.cam1[0][0] * math.tan(math.radians(_checked_yaw(yaw)))
    if anchor is None:
        return Ranging(calibration, yaw, 0.0, (slope, slope, 0.0))

    x, y, depth = check_anchor(anchor, disparity.shape)
    found = float(disparity[y, x])
    own = 0.0 if uncertainty is None else float(uncertainty[y, x])
    if not (math.isfinite(found) and math.isfinite(own)):
        raise ValueError(f"anchor: got pixel ({x}, {y}), which has no estimate; accepts one of all")

    # What would put the pixel at its depth; a yaw that explains it moves the other columns, too.
    moved = calibration.baseline * calibration.focal / depth - found - calibration.doffs
    (focal, _, center), _, _ = calibration.cam1
    middle = ((x - found - center) / focal) ** 2
    left = max(slope, abs(moved) / (1 + middle))
    known = replace(calibration, doffs=calibration.doffs + moved)
    return Ranging(known, yaw, moved, (own, left, middle))


def _moved(found: Ranging, offset: tuple[float, float]) -> Ranging:
    """Return the same with an offset of all disparities and its standard deviation."""
    moved, deviation = (as_number("offset", one) for one in offset)
    if deviation < 0:
        raise ValueError(f"offset: got a standard deviation of {deviation:g}; accepts 0 or more")
    known = replace(found.calibration, doffs=found.calibration.doffs + moved)
    slope = max(found.share[1], abs(moved))
    return Ranging(known, found.yaw, moved, (_NINETY * deviation, slope, 0.0))


def as_disparities(disparity: Result | ArrayLike) -> NDArray[Any]:
    """Return the disparities of a result, or of what is a map itself."""
    given = disparity.disparity if isinstance(disparity, Result) else disparity
    return _as_map(given, "disparity")


def as_uncertainty(
    disparity: Result | ArrayLike, uncertainty: ArrayLike | None, size: tuple[int, ...]
) -> NDArray[Any] | None:
    """Return the error bars that were given, or else those of the result; None: there are none."""
    if uncertainty is None:
        return disparity.uncertainty if isinstance(disparity, Result) else None

    values = _as_map(uncertainty, "uncertainty")
    if values.shape != size:
        raise ValueError(f"uncertainty: got shape {values.shape}; accepts the map's {size}")
    if (values < 0).any():  # false for NaN
        raise ValueError(f"uncertainty: got {np.nanmin(values):g}; accepts 0 or more, or NaN")
    return values


def _as_map(given: ArrayLike, name: str) -> NDArray[Any]:
    values = as_array(given, name)
    if values.dtype.kind not in "iuf":
        raise TypeError(f"{name}: got dtype {values.dtype}; accepts real numbers")
    if values.ndim != 2:
        raise ValueError(f"{name}: got shape {values.shape}; accepts (H, W)")
    return values


def _checked_yaw(yaw: float) -> float:
    degrees = as_number("yaw", yaw, least=0)
    if degrees > _STEEPEST:
        raise ValueError(f"yaw: got {degrees:g}; accepts 0 to {_STEEPEST:g} degrees")
    return degrees


def check_anchor(anchor: Anchor, size: tuple[int, ...]) -> Anchor:
    """Return the column, the row and the depth of an anchor within a map of so many pixels."""
    if not isinstance(anchor, tuple | list) or len(anchor) != 3:
        raise ValueError(f"anchor: got {anchor!r}; accepts (x, y, depth)")

    x, y, depth = anchor
    column = as_integer("anchor", x, least=0, most=size[1] - 1)
    row = as_integer("anchor", y, least=0, most=size[0] - 1)
    # What is infinitely far away, such as the sky, is the best anchor of all.
    distance = math.inf if depth == math.inf else as_number("anchor", depth, positive=True)
    return column, row, distance


def _check_calibration(calibration: Calibration, shape: tuple[int, ...]) -> None:
    """Refuse what is no calibration, or one of another size."""
    if not isinstance(calibration, Calibration):
        got = type(calibration).__name__
        raise TypeError(f"calibration: got {got}; accepts a phasestereo.io.Calibration")
    calibration.check_size(shape)

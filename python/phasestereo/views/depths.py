"""Depths with error bars, which cover the matching and the angle between the cameras.

An unknown yaw of the right camera shifts all disparities by nearly the same amount,
`focal * tan(yaw) * (1 + t**2)` pixels at `t = (x - d - cx1) / fx`. It moves no row, so a pair
cannot reveal it: the caller passes a bound, or one known distance limits it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._images import Map, Mask, as_mask, as_numbers
from phasestereo._numbers import accept, as_integer, as_number, check_type
from phasestereo.io.calibration import Calibration, check_pixels
from phasestereo.result import KEEPS, Keep, Result

Anchor: TypeAlias = tuple[int, int, float]
"""Column and row of a pixel of the left image, and its depth, which may be infinite."""

YAW = 0.01
"""Degrees of yaw that a calibration may be off by, unless more is known.

It is 0.2 px at a focal length of 1100 px, as much as the corners of a calibration target are off
by; a rig that was knocked or has warmed up may be off by ten times as much.
"""

_NINETY = 1.645  # standard deviations on either side hold 90 %
_STEEPEST = 10.0  # degrees; a rig that is off by more is another rig
_BAND = 64  # rows whose depths are computed at a time: float64 copies of a map are large


class DepthInterval(NamedTuple):
    """Depths and the ends of their error bars, each float32 (H, W), in the unit of the baseline.

    Attributes
    ----------
    depth
        Depth; NaN where the estimate is missing or not kept. Where ``far`` is infinite, the error
        bar includes the disparity at infinity and the depth is not reliable: it is infinite, unless
        you asked for finite depths only.
    near, far
        The ends of the interval that holds the true depth with a probability of 90 %; infinite
        where the disparity of that end is not positive, NaN without an estimate. ``far`` is further
        from ``depth`` than ``near`` is.

    Examples
    --------
    >>> found = ps.depth_interval(result, calibration)
    >>> found.near <= found.depth  # float32 (H, W), in the unit of the baseline
    """

    depth: Map
    near: Map
    far: Map

    @property
    def at_infinity(self) -> Mask:
        """Where the scene may be infinitely far away, like the sky, bool (H, W)."""
        return np.isposinf(self.depth)


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """The choice of pixels for depths and points: the same options in every output.

    Parameters
    ----------
    keep
        As in `phasestereo.Result.kept`. Except for ``"all"``, the error bar of a depth must also
        have a far end: a depth that may be infinite is not reliable. A map that is not a `Result`
        has no such labels, and keeps all of its estimates.
    min_depth, max_depth
        The nearest and the farthest depth, in the unit of the baseline; None: any.
    decimate
        Side of the blocks, in pixels, that become one pixel each: the kept pixel with the median
        disparity. 1: all pixels.

    Raises
    ------
    TypeError, ValueError
        If a value is of the wrong type or out of range.
    """

    keep: Keep = "trusted"
    min_depth: float | None = None
    max_depth: float | None = None
    decimate: int = 1

    def __post_init__(self) -> None:
        """Refuse values out of range."""
        accept("keep", self.keep, KEEPS)
        ends = "min_depth", "max_depth"
        low, high = (
            None if value is None else as_number(name, value, positive=True)
            for name, value in zip(ends, (self.min_depth, self.max_depth), strict=True)
        )
        if low is not None and high is not None and low > high:
            raise ValueError(
                f"min_depth: got {low:g}; accepts at most max_depth, which is {high:g}"
            )
        as_integer("decimate", self.decimate, least=1)

    def within(self, depth: Map) -> Mask:
        """Return a mask of the depths that are finite and in the wanted range."""
        low = 0.0 if self.min_depth is None else self.min_depth
        high = math.inf if self.max_depth is None else self.max_depth
        return np.isfinite(depth) & (depth >= low) & (depth <= high)


@dataclass(frozen=True, slots=True, eq=False)
class Depths:
    """The depths of the kept pixels.

    Parameters
    ----------
    depth
        float32 (H, W); NaN for all other pixels.
    near, far
        The ends of the error bars, as in `DepthInterval`; None: no error bars.
    calibration
        The geometry of a map of this size; an anchor has changed its ``doffs``.
    pixels
        For each pixel, its pixel of the left image, as an index into the flat map; None: the map
        has the size of the image.
    """

    depth: Map
    near: Map | None
    far: Map | None
    calibration: Calibration
    pixels: NDArray[np.intp] | None

    def picked(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values at these pixels of a map or an image of the left image's size."""
        if self.pixels is None:
            return values
        return values.reshape(-1, *values.shape[2:])[self.pixels]


@dataclass(frozen=True, slots=True)
class Ranging:
    """The converter from disparities with error bars to depths with error bars.

    Parameters
    ----------
    calibration
        The geometry; an anchor has changed its ``doffs``.
    yaw
        Possible error of the angle between the cameras, degrees.
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
        """Describe the accuracy of depths apart from the matching, in degrees and in pixels."""
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

        # The yaw is the same for all pixels, so it adds to the bars, not to their squares.
        own = np.asarray(uncertainty, dtype=np.float64)
        bar = own + constant + slope * np.abs(t**2 - middle)
        shift = given + self.calibration.doffs
        depth = self.calibration.depth(given)
        return DepthInterval(depth, self._end(shift + bar), self._end(shift - bar))

    def _end(self, shift: NDArray[np.float64]) -> Map:
        """Return the depth of an end: infinite where it is not in front of the cameras."""
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
    keep: Keep = "trusted",
    min_depth: float | None = None,
    max_depth: float | None = None,
    decimate: int = 1,
    finite: bool = False,
) -> DepthInterval:
    """Return the depth of every kept pixel, and the ends of its error bar.

    Parameters
    ----------
    disparity
        A `Result`, or disparities (H, W), real numbers in pixels; NaN where there is no estimate.
    calibration
        The geometry of the pair, of the map's size.
    uncertainty
        Error bars of the disparities, (H, W), pixels, 0 or more; None: those of the result.
    yaw
        Possible error of the angle between the cameras, degrees, 0 to 10. A careful calibration of
        a stiff rig leaves 0.01, which is 0.2 px at a focal length of 1100 px; 0 if you know that
        angle better than the matching needs it.
    anchor
        A pixel of known distance, ``(x, y, depth)`` in the unit of the baseline, infinite for the
        sky: ``doffs`` changes to give this pixel this depth. A yaw then adds to the error bars
        only as far as it moves other columns by more or less than that one.
    offset
        In place of an anchor, the amount to add to all disparities, and its standard deviation,
        pixels, as `phasestereo.Rig.offset` has them from its own anchor. A yaw then adds to the
        error bars only its effect away from the middle of the image.
    keep
        Which estimates of a result to keep: ``"trusted"``, ``"checked"`` (fewer, more accurate) or
        ``"all"``, as in `phasestereo.Result.kept`. A plain map has no such labels, and keeps all.
    min_depth, max_depth
        The nearest and the farthest depth to keep, more than 0, in the unit of the baseline; None:
        any.
    decimate
        Side of the blocks, in pixels, that become one pixel each, 1 or more: the kept pixel with
        the median disparity. `phasestereo.io.Calibration.decimated` has the geometry.
    finite
        Whether to keep only finite depths. By default a depth is infinite if it may be, like that
        of the sky: where the error bar of the disparity reaches that of infinity,
        ``d + doffs - u <= 0``. With `max_depth`, no depth is infinite.

    Returns
    -------
    DepthInterval
        ``depth``, ``near`` and ``far``, each float32 (H // decimate, W // decimate); NaN where the
        estimate is missing or not kept.

    Raises
    ------
    TypeError
        If an argument is of a wrong type or dtype.
    ValueError
        If shapes differ from each other or from the calibration's, there are no error bars, a
        number is out of range, or there is no estimate at the anchor.

    Examples
    --------
    >>> depth, near, far = ps.depth_interval(result, calibration, max_depth=5000)

    Notes
    -----
    The ends are ``near = fx B / (d + doffs + u)`` and ``far = fx B / (d + doffs - u)``. ``u`` is
    the uncertainty of the disparity plus the share of the yaw. The two add up, not their squares:
    all pixels of a rig share one yaw, so for any yaw up to ``yaw``, 90 % of the pixels stay within
    their bars.

    An anchor removes that share except for its own error bar and for the difference in other
    columns: ``fx * tan(a) * abs(t**2 - t_anchor**2)`` pixels, where `a` is `yaw` or, if it is
    larger, the yaw that would explain the change by the anchor.
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
    geometry = ranging(values, calibration, uncertainty=bars, yaw=yaw, anchor=anchor)
    if offset is not None:
        geometry = _moved(geometry, offset)
    if not isinstance(finite, bool):
        raise TypeError(f"finite: got {finite!r:.80}; accepts True or False")
    selection = Selection(keep=keep, min_depth=min_depth, max_depth=max_depth, decimate=decimate)
    found = depths_of(disparity, geometry, selection, uncertainty=bars, finite=finite)
    return DepthInterval(found.depth, cast("Map", found.near), cast("Map", found.far))


def depths_of(
    disparity: Result | ArrayLike,
    geometry: Ranging,
    selection: Selection,
    *,
    uncertainty: NDArray[Any] | None = None,
    mask: ArrayLike | None = None,
    finite: bool = True,
) -> Depths:
    """Return the depths of the kept pixels, and the ends of their error bars.

    Parameters
    ----------
    disparity
        A `Result`, or disparities (H, W), pixels.
    geometry
        The converter to depths.
    selection
        Which to keep.
    uncertainty
        Error bars (H, W), pixels; None: those of the result, if it has any.
    mask
        bool (H, W), True = wanted; None: all are.
    finite
        Whether to keep only finite depths; otherwise a depth that may be infinite is infinite,
        unless the selection has a largest one.

    Raises
    ------
    TypeError, ValueError
        If the mask is not bool or of another size, or the map is smaller than a block.
    """
    values = as_disparities(disparity)
    bars = as_uncertainty(disparity, uncertainty, values.shape)
    maps = _depths(geometry, values, bars)
    at_infinity = np.isfinite(values) & ~np.isfinite(maps[-1])  # by the far end of the bar
    wanted = selection.within(maps[0])
    if isinstance(disparity, Result) and bars is not None and selection.keep != "all":
        wanted &= ~at_infinity
    if not finite and selection.max_depth is None:
        maps[0][at_infinity] = np.inf
        wanted |= at_infinity
    if isinstance(disparity, Result):
        wanted &= disparity.kept(selection.keep)
    valid = as_mask(mask, values.shape, "mask")
    if valid is not None:
        wanted &= valid

    for found in maps:
        found[~wanted] = np.nan
    pixels, small = None, geometry.calibration
    if selection.decimate > 1:
        small = small.decimated(selection.decimate)
        pixels = _medians(values, wanted, selection.decimate)
        maps = [found.ravel()[pixels] for found in maps]
    near, far = (None, None) if bars is None else maps[1:]
    return Depths(maps[0], near, far, small, pixels)


def _depths(geometry: Ranging, values: NDArray[Any], bars: NDArray[Any] | None) -> list[Map]:
    """Return depths and, with error bars, their near and far ends."""
    maps = [np.empty(values.shape, np.float32) for _ in range(1 if bars is None else 3)]
    columns = np.arange(values.shape[1])
    for top in range(0, len(values), _BAND):
        rows = slice(top, top + _BAND)
        if bars is None:
            maps[0][rows] = geometry.calibration.depth(values[rows])
            continue
        for found, part in zip(
            maps, geometry.interval(values[rows], bars[rows], columns), strict=True
        ):
            found[rows] = part
    return maps


def _medians(values: NDArray[Any], kept: Mask, n: int) -> NDArray[np.intp]:
    """Return the pixel with the median kept disparity for each block of n x n pixels.

    For an even number it is the lower of the two in the middle: a measured disparity, not one
    between two surfaces.
    """
    rows, cols = values.shape[0] // n, values.shape[1] // n
    whole = np.where(kept, values, np.inf)[: rows * n, : cols * n]
    blocks = whole.reshape(rows, n, cols, n).swapaxes(1, 2).reshape(rows, cols, n * n)
    middle = np.maximum(np.isfinite(blocks).sum(axis=2) - 1, 0) // 2
    order = np.argsort(blocks, axis=2, kind="stable")
    y, x = np.divmod(np.take_along_axis(order, middle[:, :, np.newaxis], 2)[:, :, 0], n)
    top, left = np.ogrid[: rows * n : n, : cols * n : n]
    return (top + y) * values.shape[1] + left + x


def ranging(
    disparity: NDArray[Any],
    calibration: Calibration,
    *,
    uncertainty: NDArray[Any] | None,
    yaw: float,
    anchor: Anchor | None,
) -> Ranging:
    """Return the converter from disparities to depths; see `depth_interval`."""
    check_type("calibration", calibration, Calibration, "a phasestereo.io.Calibration")
    calibration.check_size(disparity.shape)
    degrees = as_number("yaw", yaw, least=0, most=_STEEPEST)
    slope = calibration.cam1[0][0] * math.tan(math.radians(degrees))
    if anchor is None:
        return Ranging(calibration, yaw, 0.0, (slope, slope, 0.0))

    x, y, depth = check_anchor(anchor, disparity.shape)
    found = float(disparity[y, x])
    own = 0.0 if uncertainty is None else float(uncertainty[y, x])
    if not (math.isfinite(found) and math.isfinite(own)):
        raise ValueError(f"anchor: got pixel ({x}, {y}), which has no estimate; accepts one of all")

    # This puts the pixel at its depth; a yaw that explains it also moves the other columns.
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
    """Return the disparities of a result, or the map itself."""
    given = disparity.disparity if isinstance(disparity, Result) else disparity
    values = as_numbers(given, "disparity")
    check_pixels(values)
    return values


def as_uncertainty(
    disparity: Result | ArrayLike, uncertainty: ArrayLike | None, size: tuple[int, ...]
) -> NDArray[Any] | None:
    """Return the given error bars, or else those of the result; None: no error bars."""
    if uncertainty is None:
        return disparity.uncertainty if isinstance(disparity, Result) else None

    values = as_numbers(uncertainty, "uncertainty", "iuf", size)
    if (values < 0).any():  # false for NaN
        raise ValueError(f"uncertainty: got {np.nanmin(values):g}; accepts 0 or more, or NaN")
    return values


def check_anchor(anchor: Anchor, size: tuple[int, ...]) -> Anchor:
    """Return the column, the row and the depth of an anchor within a map of this size."""
    if not isinstance(anchor, tuple | list) or len(anchor) != 3:
        raise ValueError(f"anchor: got {anchor!r:.80}; accepts (x, y, depth)")

    x, y, depth = anchor
    column = as_integer("anchor", x, least=0, most=size[1] - 1)
    row = as_integer("anchor", y, least=0, most=size[0] - 1)
    # A pixel at infinity, such as the sky, is the best anchor of all.
    distance = math.inf if depth == math.inf else as_number("anchor", depth, positive=True)
    return column, row, distance

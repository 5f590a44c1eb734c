"""Moves pairs off their rows: the right camera is lower, turned, of another focal length.

Steps always resample the right image, and move its truth along. Disparities belong to the pixels of
the left image, so they stay exact. If the left camera is off, the right image moves the other way.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from phasestereo_bench.arrays import Plane
from phasestereo_bench.datasets import Pair
from phasestereo_bench.degradation import quantize

_WAVES = 1.5  # waves of a rolling shutter that shakes, over the height of the image
_ROUNDS = 16  # rounds of the fixed point; each leaves at most 6 % of the error before it


@dataclass(frozen=True, slots=True)
class Misaligned:
    """A step that moves the right image like a rig whose right camera is off by this.

    The point at (u, v) from the center of the image, (W - 1) / 2 and (H - 1) / 2, first moves
    outward by ``1 + distortion (u^2 + v^2) / W^2``, then around the center and outward by `turn`
    and `focal`, then by the keystone, then down, and at last to the left by `margin`.

    Parameters
    ----------
    down
        Rows lower, px.
    turn
        Clockwise as displayed, degrees.
    focal
        The other camera's focal length times 1 + this.
    keystone
        Rows lower in the lower right corner, px, as of a camera that looks sideways.
    distortion
        Radial distortion of the third order; the corner of a 4:3 image is at 0.39 of its unit.
    wobble
        Amplitude of waves along the rows' order, px: a rolling shutter that shakes.
    margin
        Px to the left for all, so that no disparity becomes negative if columns move, too. The pair
        loses this number of columns; the search needs twice this number of extra disparities.
    """

    down: float = 0.0
    turn: float = 0.0
    focal: float = 0.0
    keystone: float = 0.0
    distortion: float = 0.0
    wobble: float = 0.0
    margin: int = 0

    def __call__(self, pair: Pair, side: str) -> Pair:
        """Return the pair of this rig; if the left camera is off, all goes the other way."""
        sign = 1.0 if side == "right" else -1.0
        size = pair.right.shape[:2]
        rows, cols = size
        y, x = np.mgrid[0:rows, 0:cols].astype(np.float64)
        right = quantize(sampled(pair.right, *self.came_from(x, y, sign)), np.uint8)

        if pair.truth is None:
            return replace(pair, right=right)

        at_x, at_y = self.moved(x - pair.truth, y, size, sign)
        seen = (at_x >= 0) & (at_x <= cols - 1) & (at_y >= 0) & (at_y <= rows - 1)

        return replace(
            pair,
            right=right,
            truth=(x - at_x).astype(np.float32),
            truth_right=None,
            masks={region: mask & seen for region, mask in pair.masks.items()},
            num_disparities=min(pair.num_disparities + 2 * self.margin, cols),
        )

    def moved(
        self, x: Plane, y: Plane, size: tuple[int, int], sign: float = 1.0
    ) -> tuple[Plane, Plane]:
        """Return the new places of these places in the right image; `sign` is 1 or -1."""
        rows, cols = size
        middle_x, middle_y = (cols - 1) / 2, (rows - 1) / 2
        u, v = x - middle_x, y - middle_y

        outward = 1 + sign * self.distortion * (u * u + v * v) / cols**2
        u, v = u * outward, v * outward

        turn, scale = np.deg2rad(sign * self.turn), 1 + sign * self.focal
        u, v = (
            scale * (np.cos(turn) * u - np.sin(turn) * v),
            scale * (np.sin(turn) * u + np.cos(turn) * v),
        )

        slant = sign * self.keystone / (middle_x * middle_y)
        u, v = u + slant * (u * u - middle_x**2 / 3), v + slant * u * v

        waves = sign * self.wobble * np.sin(2 * np.pi * _WAVES * y / rows)
        return middle_x + u - self.margin, middle_y + v + sign * self.down + waves

    def came_from(self, x: Plane, y: Plane, sign: float = 1.0) -> tuple[Plane, Plane]:
        """Return the former places of these places, by a fixed point."""
        size = x.shape[0], x.shape[1]
        from_x, from_y = x + self.margin, y.copy()

        for _ in range(_ROUNDS):
            at_x, at_y = self.moved(from_x, from_y, size, sign)
            from_x, from_y = from_x - (at_x - x), from_y - (at_y - y)

        return from_x, from_y


@dataclass(frozen=True, slots=True)
class Bent:
    """A step that bends both images alike, and moves the right one to the left by a margin.

    Parameters
    ----------
    off
        A function from rows and columns to the offsets of a bent image's pixels from their source
        pixels, px along x and y.
    margin
        As in `Misaligned`.
    """

    off: Callable[[int, int], tuple[Plane, Plane]]
    margin: int = 8

    def __call__(self, pair: Pair, _side: str) -> Pair:
        """Return the pair of two such lenses; the truth comes from the nearest pixel."""
        rows, cols = pair.left.shape[:2]
        y, x = np.mgrid[0:rows, 0:cols].astype(np.float64)
        off_x, off_y = self.off(rows, cols)
        seen_x, seen_y = (sampled(off, x + self.margin, y, order=1) for off in (off_x, off_y))
        right = sampled(pair.right, x + self.margin + seen_x, y + seen_y)
        bent = replace(
            pair,
            left=quantize(sampled(pair.left, x + off_x, y + off_y), np.uint8),
            right=quantize(right, np.uint8),
        )
        if pair.truth is None:
            return bent

        shown_y = np.clip(np.rint(y + off_y), 0, rows - 1).astype(int)
        shown_x = np.clip(np.rint(x + off_x), 0, cols - 1).astype(int)
        match_x, match_y = x + off_x - pair.truth[shown_y, shown_x], y + off_y
        at_x, at_y = match_x, match_y
        for _ in range(_ROUNDS):
            at = np.nan_to_num(at_x), np.nan_to_num(at_y)
            at_x, at_y = (
                match_x - sampled(off_x, *at, order=1),
                match_y - sampled(off_y, *at, order=1),
            )

        disparity = (x - at_x + self.margin).astype(np.float32)
        inside = (disparity <= x) & (at_x < cols) & (at_y >= 0) & (at_y < rows)
        return replace(
            bent,
            truth=disparity,
            truth_right=None,
            masks={name: mask[shown_y, shown_x] & inside for name, mask in pair.masks.items()},
            num_disparities=min(pair.num_disparities + 2 * self.margin, cols),
        )


def barrel(rows: int, cols: int, *, bend: float) -> tuple[Plane, Plane]:
    """Return the offsets by a lens with this radial distortion, as in `Misaligned`, px."""
    y, x = np.mgrid[0:rows, 0:cols].astype(np.float64)
    from_x, from_y = Misaligned(distortion=bend).came_from(x, y)
    return from_x - x, from_y - y


def sampled(image: NDArray[Any], x: Plane, y: Plane, *, order: int = 3) -> Plane:
    """Return an image at these places: cubic B-splines or less, borders continued by reflection."""
    sampled = np.empty(image.shape)
    for channel in np.ndindex(image.shape[2:]):
        plane = image[..., *channel].astype(np.float64)
        sampled[..., *channel] = ndimage.map_coordinates(plane, (y, x), order=order, mode="reflect")
    return sampled

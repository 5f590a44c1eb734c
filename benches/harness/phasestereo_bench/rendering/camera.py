"""Defines the two cameras of a rendered pair, and the rays they cast."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from phasestereo_bench.arrays import Array

LEFT, RIGHT = 0, 1
RAYS_IN_BAND = 2**17  # arrays of a band stay in the cache, and memory stays flat


class Rays(NamedTuple):
    """Half-lines ``origin + depth * (x, y, z)``, components broadcasting against each other.

    Directions have length one along the optical axis, so `depth` is the stereo depth. The
    last two axes are an image's: x is (..., rows or 1, columns), y and z are (..., rows, 1).
    """

    origin: tuple[Any, Any, Any]
    x: Array
    y: Array
    z: Array

    def window(self, rows: slice, cols: slice) -> "Rays":
        """Cut a window out of the rays of an image."""
        x = self.x[..., rows if self.x.shape[-2] > 1 else slice(None), cols]
        return Rays(self.origin, x, self.y[..., rows, :], self.z[..., rows, :])

    def at(self, depth: Array) -> tuple[Array, Array, Array]:
        """Return the points at a depth on each ray."""
        x, y, z = self.origin
        return x + depth * self.x, y + depth * self.y, z + depth * self.z


@dataclass(frozen=True, slots=True)
class Camera:
    """Two pinhole cameras side by side, looking a little down on the scene.

    World coordinates: x to the right, y up from the floor, z away; the left camera is `eye` above
    the floor at `x` and `z`. The baseline follows from the disparity `near_disparity` (px) of the
    depth `near`.
    """

    height: int
    width: int
    eye: float = 0.75
    pitch: float = math.radians(12)
    near: float = 1.0
    near_disparity: float = 0.0
    x: float = 0.0
    z: float = 0.0

    @property
    def focal(self) -> float:
        """Focal length in pixels: 49 degrees across an image that is at most as high as 4:3."""
        return 1.1 * max(self.width, self.height * 4 / 3)

    @property
    def focal_baseline(self) -> float:
        """Disparity times depth, that is, focal length times baseline."""
        return self.near_disparity * self.near

    def shrunk(self, longest: int) -> "Camera":
        """Return the same cameras with images whose longer side has this many pixels."""
        shrink = longest / max(self.height, self.width)
        height, width = (max(1, round(n * shrink)) for n in (self.height, self.width))
        return replace(self, height=height, width=width)

    def rays(self, x: Array, y: Array, side: int) -> Rays:
        """Return rays through columns x and rows y (px, pixel centers are whole) of a view."""
        across = (x - (self.width - 1) / 2) / self.focal
        down = (y - (self.height - 1) / 2) / self.focal
        cos, sin = math.cos(self.pitch), math.sin(self.pitch)
        origin = (self.x + side * self.focal_baseline / self.focal, self.eye, self.z)
        return Rays(origin, across, -down * cos - sin, cos - down * sin)

    def project(self, points: Array, side: int) -> tuple[Array, Array, Array]:
        """Return columns, rows (px) and depths of world points (n, 3)."""
        cos, sin = math.cos(self.pitch), math.sin(self.pitch)
        eye = [self.x + side * self.focal_baseline / self.focal, self.eye, self.z]
        x, y, z = (points - eye).T
        depth = z * cos - y * sin
        with np.errstate(divide="ignore", invalid="ignore"):
            column, row = x / depth, (-y * cos - z * sin) / depth

        return (
            column * self.focal + (self.width - 1) / 2,
            row * self.focal + (self.height - 1) / 2,
            depth,
        )

    def bands(self, rays_per_pixel: int = 1) -> Iterator[tuple[slice, Array, Array]]:
        """Yield bands of rows: the slice, columns (1, W) and rows (n, 1) of the pixel centers."""
        columns = np.arange(self.width, dtype=np.float64)[None]
        step = max(1, RAYS_IN_BAND // (self.width * rays_per_pixel))

        for start in range(0, self.height, step):
            stop = min(start + step, self.height)
            yield slice(start, stop), columns, np.arange(start, stop, dtype=np.float64)[:, None]

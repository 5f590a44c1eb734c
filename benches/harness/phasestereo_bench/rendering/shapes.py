"""Defines surfaces with a closed-form intersection: flat pieces, ellipsoids, cylinders, cones.

Vectors are plain floats: NumPy's own float64 scalars would turn float32 rays into float64.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from phasestereo_bench.arrays import Array
from phasestereo_bench.rendering.camera import Rays

Vector = tuple[float, float, float]


class Chart(NamedTuple):
    """The place of a point on its surface (world units), and the direction it faces there."""

    u: Array
    v: Array
    normal: tuple[Any, Any, Any]


class Shape(Protocol):
    """A thing that is visible and throws a shadow."""

    def hit(self, rays: Rays) -> Array:
        """Return the depths where rays first meet the surface; not finite or <= 0 if they miss."""
        ...

    def chart(self, x: Array, y: Array, z: Array) -> Chart:
        """Return the surface coordinates of points on it."""
        ...

    def corners(self) -> NDArray[np.float64]:
        """Return points (n, 3) whose convex hull holds the surface."""
        ...


def _first(square: Array, half: Array, root: Array) -> Array:
    """Solve ``square t^2 + 2 half t + c = 0`` for the first t > 0; root = half^2 - square c."""
    near: Array = (-half - np.sqrt(root)) / square
    return np.where(near > 0, near, (-half + np.sqrt(root)) / square)


@dataclass(frozen=True, slots=True)
class Patch:
    """A flat piece: center + u * right + v * up, the axes orthonormal, facing right x up.

    `outline` is "rectangle", "ellipse" or "leaf", which is pointed at both ends of u.
    """

    center: Vector
    right: Vector
    up: Vector
    half_width: float
    half_height: float
    outline: str = "rectangle"

    @property
    def normal(self) -> Vector:
        """Unit vector toward the lit side."""
        (a, b, c), (d, e, f) = self.right, self.up
        return b * f - c * e, c * d - a * f, a * e - b * d

    def hit(self, rays: Rays) -> Array:
        """See `Shape.hit`."""
        nx, ny, nz = self.normal
        ox, oy, oz = (c - o for c, o in zip(self.center, rays.origin, strict=True))
        # Divide the distance to the plane, along its normal, by the ray's advance per unit of
        # depth.
        depth = (nx * ox + ny * oy + nz * oz) / ((ny * rays.y + nz * rays.z) + nx * rays.x)

        u, v, _ = self.chart(*rays.at(depth))
        a, b = u / self.half_width, v / self.half_height

        if self.outline == "rectangle":  # a hair larger, so no ray slips between two sides of a box
            inside = np.maximum(abs(a), abs(b)) <= 1 + 1e-6
        elif self.outline == "ellipse":
            inside = a * a + b * b <= 1
        else:
            inside = abs(b) <= 1 - a * a

        return np.where(inside, depth, np.inf)

    def chart(self, x: Array, y: Array, z: Array) -> Chart:
        """See `Shape.chart`."""
        x, y, z = (p - c for p, c in zip((x, y, z), self.center, strict=True))
        u, v = (e[0] * x + e[1] * y + e[2] * z for e in (self.right, self.up))
        return Chart(u, v, self.normal)

    def corners(self) -> NDArray[np.float64]:
        """See `Shape.corners`."""
        across = self.half_width * np.array(self.right)
        along = self.half_height * np.array(self.up)
        return np.array([self.center + i * across + j * along for i in (-1, 1) for j in (-1, 1)])


@dataclass(frozen=True, slots=True)
class Ellipsoid:
    """An ellipsoid with its axes along the world's."""

    center: Vector
    radii: Vector

    def hit(self, rays: Rays) -> Array:
        """See `Shape.hit`."""
        # In units of the radii, the ellipsoid is a unit sphere.
        qx, qy, qz = (
            (o - c) / r for o, c, r in zip(rays.origin, self.center, self.radii, strict=True)
        )
        x, y, z = (d / r for d, r in zip((rays.x, rays.y, rays.z), self.radii, strict=True))

        square = (y * y + z * z) + x * x
        half = (qy * y + qz * z) + qx * x
        root = half * half - square * (qx * qx + qy * qy + qz * qz - 1)
        return _first(square, half, root)

    def chart(self, x: Array, y: Array, z: Array) -> Chart:
        """See `Shape.chart`; u, v keep their length along lines from the point facing -z."""
        x, y, z = ((p - c) / r for p, c, r in zip((x, y, z), self.center, self.radii, strict=True))

        across = np.hypot(x, y)
        spread = np.arctan2(across, -z) / np.maximum(across, 1e-6)
        u, v = self.radii[0] * x * spread, self.radii[1] * y * spread

        # The gradient of the ellipsoid's equation is normal to it.
        x, y, z = (p / r for p, r in zip((x, y, z), self.radii, strict=True))
        length = np.sqrt(x * x + y * y + z * z)
        return Chart(u, v, (x / length, y / length, z / length))

    def corners(self) -> NDArray[np.float64]:
        """See `Shape.corners`."""
        signs = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
        return np.array(self.center) + signs * self.radii


@dataclass(frozen=True, slots=True)
class Frustum:
    """The side of an upright cylinder or cone; `foot` is the center of its lower rim."""

    foot: Vector
    height: float
    low_radius: float
    high_radius: float

    @property
    def slope(self) -> float:
        """Growth of the radius with height."""
        return (self.high_radius - self.low_radius) / self.height

    def hit(self, rays: Rays) -> Array:
        """See `Shape.hit`."""
        qx, qy, qz = (o - c for o, c in zip(rays.origin, self.foot, strict=True))
        slope = self.slope
        # The cone's radius at the height of the camera; square, half and root solve
        # x^2 + z^2 = (radius at y)^2 along the ray.
        radius = self.low_radius + slope * qy

        square = (rays.z**2 - (slope * rays.y) ** 2) + rays.x**2
        half = (qz * rays.z - slope * radius * rays.y) + qx * rays.x
        root = half * half - square * (qx * qx + qz * qz - radius * radius)
        depth = _first(square, half, root)

        # The endless cone is cut at both rims.
        above = qy + depth * rays.y
        return np.where((above >= 0) & (above <= self.height), depth, np.inf)

    def chart(self, x: Array, y: Array, z: Array) -> Chart:
        """See `Shape.chart`."""
        x, y, z = (p - c for p, c in zip((x, y, z), self.foot, strict=True))
        radius, flat = np.hypot(x, z), 1 / math.hypot(1, self.slope)
        u = max(self.low_radius, self.high_radius) * np.arctan2(x, -z)
        return Chart(u, y, (x / radius * flat, -self.slope * flat, z / radius * flat))

    def corners(self) -> NDArray[np.float64]:
        """See `Shape.corners`."""
        r = max(self.low_radius, self.high_radius)
        sides = [(i * r, y, j * r) for i in (-1, 1) for y in (0, self.height) for j in (-1, 1)]
        return np.array(self.foot) + sides

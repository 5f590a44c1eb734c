"""Turns surfaces into photographs: sun, sky and shadows, exposure, tones and sensor noise."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phasestereo_bench.arrays import Array
from phasestereo_bench.rendering.camera import LEFT, Camera, Rays
from phasestereo_bench.rendering.casting import Window, cast, windows
from phasestereo_bench.rendering.shapes import Chart, Patch, Shape, Vector
from phasestereo_bench.rendering.textures import Texture, look_up

Points = tuple[Array, Array, Array]

# Offsets of the rays in a pixel. Of the lattices with eight distinct rows and columns, this one has
# its points farthest apart, so near-upright edges get eight levels of anti-aliasing.
LATTICE = np.array([((k + 0.5) / 8 - 0.5, (3 * k % 8 + 0.5) / 8 - 0.5) for k in range(8)])
RAY_SPACING = 0.5  # px: the texels to look up
SENSOR_NOISE = 1.0  # gray levels
VIGNETTE = 0.2  # share of the light lost in the corners
GAMMA = 2.2
MIDDLE_GRAY = 0.42  # of white, after gamma

SUN: Vector = (-0.769, 0.577, -0.275)  # unit vector toward it: left, above, a little in front
SUNLIGHT, SKYLIGHT = 1.3, 0.4
SUN_RAYS = 7
LIGHTMAP_SIZE = 512
TOUCHING = 1e-3  # world units: a surface this close does not shadow itself


@dataclass(frozen=True, slots=True, eq=False)
class Lightmap:
    """The light on a large flat piece, (n, n): v and u from minus to plus its half sizes."""

    light: NDArray[np.float32]
    half_width: float
    half_height: float

    def at(self, u: Array, v: Array) -> Array:
        """Return the light at surface coordinates, interpolated bilinearly."""
        n = self.light.shape[0]
        x = np.clip((u / self.half_width + 1) * (n / 2) - 0.5, 0, n - 1.001)
        y = np.clip((v / self.half_height + 1) * (n / 2) - 0.5, 0, n - 1.001)
        column, row = x.astype(np.intp), y.astype(np.intp)
        across, along = x - column, y - row
        light, corner = self.light.ravel(), row * n + column

        upper = light[corner] * (1 - across) + light[corner + 1] * across
        lower = light[corner + n] * (1 - across) + light[corner + n + 1] * across
        return upper * (1 - along) + lower * along


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A shape and its material."""

    shape: Shape
    texture: Texture
    shift: tuple[float, float] = (0.0, 0.0)  # of the texture on it, world units
    thin: bool = False  # lit from both sides, as leaves are
    light: Lightmap | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Scenery:
    """Everything visible, and the detail finer than any texture that covers all of it.

    No depth in either view is below `near`.
    """

    surfaces: list[Surface]
    detail: Texture
    near: float

    @property
    def shapes(self) -> list[Shape]:
        """The bare geometry."""
        return [surface.shape for surface in self.surfaces]


def photograph(
    scenery: Scenery,
    camera: Camera,
    side: int,
    exposure: float,
    rng: np.random.Generator,
    *,
    noise: float = SENSOR_NOISE,
) -> NDArray[np.uint8]:
    """Photograph one view: a lens that darkens the corners, film-like tones, noise."""
    bounds = windows(scenery.shapes, camera, side)
    picture = np.empty((camera.height, camera.width, 3), dtype=np.uint8)
    center_x, center_y = (camera.width - 1) / 2, (camera.height - 1) / 2
    dx, dy = LATTICE.T[:, :, None, None]

    for band, columns, rows in camera.bands(len(LATTICE)):
        x, y = (columns + dx).astype(np.float32), (rows + dy).astype(np.float32)
        light = _radiance(scenery, camera, camera.rays(x, y, side), bounds, band.start).mean(axis=0)

        corner = ((columns - center_x) ** 2 + (rows - center_y) ** 2) / (center_x**2 + center_y**2)
        light *= (exposure * (1 - VIGNETTE * corner))[..., None].astype(np.float32)

        # As on film, bright light saturates smoothly.
        tones = 255 * (1 - np.exp(-light)) ** (1 / GAMMA)
        tones += rng.normal(0.0, noise, tones.shape)
        picture[band] = np.clip(np.rint(tones), 0, 255)

    return picture


def exposure_of(scene: Scenery, camera: Camera, *, gray: float = MIDDLE_GRAY) -> float:
    """Find the exposure that makes the median of the left view a gray, from a thumbnail."""
    thumbnail = camera.shrunk(96)
    x = np.arange(thumbnail.width, dtype=np.float32)[None]
    y = np.arange(thumbnail.height, dtype=np.float32)[:, None]
    bounds = windows(scene.shapes, thumbnail, LEFT)
    light = _radiance(scene, thumbnail, thumbnail.rays(x, y, LEFT), bounds, 0)

    # Solve the tones of `photograph` for the light that comes out as that gray.
    return -math.log(1 - gray**GAMMA) / float(np.median(light))


def light_falling_on(patch: Patch, occluders: Sequence[Shape]) -> Lightmap:
    """Cast rays from a flat piece to an extended sun and to the sky."""
    n = LIGHTMAP_SIZE
    across = ((np.arange(n, dtype=np.float32)[None] + 0.5) / n * 2 - 1) * patch.half_width
    along = ((np.arange(n, dtype=np.float32)[:, None] + 0.5) / n * 2 - 1) * patch.half_height
    x, y, z = (
        c + across * a + along * b
        for c, a, b in zip(patch.center, patch.right, patch.up, strict=True)
    )

    light = np.zeros((n, n), dtype=np.float32)
    # Hulls bound the shadows, so rays are cast only where there may be a shadow.
    hulls = np.array([np.resize(shape.corners(), (8, 3)) for shape in occluders]) - patch.center

    for weight, direction in _lights():
        slant = _dot(direction, patch.normal)
        if slant > 0:
            lit = np.ones((n, n), dtype=bool)
            for number, area in _shadows(patch, hulls, direction):
                points = (x[area], y[area], z[area])
                lit[area] &= ~_blocked(occluders[number], points, direction)
            light += np.float32(weight * slant) * lit

    return Lightmap(light, patch.half_width, patch.half_height)


def _lights() -> Iterator[tuple[float, Vector]]:
    """Yield weights and directions: a sun wide enough for soft shadows, and two rings of sky."""
    # A spiral by the golden angle covers the sun's disk evenly.
    for k in range(SUN_RAYS):
        turn, radius = 2.4 * k, 0.1 * math.sqrt(k / SUN_RAYS)
        x, y, z = SUN[0] + radius * math.cos(turn), SUN[1], SUN[2] + radius * math.sin(turn)
        yield SUNLIGHT / SUN_RAYS, (x, y, z)

    for rise, count in ((0.5, 5), (1.1, 4)):
        for k in range(count):
            turn, flat = math.tau * (k + rise) / count, math.cos(rise)
            yield SKYLIGHT / 6, (flat * math.cos(turn), math.sin(rise), flat * math.sin(turn))


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _shadows(
    patch: Patch, hulls: Array, direction: Vector
) -> Iterator[tuple[int, tuple[slice, slice]]]:
    """Bound the shadows of convex hulls (k, 8, 3) around the patch's center on its light map."""
    # Project the hulls along the light onto the plane of the patch.
    rise = hulls @ np.array(patch.normal) / _dot(direction, patch.normal)
    feet = hulls - rise[..., None] * np.array(direction)

    spans = []
    for axis, size in ((patch.up, patch.half_height), (patch.right, patch.half_width)):
        texel = (feet @ np.array(axis) / size + 1) * (LIGHTMAP_SIZE / 2)
        spans.append(np.clip([texel.min(axis=1), texel.max(axis=1) + 1], 0, LIGHTMAP_SIZE))

    (top, bottom), (left, right) = (span.astype(int) for span in spans)
    for k in np.flatnonzero((rise.max(axis=1) > 0) & (top < bottom) & (left < right)).tolist():
        yield k, (slice(top[k], bottom[k]), slice(left[k], right[k]))


def _blocked(shape: Shape, points: Points, direction: Vector) -> NDArray[np.bool_]:
    """Return whether a shape stands between points and a light far away."""
    x, y, z = (np.full((1, 1), d, dtype=np.float32) for d in direction)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # rays that miss
        distance = shape.hit(Rays(points, x, y, z))
    return (distance > TOUCHING) & (distance < np.inf)


def _radiance(
    scene: Scenery, camera: Camera, rays: Rays, bounds: Sequence[Window], first_row: int
) -> NDArray[np.float32]:
    """Return the light (..., rows, columns, 3) along the rays of a band."""
    depth, index = cast(scene.shapes, rays, bounds, first_row)

    # Sort rays by the surface that they meet, so each ray is shaded once.
    by_surface = np.argsort(index, axis=None, kind="stable")
    ends = np.cumsum(np.bincount(index.ravel(), minlength=len(scene.surfaces)))
    light = np.empty((index.size, 3), dtype=np.float32)

    for number in np.flatnonzero(np.diff(ends, prepend=0)):
        pixels = by_surface[ends[number - 1] if number else 0 : ends[number]]
        where = np.unravel_index(pixels, index.shape)
        distance = depth[where]
        x, y, z = (np.broadcast_to(d, index.shape)[where] for d in (rays.x, rays.y, rays.z))
        chosen = Rays(rays.origin, x, y, z)
        spacing = distance * (RAY_SPACING / camera.focal)
        light[pixels] = _shade(scene, scene.surfaces[number], chosen.at(distance), spacing)

    return light.reshape(*index.shape, 3)


def _shade(scene: Scenery, surface: Surface, point: Points, spacing: Array) -> NDArray[np.float32]:
    """Return the light (n, 3) that points of a surface send back."""
    chart = surface.shape.chart(*point)
    u, v = chart.u + surface.shift[0], chart.v + surface.shift[1]
    colors = look_up(surface.texture, u, v, spacing)

    # The 3-4-5 triangle turns the detail, so its period does not match the texture's own.
    fine = look_up(scene.detail, 0.8 * u + 0.6 * v, 0.8 * v - 0.6 * u, spacing)[:, 0]

    light = _illumination(surface, chart, point[1])
    colors *= (light * (1 + surface.texture.relief * fine))[:, None]
    return colors


def _illumination(surface: Surface, chart: Chart, height: Array) -> Array:
    """Return sunlight by the slant, and sky light by the share of the sky that the surface sees."""
    if surface.light is not None:
        return surface.light.at(chart.u, chart.v)

    x, y, z = chart.normal
    slant = x * SUN[0] + y * SUN[1] + z * SUN[2]
    # Leaves let light through: both sides are lit, and never quite dark.
    sun = 0.3 + 0.5 * abs(slant) if surface.thin else np.maximum(slant, 0)
    # Within a hand of the floor, up to half of the sky is hidden.
    near_ground = 0.5 * np.exp(height * (-1 / 0.07))

    return SUNLIGHT * sun + SKYLIGHT * (0.65 + 0.35 * y) * (1 - near_ground)

"""Builds the scene: a floor, two slanted walls that meet, trees behind, things in three rows.

The cameras stand 0.75 above the floor and see it from z = 1.2 on; the walls are at z = 4 to 6.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from phasestereo_bench.rendering.camera import Camera
from phasestereo_bench.rendering.light import Scenery, Surface, light_falling_on
from phasestereo_bench.rendering.shapes import Patch, Shape
from phasestereo_bench.rendering.textures import (
    GREENS,
    STONES,
    WOODS,
    Color,
    Studio,
    Texture,
    fractal,
)
from phasestereo_bench.rendering.things import EAST, TOWARDS, Spot, Workshop, upright

Builder = Callable[[Spot], Iterator[Surface]]

BRICK: Color = (154, 88, 68)
PLASTER: Color = (204, 192, 168)
HAZE: Color = (96, 128, 84)
MIN_TEXELS, MAX_TEXELS = 256, 2048
DETAIL = 0.6  # px: texels of the finest detail at depth 1


@dataclass(frozen=True, slots=True)
class Row:
    """One row of things: their places, their heights, and the kinds to choose from."""

    places: tuple[float, ...]
    distance: tuple[float, float]
    height: tuple[float, float]
    builders: Sequence[Builder]


def furnish(rng: np.random.Generator, camera: Camera) -> Scenery:
    """Build a scene with textures as fine as the camera can use."""
    wanted = 2 ** math.ceil(math.log2(2 * max(camera.width, camera.height)))
    texels = min(max(wanted, MIN_TEXELS), MAX_TEXELS)

    studio = Studio(rng, texels)
    workshop = Workshop(rng, Studio(rng, texels // 2))

    things = [thing for spot, build in _arrangement(rng, workshop) for thing in build(spot)]
    shapes = [thing.shape for thing in things]

    floor = _floor(rng, studio)
    lit = [
        Surface(patch, texture, light=light_falling_on(patch, shapes))
        for patch, texture in [floor, *_walls(rng, studio)]
    ]

    # Textures have their own generator, so the number of texels changes no other choice.
    (grains,) = rng.spawn(1)
    detail = Texture.of(fractal(grains, texels)[..., None], DETAIL * texels / camera.focal)

    surfaces = [*lit, _trees(studio), *things]
    return Scenery(surfaces, detail, _nearest(camera, floor[0], shapes))


def _floor(rng: np.random.Generator, studio: Studio) -> tuple[Patch, Texture]:
    """Lay boards, crazy paving, or pebbles."""
    wood = WOODS[int(rng.integers(len(WOODS)))]
    kinds = [
        (partial(studio.planks, wood, count=10), 2.4),
        (partial(studio.cobbles, STONES, across=9, dome=0.3), 2.8),
        (partial(studio.cobbles, STONES[:3], across=30, dome=1.2), 2.4),
    ]

    make, size = kinds[int(rng.integers(len(kinds)))]
    return Patch((0.0, 0.0, 4.0), EAST, TOWARDS, 6.0, 4.0), Texture.of(make(), size)


def _walls(rng: np.random.Generator, studio: Studio) -> Iterator[tuple[Patch, Texture]]:
    """Build two walls that meet at the back, one of them low enough to look over."""
    wood, green = (colors[int(rng.integers(len(colors)))] for colors in (WOODS, GREENS))
    kinds = [
        (partial(studio.bricks, BRICK, courses=20, per_course=7), 2.0, 0.07),
        (partial(studio.foliage, green, leaves=2600, length=0.06), 2.6, 0.07),
        (partial(studio.planks, wood, count=14), 2.2, 0.07),
        (partial(studio.plain, PLASTER, tone=0.1), 2.0, 0.035),
    ]
    corner_x, corner_z = rng.uniform((-1.2, 5.4), (1.2, 6.2)).tolist()
    low_side = int(rng.choice([-1, 1]))

    for side, kind in zip((-1, 1), rng.permutation(len(kinds)), strict=False):
        yaw, low = (-side * rng.uniform(0.15, 0.45), rng.uniform(0.85, 1.1))
        half_width, top = (3.0, low) if side == low_side else (6.0, 3.0)

        # The high wall may run on behind the low one; the low one ends at the corner.
        x, z = (c + side * 3.0 * f(yaw) for c, f in ((corner_x, math.cos), (corner_z, math.sin)))

        make, size, relief = kinds[int(kind)]
        texture = Texture.of(make(), size, relief=relief)
        yield upright((x, top / 2, z), float(yaw), half_width, top / 2), texture


def _trees(studio: Studio) -> Surface:
    """Plant trees far behind the lower wall."""
    trees = Texture.of(studio.foliage(HAZE, leaves=1200, length=0.08), 6.0)
    return Surface(upright((0.0, 2.0, 20.0), 0.0, 16.0, 4.0), trees)


def _arrangement(rng: np.random.Generator, workshop: Workshop) -> Iterator[tuple[Spot, Builder]]:
    """Put tall things at the back, and low ones in front."""
    pot, box, crate = workshop.pot, workshop.box, workshop.crate
    low = [workshop.books, workshop.fruit, workshop.stones, workshop.tin]
    rows = [
        Row((-1.25, 0.1, 1.3), (3.2, 3.7), (0.8, 1.15), [pot, crate, pot, box]),
        Row((-0.8, 0.0, 0.75), (2.3, 2.8), (0.4, 0.6), [pot, box, pot, crate]),
        Row((-0.5, 0.05, 0.5), (1.55, 1.8), (0.14, 0.24), low),
    ]

    for row in rows:
        for place, kind in zip(row.places, rng.permutation(len(row.builders)), strict=False):
            x = place + float(rng.uniform(-0.12, 0.12))
            z, height = float(rng.uniform(*row.distance)), float(rng.uniform(*row.height))
            yield Spot(x, z, height), row.builders[int(kind)]


def _nearest(camera: Camera, floor: Shape, things: list[Shape]) -> float:
    """Bound the depths that either view may see from below: floor at an edge, things' corners."""
    x, y = (np.array([0.0, size - 1.0]) for size in (camera.width, camera.height))
    with np.errstate(invalid="ignore", divide="ignore"):
        seen = floor.hit(camera.rays(x[None], y[:, None], 0))

    corners = np.concatenate([thing.corners() for thing in things])
    return min(float(seen[seen > 0].min()), float(camera.project(corners, 0)[2].min()))

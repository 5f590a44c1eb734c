"""Rooms: plain walls, floors and tables, white boxes, thin legs, and curved plain things.

Nothing in a room depends on the size of its images, so a larger image is a finer sampling of the
same scene. World units are meters, about; the floor, or the table top that fills the image, is y =
0, and the cameras look along z.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

import numpy as np

from phasestereo_bench.rendering.light import Lightmap, Scenery, Surface, light_falling_on
from phasestereo_bench.rendering.shapes import Ellipsoid, Frustum, Patch
from phasestereo_bench.rendering.textures import WOODS, Studio, Texture, fractal
from phasestereo_bench.rendering.things import EAST, TOWARDS, Spot, Workshop, disc, upright

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from phasestereo_bench.rendering.shapes import Shape, Vector
    from phasestereo_bench.rendering.textures import Color

    Furniture = Callable[["_Decorator"], tuple[list[Patch], list[Surface]]]

RoomKind: TypeAlias = Literal["table", "room", "curved"]
ROOMS: tuple[RoomKind, ...] = get_args(RoomKind)
"""A table top seen from above with a few objects on it; a room with a table and boxes in it, on
thin legs; shades, cylinders and balls before a wall."""

PAINTS: list[Color] = [(214, 210, 200), (196, 202, 206), (222, 212, 186), (176, 180, 172)]
TEXELS = 1024  # of every tile, whatever the camera
DETAIL_SIZE = 0.3  # world units of the tile of finest detail: texels of 0.3 mm
PLAIN_SIZE = 1.3  # the same of plain surfaces
GRAIN = 0.004, 0.03  # log brightness: standard deviation of what a plain surface shows


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """What is in a room, and where the cameras stand in it.

    Attributes
    ----------
    scenery
        The surfaces; `Scenery.near` is not used.
    eye, pitch
        Of the camera, as `Camera` has them.
    reach
        The largest disparity, as a share of the image's width.
    """

    scenery: Scenery
    eye: float
    pitch: float
    reach: float


def furnish_room(rng: np.random.Generator, kind: RoomKind) -> Room:
    """Furnish a room; the same generator gives the same room."""
    eye, pitch, reach = (float(rng.uniform(*span)) for span in _VIEWS[kind])
    center = eye / math.tan(pitch)  # where the middle of the image meets the ground

    decorator = _Decorator(rng, Studio(rng, TEXELS), center)
    large, things = _FURNITURE[kind](decorator)

    # A lamp makes brightness fall off slowly over whatever is large and plain.
    lamp = (float(rng.uniform(-1.5, 1.5)), float(rng.uniform(1.6, 2.2)), 0.6 * center)
    shapes = [thing.shape for thing in things]
    lit = [Surface(each, decorator.plain(), light=_lamplight(each, shapes, lamp)) for each in large]

    (grains,) = rng.spawn(1)
    detail = Texture.of(fractal(grains, TEXELS)[..., None], DETAIL_SIZE)
    return Room(Scenery([*lit, *things], detail, near=0.0), eye, pitch, reach)


class _Decorator:
    """Makes plain and printed things; every choice comes from one generator."""

    def __init__(self, rng: np.random.Generator, studio: Studio, center: float) -> None:
        self.rng, self.studio, self.center = rng, studio, center
        self.workshop = Workshop(rng, Studio(rng, TEXELS // 2))

    def plain(self, color: Color | None = None) -> Texture:
        """Paint with a faint grain."""
        low, high = GRAIN
        tone = low * (high / low) ** float(self.rng.uniform())
        paint = PAINTS[int(self.rng.integers(len(PAINTS)))] if color is None else color
        return Texture.of(self.studio.plain(paint, tone=tone, hue=tone / 4), PLAIN_SIZE, relief=tone)

    def wood(self) -> Color:
        """Choose the color of furniture."""
        return [*WOODS, *PAINTS][int(self.rng.integers(len(WOODS) + len(PAINTS)))]

    def spot(self, x: float, z: float, height: float) -> Spot:
        """Find a place near x, z."""
        dx, dz = self.rng.uniform(-0.06, 0.06, size=2).tolist()
        return Spot(x + dx, z + dz, height * float(self.rng.uniform(0.8, 1.2)))

    def carton(self, spot: Spot, *, floor: float = 0.0) -> Iterator[Surface]:
        """Build a white box."""
        size = self.workshop.block_size(spot)
        return self.workshop.block(spot, size, self.plain(), floor=floor, cover=Surface)

    def printed(self, spot: Spot) -> Iterator[Surface]:
        """Build one of the things with a texture."""
        shop = self.workshop
        builders = [shop.box, shop.tin, shop.books, shop.fruit, shop.stones]
        yield from builders[int(self.rng.integers(len(builders)))](spot)

    def pole(self, foot: Vector, height: float, radius: float, texture: Texture) -> Surface:
        """Stand a thin leg up."""
        return Surface(Frustum(foot, height, radius, radius), texture)


def _table(with_: _Decorator) -> tuple[list[Patch], list[Surface]]:
    """A table top that fills the image or ends before a wall, and one to three things on it."""
    rng, center = with_.rng, with_.center
    end = center * float(rng.uniform(1.15, 2.2))  # the table's far edge
    top = Patch((0.0, 0.0, end - 1.5), EAST, TOWARDS, 2.5, 1.5)
    floor = Patch((0.0, -0.75, 3.0), EAST, TOWARDS, 8.0, 6.0)
    yaw = float(rng.uniform(-0.3, 0.3))
    wall = upright((0.0, 0.5, end + float(rng.uniform(0.6, 1.5))), yaw, 8.0, 2.0)

    things: list[Surface] = []
    places = [(0.0, center), (-0.28, center - 0.12), (0.3, center + 0.1)]
    for number in range(int(rng.integers(1, 4))):
        spot = with_.spot(*places[number], 0.16)
        things += with_.printed(spot) if rng.uniform() < 0.6 else with_.carton(spot)
    return [top, floor, wall], things


def _room(with_: _Decorator) -> tuple[list[Patch], list[Surface]]:
    """A floor, a back wall, a side wall, a table and a stool on thin legs, boxes, a lamp."""
    rng = with_.rng
    depth, side = float(rng.uniform(3.6, 4.6)), int(rng.choice([-1, 1]))
    yaw = float(rng.uniform(-0.25, 0.25))
    floor = Patch((0.0, 0.0, 4.0), EAST, TOWARDS, 8.0, 5.0)
    back = upright((0.0, 1.5, depth), yaw, 8.0, 1.5)
    flank = upright((side * float(rng.uniform(1.5, 1.9)), 1.5, 3.0), -side * 1.4, 5.0, 1.5)

    things: list[Surface] = []
    table_x, table_z = -side * 0.35 + float(rng.uniform(-0.1, 0.1)), float(rng.uniform(2.2, 2.6))
    things += _desk(with_, (table_x, table_z), (0.6, 0.36), 0.72, legs=0.015)
    things += _desk(with_, (side * 0.75, float(rng.uniform(1.9, 2.3))), (0.17, 0.17), 0.45, legs=0.01)
    for x, z, height in ((side * 1.0, 3.1, 0.6), (-side * 0.75, 1.75, 0.3), (side * 0.2, 3.2, 0.45)):
        things += with_.carton(with_.spot(x, z, height))
    things += with_.printed(with_.spot(side * 0.25, 1.8, 0.25))
    things += with_.carton(with_.spot(table_x - 0.2, table_z, 0.2), floor=0.735)

    # A lamp on its cord, and a mast.
    x, z = table_x + 0.2, table_z + 0.1
    things.append(with_.pole((x, 1.25, z), 1.5, 0.005, with_.plain((60, 60, 62))))
    things += _shade((x, 1.05, z), 0.22, 0.13, with_.plain())
    mast = (-side * 1.15, 0.0, float(rng.uniform(2.6, 3.2)))
    things.append(with_.pole(mast, 1.9, 0.012, with_.plain((120, 122, 126))))
    return [floor, back, flank], things


def _curved(with_: _Decorator) -> tuple[list[Patch], list[Surface]]:
    """Shades, cylinders and balls, all of them plain, on a plain floor before a wall."""
    rng = with_.rng
    depth = float(rng.uniform(2.6, 3.4))
    floor = Patch((0.0, 0.0, 4.0), EAST, TOWARDS, 8.0, 5.0)
    back = upright((0.0, 1.5, depth), float(rng.uniform(-0.3, 0.3)), 8.0, 1.5)

    things: list[Surface] = []
    # Two rows: large ones behind, small ones before them.
    for (x, z), size in zip(
        ((-0.75, 2.3), (0.0, 2.45), (0.75, 2.3), (-0.42, 1.6), (0.05, 1.5), (0.45, 1.65)),
        (0.62, 0.75, 0.62, 0.28, 0.22, 0.28),
        strict=True,
    ):
        things += _round(with_, with_.spot(x, z, size))
    return [floor, back], things


def _round(with_: _Decorator, spot: Spot) -> Iterator[Surface]:
    """A shade, a cylinder with a lid, or a ball."""
    texture, (x, z, height) = with_.plain(), spot
    radius = height * float(with_.rng.uniform(0.3, 0.42))

    match int(with_.rng.integers(3)):
        case 0:
            foot = 0.35 * height
            yield with_.pole((x, 0.0, z), foot, 0.03 * height, with_.plain((90, 88, 84)))
            yield from _shade((x, foot, z), height - foot, radius, texture)
        case 1:
            yield Surface(Frustum((x, 0.0, z), height, radius, radius), texture)
            yield Surface(disc((x, height, z), radius), texture)
        case _:
            yield Surface(Ellipsoid((x, radius, z), (radius, radius, radius)), texture)


def _shade(foot: Vector, height: float, radius: float, texture: Texture) -> Iterator[Surface]:
    """A cone that is cut and covered, since of a bare one only the outside is seen."""
    x, y, z = foot
    yield Surface(Frustum(foot, height, radius, 0.55 * radius), texture)
    yield Surface(disc((x, y + height, z), 0.55 * radius), texture)


def _desk(
    with_: _Decorator, place: tuple[float, float], half: tuple[float, float], height: float,
    *, legs: float,
) -> Iterator[Surface]:  # fmt: skip
    """A board on four thin legs."""
    (x, z), (half_width, half_depth) = place, half
    board, leg = with_.plain(with_.wood()), with_.plain((70, 70, 74))
    thick = 0.015

    size = 2 * half_width, thick, 2 * half_depth
    yield from with_.workshop.block(
        Spot(x, z, thick), size, board, floor=height, yaw=0.0, cover=Surface
    )
    for i in (-1, 1):
        for j in (-1, 1):
            foot = (x + 0.92 * i * half_width, 0.0, z + 0.9 * j * half_depth)
            yield with_.pole(foot, height, legs, leg)


def _lamplight(patch: Patch, occluders: list[Shape], lamp: Vector) -> Lightmap:
    """Return sun and sky on a flat piece, and light that falls off from a lamp without shadows."""
    lit = light_falling_on(patch, occluders)
    n = lit.light.shape[0]
    steps = (np.arange(n, dtype=np.float32) + 0.5) / n * 2 - 1
    u, v = steps[None] * patch.half_width, steps[:, None] * patch.half_height

    square = np.zeros((n, n), dtype=np.float32)
    for center, right, up, at in zip(patch.center, patch.right, patch.up, lamp, strict=True):
        square += (center + u * right + v * up - at) ** 2
    return Lightmap(lit.light + 1 / (1 + square), lit.half_width, lit.half_height)


# Height of the eye, pitch (radians), largest disparity over the image's width.
_VIEWS: dict[RoomKind, tuple[tuple[float, float], ...]] = {
    "table": ((0.6, 0.85), (0.65, 1.0), (0.13, 0.22)),
    "room": ((1.1, 1.35), (0.28, 0.42), (0.08, 0.16)),
    "curved": ((0.7, 0.9), (0.18, 0.3), (0.08, 0.16)),
}
_FURNITURE: dict[RoomKind, Furniture] = {"table": _table, "room": _room, "curved": _curved}

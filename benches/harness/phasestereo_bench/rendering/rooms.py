"""Furnishes rooms: plain walls, floors and tables, white boxes, thin legs, curved plain things.

Nothing in a room depends on the size of its images, so a larger image is a finer sampling of the
same scene. World units are roughly meters. The floor, or the table top that fills the image, is y =
0, and the cameras look along z.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np

from phasestereo_bench.rendering.light import Lightmap, Scenery, Surface, light_falling_on
from phasestereo_bench.rendering.shapes import Ellipsoid, Frustum, Patch, Shape, Vector
from phasestereo_bench.rendering.textures import WOODS, Color, Studio, Texture, fractal
from phasestereo_bench.rendering.things import EAST, TOWARDS, Spot, Workshop, disc, upright

Furniture = Callable[["_Maker"], tuple[list[Patch], list[Surface]]]

RoomKind: TypeAlias = Literal["table", "room", "curved"]
ROOMS: tuple[RoomKind, ...] = get_args(RoomKind)
"""A table top seen from above with a few objects on it; a room with a table and boxes in it, on
thin legs; shades, cylinders and balls before a wall."""

PAINTS: list[Color] = [(214, 210, 200), (196, 202, 206), (222, 212, 186), (176, 180, 172)]
STEEL: Color = (78, 78, 82)
TEXELS = 1024  # of every tile, for any camera
DETAIL_SIZE = 0.3  # world units of the tile of finest detail: texels of 0.3 mm
PLAIN_SIZE = 1.3  # the same of plain surfaces
GRAIN = 0.004, 0.03  # log brightness: standard deviations of the grain of a plain surface
BOARD = 0.015  # thickness
PRINTED = 0.6  # probability that a thing on a table has a texture


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """The contents of a room, and the positions of the cameras.

    Attributes
    ----------
    scenery
        The surfaces; `Scenery.near` is not used.
    eye, pitch
        Position and pitch of the camera, as in `Camera`.
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
    center = eye / math.tan(pitch)  # the middle of the image meets the ground here

    maker = _Maker(rng, center)
    large, things = _FURNITURE[kind](maker)

    # A lamp makes brightness fall off slowly over large plain surfaces.
    lamp = (float(rng.uniform(-1.5, 1.5)), float(rng.uniform(1.6, 2.2)), 0.6 * center)
    shapes = [thing.shape for thing in things]
    lit = [Surface(each, maker.plain(), light=_lamplight(each, shapes, lamp)) for each in large]

    (grains,) = rng.spawn(1)
    detail = Texture.of(fractal(grains, TEXELS)[..., None], DETAIL_SIZE)
    return Room(Scenery([*lit, *things], detail, near=0.0), eye, pitch, reach)


class _Maker:
    """Makes plain and printed things; every choice comes from one generator."""

    def __init__(self, rng: np.random.Generator, center: float) -> None:
        self.rng, self.center = rng, center
        self.workshop = Workshop(rng, Studio(rng, TEXELS // 2))
        self._studio = Studio(rng, TEXELS)

    def between(self, low: float, high: float) -> float:
        """Choose a number."""
        return float(self.rng.uniform(low, high))

    def plain(self, *colors: Color) -> Texture:
        """Paint in one of some colors, or of all paints, with a faint grain."""
        choice = colors or PAINTS
        paint = choice[int(self.rng.integers(len(choice)))]
        low, high = GRAIN
        tone = low * (high / low) ** self.between(0, 1)
        tile = self._studio.plain(paint, tone=tone, hue=tone / 4)
        return Texture.of(tile, PLAIN_SIZE, relief=tone)

    def spot(self, x: float, z: float, height: float) -> Spot:
        """Find a place near x, z."""
        near_x, near_z = (each + self.between(-0.06, 0.06) for each in (x, z))
        return Spot(near_x, near_z, height * self.between(0.8, 1.2))

    def carton(self, spot: Spot, *, floor: float = 0.0) -> Iterator[Surface]:
        """Build a white box."""
        size = self.workshop.block_size(spot)
        return self.workshop.block(spot, size, self.plain(), floor=floor, cover=Surface)

    def printed(self, spot: Spot) -> Iterator[Surface]:
        """Build one of the things with a texture."""
        shop = self.workshop
        builders = [shop.box, shop.tin, shop.books, shop.fruit, shop.stones]
        return builders[int(self.rng.integers(len(builders)))](spot)


def _table(maker: _Maker) -> tuple[list[Patch], list[Surface]]:
    """Furnish a table top that fills the image or ends before a wall: one to three things."""
    center = maker.center
    end = center * maker.between(1.15, 2.2)  # the table's far edge
    top = Patch((0.0, 0.0, end - 1.5), EAST, TOWARDS, 2.5, 1.5)
    floor = Patch((0.0, -0.75, 3.0), EAST, TOWARDS, 8.0, 6.0)
    wall = upright((0.0, 0.5, end + maker.between(0.6, 1.5)), maker.between(-0.3, 0.3), 8.0, 2.0)

    things: list[Surface] = []
    places = [(0.0, center), (-0.28, center - 0.12), (0.3, center + 0.1)]
    for x, z in places[: int(maker.rng.integers(1, 4))]:
        build = maker.printed if maker.between(0, 1) < PRINTED else maker.carton
        things += build(maker.spot(x, z, 0.16))
    return [top, floor, wall], things


def _room(maker: _Maker) -> tuple[list[Patch], list[Surface]]:
    """Furnish a room of three walls: a table and a stool, boxes, something printed, a lamp."""
    side = int(maker.rng.choice([-1, 1]))  # side of the wall seen at a slant
    floor = Patch((0.0, 0.0, 4.0), EAST, TOWARDS, 8.0, 5.0)
    back = upright((0.0, 1.5, maker.between(3.6, 4.6)), maker.between(-0.25, 0.25), 8.0, 1.5)
    flank = upright((side * maker.between(1.5, 1.9), 1.5, 3.0), -side * 1.4, 5.0, 1.5)

    table_x, table_z = maker.between(-0.1, 0.1) - side * 0.35, maker.between(2.2, 2.6)
    stool_z, mast_z = maker.between(1.9, 2.3), maker.between(2.6, 3.2)
    steel = maker.plain(STEEL)

    things = [
        *_desk(maker, (table_x, table_z), (0.6, 0.36), 0.72, leg=0.015),
        *_desk(maker, (side * 0.75, stool_z), (0.17, 0.17), 0.45, leg=0.01),
        *maker.carton(maker.spot(table_x - 0.2, table_z, 0.2), floor=0.735),
        *maker.printed(maker.spot(side * 0.25, 1.8, 0.25)),
        # A lamp on its cord, and a mast.
        _pole((table_x + 0.2, 1.25, table_z + 0.1), 1.5, 0.005, steel),
        *_shade((table_x + 0.2, 1.05, table_z + 0.1), 0.22, 0.13, maker.plain()),
        _pole((-side * 1.15, 0.0, mast_z), 1.9, 0.012, steel),
    ]
    for x, z, height in ((1.0, 3.1, 0.6), (-0.75, 1.75, 0.3), (0.2, 3.2, 0.45)):
        things += maker.carton(maker.spot(side * x, z, height))
    return [floor, back, flank], things


def _curved(maker: _Maker) -> tuple[list[Patch], list[Surface]]:
    """Put shades, cylinders and balls, all of them plain, on a plain floor before a wall."""
    floor = Patch((0.0, 0.0, 4.0), EAST, TOWARDS, 8.0, 5.0)
    back = upright((0.0, 1.5, maker.between(2.6, 3.4)), maker.between(-0.3, 0.3), 8.0, 1.5)

    # Two rows: large things behind, small things before them.
    places = [
        *((-0.75, 2.3, 0.62), (0.0, 2.45, 0.75), (0.75, 2.3, 0.62)),
        *((-0.42, 1.6, 0.28), (0.05, 1.5, 0.22), (0.45, 1.65, 0.28)),
    ]
    things = [thing for place in places for thing in _round(maker, maker.spot(*place))]
    return [floor, back], things


def _round(maker: _Maker, spot: Spot) -> Iterator[Surface]:
    """Build a shade on its foot, a cylinder with a lid, or a ball."""
    texture, (x, z, height) = maker.plain(), spot
    radius = height * maker.between(0.3, 0.42)

    match int(maker.rng.integers(3)):
        case 0:
            foot = 0.35 * height
            yield _pole((x, 0.0, z), foot, 0.03 * height, maker.plain(STEEL))
            yield from _shade((x, foot, z), height - foot, radius, texture)
        case 1:
            yield Surface(Frustum((x, 0.0, z), height, radius, radius), texture)
            yield Surface(disc((x, height, z), radius), texture)
        case _:
            yield Surface(Ellipsoid((x, radius, z), (radius, radius, radius)), texture)


def _pole(foot: Vector, height: float, radius: float, texture: Texture) -> Surface:
    """Stand a thin leg up."""
    return Surface(Frustum(foot, height, radius, radius), texture)


def _shade(foot: Vector, height: float, radius: float, texture: Texture) -> Iterator[Surface]:
    """Cut a cone and cover it, because only the outside of a bare cone is visible."""
    x, y, z = foot
    yield Surface(Frustum(foot, height, radius, 0.55 * radius), texture)
    yield Surface(disc((x, y + height, z), 0.55 * radius), texture)


def _desk(
    maker: _Maker,
    place: tuple[float, float],
    half: tuple[float, float],
    height: float,
    *,
    leg: float,
) -> Iterator[Surface]:
    """Lay a board on four thin legs."""
    (x, z), (half_width, half_depth) = place, half
    board, steel = maker.plain(*WOODS, *PAINTS), maker.plain(STEEL)

    size = 2 * half_width, BOARD, 2 * half_depth
    yield from maker.workshop.block(
        Spot(x, z, BOARD), size, board, floor=height, yaw=0.0, cover=Surface
    )
    for i in (-1, 1):
        for j in (-1, 1):
            foot = (x + 0.92 * i * half_width, 0.0, z + 0.9 * j * half_depth)
            yield _pole(foot, height, leg, steel)


def _lamplight(patch: Patch, occluders: list[Shape], lamp: Vector) -> Lightmap:
    """Return sun and sky on a flat piece, plus a lamp whose light falls off without shadows."""
    lit = light_falling_on(patch, occluders)
    n = lit.light.shape[0]
    steps = (np.arange(n, dtype=np.float32) + 0.5) / n * 2 - 1
    u, v = steps[None] * patch.half_width, steps[:, None] * patch.half_height

    square = np.zeros((n, n), dtype=np.float32)
    for center, right, up, at in zip(patch.center, patch.right, patch.up, lamp, strict=True):
        square += (center + u * right + v * up - at) ** 2
    light = (lit.light + 1 / (1 + square)).astype(np.float32)
    return Lightmap(light, lit.half_width, lit.half_height)


# Height of the eye, pitch (radians), largest disparity over the image's width.
_VIEWS: dict[RoomKind, tuple[tuple[float, float], ...]] = {
    "table": ((0.6, 0.85), (0.65, 1.0), (0.13, 0.22)),
    "room": ((1.1, 1.35), (0.28, 0.42), (0.08, 0.16)),
    "curved": ((0.7, 0.9), (0.18, 0.3), (0.08, 0.16)),
}
_FURNITURE: dict[RoomKind, Furniture] = {"table": _table, "room": _room, "curved": _curved}

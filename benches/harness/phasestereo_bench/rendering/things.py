"""Builds the things on the floor: boxes, books, plants in pots, fruit, stones and tins.

World units are about a table's height. Each builder yields the surfaces of one thing at its spot.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from phasestereo_bench.rendering.light import Surface
from phasestereo_bench.rendering.shapes import Ellipsoid, Frustum, Patch, Shape, Vector
from phasestereo_bench.rendering.textures import GREENS, STONES, WOODS, Color, Studio, Texture

Cover = Callable[[Patch, Texture], Surface]

PAPERS: list[Color] = [
    (226, 216, 192),
    (52, 78, 112),
    (150, 44, 40),
    (206, 172, 84),
    (60, 98, 84),
]
INKS: list[Color] = [
    (30, 30, 36),
    (184, 64, 50),
    (48, 84, 130),
    (222, 186, 92),
    (236, 230, 214),
    (74, 116, 82),
]
CLAY: Color = (180, 106, 76)
EARTH: Color = (62, 48, 38)
GLAZES: list[Color] = [(206, 204, 192), (92, 128, 150), (190, 168, 112)]
FRUITS: list[Color] = [(214, 134, 52), (170, 54, 44), (150, 164, 70)]

EAST: Vector = (1.0, 0.0, 0.0)
TOWARDS: Vector = (0.0, 0.0, -1.0)  # the cameras
GOLDEN = 2.4  # radians: successive turns by this angle never line up


class Spot(NamedTuple):
    """A place on the floor, and the height of the thing to put there."""

    x: float
    z: float
    height: float


def printed(patch: Patch, texture: Texture, *, thin: bool = False) -> Surface:
    """Fit one tile of a texture to a flat piece, whole along its longer side."""
    size = 2 * max(patch.half_width, patch.half_height)
    fitted = Texture(texture.levels, size / texture.levels[0].shape[0], texture.relief)
    return Surface(patch, fitted, (patch.half_width, patch.half_height), thin)


class Workshop:
    """Builds things out of textures made once; every choice comes from one generator."""

    def __init__(self, rng: np.random.Generator, studio: Studio) -> None:
        self.rng = rng
        self._prints = [
            Texture.of(studio.print(paper, INKS), relief=0.04) for paper in self._some(PAPERS, 4)
        ]

        wood, stone, glaze = (self._some(choice, 1)[0] for choice in (WOODS, STONES, GLAZES))
        self._wood = Texture.of(studio.planks(wood, count=6, joints=False))
        self._stone = Texture.of(studio.plain(stone, tone=0.35), 0.7)
        self._clay = Texture.of(studio.plain(CLAY, tone=0.14), 0.8)
        self._glaze = Texture.of(studio.plain(glaze, tone=0.05), 0.8, relief=0.025)
        self._earth = Texture.of(studio.plain(EARTH, tone=0.5), 0.4)

        self._fruits = [
            Texture.of(studio.plain(fruit, tone=0.07), 0.5, relief=0.04)
            for fruit in self._some(FRUITS, 2)
        ]
        self._leaves = [
            [Texture.of(studio.leaf(green, tone=tone)) for tone in (-0.25, 0.0, 0.2)]
            for green in self._some(GREENS, 2)
        ]

    def box(self, spot: Spot) -> Iterator[Surface]:
        """Build a printed carton, turned a little."""
        return self.block(spot, self.block_size(spot), self._pick(self._prints))

    def crate(self, spot: Spot) -> Iterator[Surface]:
        """Build a box of boards, turned a little."""
        return self.block(spot, self.block_size(spot), self._wood)

    def books(self, spot: Spot) -> Iterator[Surface]:
        """Stack three books, each turned differently."""
        floor = 0.0
        for _ in range(3):
            width, height, depth = self.rng.uniform((0.32, 0.27, 0.24), (0.42, 0.4, 0.3)).tolist()
            size = (width, height * spot.height, depth)
            yield from self.block(spot, size, self._pick(self._prints), floor=floor)
            floor += size[1]

    def pot(self, spot: Spot) -> Iterator[Surface]:
        """Put a plant in a pot of clay or glaze."""
        tall = 0.34 * spot.height
        radius = tall * float(self.rng.uniform(0.5, 0.65))

        pottery = self._pick([self._clay, self._clay, self._glaze])
        body = Frustum((spot.x, 0.0, spot.z), tall, 0.72 * radius, radius)
        rim = Frustum((spot.x, 0.86 * tall, spot.z), 0.14 * tall, 1.1 * radius, 1.12 * radius)

        yield self._cut(body, pottery)
        yield self._cut(rim, pottery)
        yield self._cut(disc((spot.x, tall, spot.z), 1.1 * radius), self._earth)
        yield from self._plant((spot.x, tall, spot.z), spot.height - tall)

    def fruit(self, spot: Spot) -> Iterator[Surface]:
        """Lay down one to three round fruits."""
        for k in range(int(self.rng.integers(1, 4))):
            radius = spot.height / 2 * (1.0 if k == 0 else float(self.rng.uniform(0.6, 0.9)))
            x, z = beside(spot, k, 1.1 * spot.height)
            ball = Ellipsoid((x, 0.95 * radius, z), (radius, 0.95 * radius, radius))
            yield self._cut(ball, self._pick(self._fruits))

    def stones(self, spot: Spot) -> Iterator[Surface]:
        """Heap up five flattened stones."""
        for k in range(5):
            wide, high, deep = (
                spot.height * self.rng.uniform((0.4, 0.25, 0.4), (0.65, 0.5, 0.65))
            ).tolist()
            x, z = beside(spot, k, 0.7 * spot.height)
            yield self._cut(Ellipsoid((x, 0.8 * high, z), (wide, high, deep)), self._stone)

    def tin(self, spot: Spot) -> Iterator[Surface]:
        """Build a tin with a label, or a plain one."""
        radius = spot.height * float(self.rng.uniform(0.32, 0.42))
        label = self._pick([*self._prints, self._glaze])
        yield self._cut(Frustum((spot.x, 0.0, spot.z), spot.height, radius, radius), label)
        yield self._cut(disc((spot.x, spot.height, spot.z), radius), self._glaze)

    def _some(self, colors: Sequence[Color], count: int) -> list[Color]:
        return [colors[k] for k in self.rng.permutation(len(colors))[:count]]

    def _pick(self, textures: Sequence[Texture]) -> Texture:
        return textures[int(self.rng.integers(len(textures)))]

    def _cut(self, shape: Shape, texture: Texture) -> Surface:
        """Take the cover of a shape from somewhere on a texture."""
        across, along = self.rng.uniform(0, 9, size=2).tolist()
        return Surface(shape, texture, (across, along))

    def block_size(self, spot: Spot) -> Vector:
        """Choose width, height and depth of a box."""
        width, depth = (spot.height * self.rng.uniform((0.6, 0.4), (0.9, 0.7))).tolist()
        return width, spot.height, depth

    def block(
        self,
        spot: Spot,
        size: Vector,
        texture: Texture,
        *,
        floor: float = 0.0,
        yaw: float | None = None,
        cover: Cover = printed,
    ) -> Iterator[Surface]:
        """Build four sides and a lid, turned by up to 35 degrees if no angle is given."""
        width, height, depth = size
        if yaw is None:
            yaw = float(self.rng.uniform(-0.6, 0.6))

        for k in range(4):
            turn = yaw + k * math.pi / 2
            wide, out = (width, depth) if k % 2 == 0 else (depth, width)
            x, z = spot.x + out / 2 * math.sin(turn), spot.z - out / 2 * math.cos(turn)
            side = upright((x, floor + height / 2, z), turn, wide / 2, height / 2)
            yield cover(side, texture)

        right, front = (math.cos(yaw), 0.0, math.sin(yaw)), (math.sin(yaw), 0.0, -math.cos(yaw))
        lid = Patch((spot.x, floor + height, spot.z), right, front, width / 2, depth / 2)
        yield cover(lid, texture)

    def _plant(self, foot: Vector, height: float) -> Iterator[Surface]:
        """Build long leaves that lean outward from one place, and a stake."""
        kinds = self._leaves[int(self.rng.integers(len(self._leaves)))]
        for _ in range(int(self.rng.integers(18, 28))):
            leaf = self._leaf(np.array(foot), height * float(self.rng.uniform(0.6, 1.05)))
            yield printed(leaf, self._pick(kinds), thin=True)

        stake = Frustum(foot, height * float(self.rng.uniform(0.8, 1.2)), 0.012, 0.012)
        yield self._cut(stake, self._wood)

    def _leaf(self, foot: np.ndarray, length: float) -> Patch:
        rng = self.rng
        turn, rise = rng.uniform(0, math.tau), rng.uniform(0.35, 1.45)
        flat = math.cos(rise)
        along = np.array([flat * math.cos(turn), math.sin(rise), flat * math.sin(turn)])

        aside = np.cross(along, rng.normal(size=3))
        aside /= np.linalg.norm(aside)

        center = foot + along * length * (0.5 + rng.uniform(0, 0.25))
        x, y, z = ((float(a), float(b), float(c)) for a, b, c in (center, along, aside))
        return Patch(x, y, z, length / 2, length * float(rng.uniform(0.1, 0.16)), "leaf")


def upright(center: Vector, yaw: float, half_width: float, half_height: float) -> Patch:
    """Stand a rectangle up, facing the cameras and turned by yaw; v runs down, as in print."""
    right = (math.cos(yaw), 0.0, math.sin(yaw))
    return Patch(center, right, (0.0, -1.0, 0.0), half_width, half_height)


def disc(center: Vector, radius: float) -> Patch:
    """Lay a round lid."""
    return Patch(center, EAST, TOWARDS, radius, radius, "ellipse")


def beside(spot: Spot, k: int, distance: float) -> tuple[float, float]:
    """Find the k-th place around a spot, the 0-th being the spot itself: x and z."""
    distance *= k > 0
    return spot.x + distance * math.cos(GOLDEN * k), spot.z + distance * math.sin(GOLDEN * k)

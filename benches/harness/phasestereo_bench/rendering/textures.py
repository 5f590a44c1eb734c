"""Makes textures: periodic pictures with the 1/f spectrum of photographs, and with edges.

Every maker returns the albedo (n, n, 3) of one tile in linear light; `Texture.of` gives it a size
in the world, and coarser levels for distant surfaces.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phasestereo_bench.arrays import Array

Tile = NDArray[np.float32]
Color = tuple[int, int, int]  # sRGB, 0-255, as in any paint program

WOODS: list[Color] = [(168, 122, 78), (124, 84, 54), (150, 136, 118)]
STONES: list[Color] = [(150, 142, 130), (118, 116, 116), (168, 150, 122), (96, 92, 92)]
GREENS: list[Color] = [(92, 122, 58), (112, 134, 70), (84, 112, 76), (134, 142, 80)]
COARSEST = 16  # texels of the last level


@dataclass(frozen=True, slots=True, eq=False)
class Texture:
    """A periodic picture of n x n texels (n a power of two), and its halvings; channels last."""

    levels: list[Tile]
    pitch: float  # world units per texel of the finest level
    relief: float = 0.07  # strength of the detail finer than its texels

    @classmethod
    def of(cls, tile: Tile, size: float = 1.0, *, relief: float = 0.07) -> "Texture":
        """Lay a tile (n, n, channels) over `size` world units, repeated endlessly."""
        levels = [np.ascontiguousarray(tile, dtype=np.float32)]
        while levels[-1].shape[0] > COARSEST:
            fine = levels[-1]
            pairs = fine[::2] + fine[1::2]
            levels.append((pairs[:, ::2] + pairs[:, 1::2]) * np.float32(0.25))

        return cls(levels, size / tile.shape[0], relief)


def look_up(texture: Texture, u: Array, v: Array, spacing: Array) -> Tile:
    """Return colors (k, channels) at surface coordinates; the level is about as coarse as the rays.

    The spacing of the rays depends only on depth, and a point has the same depth in both views, so
    both views see the same level.
    """
    level = np.log2(spacing / texture.pitch)
    level = np.clip(level, 0, len(texture.levels) - 1).astype(np.int8)

    first, last = int(level.min()), int(level.max())
    if first == last:
        return _bilinear(texture, first, u, v)

    colors = np.empty((u.size, texture.levels[0].shape[2]), dtype=np.float32)
    for number in range(first, last + 1):
        chosen = np.flatnonzero(level == number)
        colors[chosen] = _bilinear(texture, number, u[chosen], v[chosen])

    return colors


def _bilinear(texture: Texture, level: int, u: Array, v: Array) -> Tile:
    tile, scale = texture.levels[level], 1 / (texture.pitch * 2**level)
    n = tile.shape[0]

    u, v = u * scale - 0.5, v * scale - 0.5
    column, row = np.floor(u), np.floor(v)
    across, along = (u - column)[:, None], (v - row)[:, None]

    # The texels of a tile are a power of two, so masks wrap it around.
    left, top = column.astype(np.intp) & (n - 1), row.astype(np.intp) & (n - 1)
    right, below = (left + 1) & (n - 1), ((top + 1) & (n - 1)) * n
    top *= n

    texels: Tile = tile.reshape(n * n, -1)
    upper: Tile = texels[top + left]
    lower: Tile = texels[below + left]

    upper += across * (texels[top + right] - upper)
    lower += across * (texels[below + right] - lower)
    upper += along * (lower - upper)
    return upper


def linear(color: Color) -> Tile:
    """Convert an sRGB color to linear light."""
    return (np.array(color, dtype=np.float32) / np.float32(255)) ** np.float32(2.2)


def fractal(rng: np.random.Generator, n: int, *, slope: float = 1.0, stretch: float = 1.0) -> Tile:
    """Make periodic noise (n, n) of unit variance, its amplitude falling as 1 / frequency^slope.

    A `stretch` above 1 draws it out along x, as grain in wood.
    """
    spectrum = np.fft.rfft2(rng.standard_normal((n, n), dtype=np.float32))
    rows, cols = np.fft.fftfreq(n)[:, None], np.fft.rfftfreq(n)[None]
    radius = np.hypot(rows, cols * stretch)
    # The mean has no frequency, so it is left out.
    radius[0, 0] = np.inf
    noise = np.fft.irfft2(spectrum / (radius**slope).astype(np.float32), s=(n, n))
    return (noise / noise.std()).astype(np.float32)


class Studio:
    """Makes tiles of n x n texels, sharing a few fields of noise between them.

    A field costs a transform; a handful serves all tiles, because each tile starts at another place
    of a field. Choices that depend on n have their own generator, so n changes no other choice.
    """

    def __init__(self, rng: np.random.Generator, n: int) -> None:
        self.rng, self.n = rng, n
        (self._grains,) = rng.spawn(1)
        self._fields = [fractal(self._grains, n, slope=slope) for slope in (1.0, 1.0, 1.3)]
        self._grain = fractal(self._grains, n, stretch=14)

    def noise(self, field: int = 0) -> Tile:
        """Return unit-variance 1/f noise; field 2 is smoother than 0 and 1."""
        return self._elsewhere(self._fields[field])

    def _elsewhere(self, field: Tile) -> Tile:
        rows, cols = self._grains.integers(self.n, size=2).tolist()
        return np.roll(field, (rows, cols), axis=(0, 1))

    def _grid(self, wobble: float) -> tuple[Array, Array]:
        """Return row and column of every texel as shares of the tile, with unsteady lines."""
        steps = np.arange(self.n, dtype=np.float32) / self.n
        return steps[:, None] + wobble * self.noise(2), steps[None] + wobble * self.noise(2)

    def plain(self, color: Color, *, tone: float, hue: float = 0.03) -> Tile:
        """Make one uneven color: its tone's strength makes it plaster, glaze, earth or stone."""
        return tinted(color, tone * self.noise(), hue * self.noise(2))

    def bricks(self, color: Color, *, courses: int, per_course: int) -> Tile:
        """Lay bricks in stretcher bond; courses must be even, so that the tile repeats."""
        y, x = self._grid(0.0008)

        row = np.floor(y * courses)
        # Every second course is shifted by half a brick.
        x = x * per_course + 0.5 * (row % 2)
        col = np.floor(x)

        # Mortar lies where the nearest edge is closer than the gap.
        shares = (y * courses - row, x - col)
        edges = [np.minimum(s, 1 - s) for s in shares]
        gap = np.minimum(edges[0] / courses, edges[1] / per_course) * self.n
        brick = np.clip((gap - 0.004 * self.n) / (0.004 * self.n), 0, 1)[..., None]

        row, col = row.astype(int) % courses, col.astype(int) % per_course
        tones, hues = (self.rng.normal(0, s, (courses, per_course)) for s in (0.28, 0.12))
        face = tinted(color, tones[row, col] + 0.3 * self.noise(), hues[row, col])
        mortar = tinted((176, 168, 155), 0.3 * self.noise(1))

        return blend(mortar, face, brick)

    def planks(self, color: Color, *, count: int, joints: bool = True) -> Tile:
        """Lay boards along x, with grain and gaps, and two joints a tile in each."""
        y, x = self._grid(0.0006)

        board = np.floor(y * count)
        share = y * count - board
        board = board.astype(int) % count

        joint = self.rng.uniform(size=count)[board]
        piece = ((x - joint) % 1 > (0.5 if joints else 1)).astype(int)

        gap = np.minimum(share, 1 - share) / count
        ends = abs((x - joint + 0.25) % 0.5 - 0.25)
        seam = np.clip((np.minimum(gap, ends) if joints else gap) / 0.0022 - 0.4, 0.12, 1)

        # Each piece of a board takes its grain from another place.
        shifts = self._grains.integers(self.n, size=(count, 2))
        columns = (np.arange(self.n)[None] + shifts[board, piece]) % self.n
        rows = (np.arange(self.n)[:, None] + shifts[board, 1 - piece]) % self.n
        grain: Tile = self._grain[rows, columns]

        tones = self.rng.normal(0, 0.16, (count, 2))[board, piece]
        rings = 0.12 * np.sin(9 * grain + 12 * np.pi * y)
        face = tinted(color, tones + 0.3 * grain + rings + 0.12 * self.noise(), 0.08 * grain)
        face *= seam[..., None]
        return face

    def cobbles(self, colors: Sequence[Color], *, across: int, dome: float) -> Tile:
        """Lay stones of many tones with dark gaps: pebbles (domes) or crazy paving (flat)."""
        y, x = self._grid(0.1 / across)
        nearest, second, cell = self._cells(y * across, x * across, across)

        # Stones meet where two seeds are equally far, so the gaps are there.
        gap = np.clip((second - nearest) / 0.12 - 0.3, 0, 1)
        tones = self.rng.normal(0, 0.3, across * across)[cell]
        kinds = self.rng.integers(len(colors), size=across * across)[cell]
        relief = np.exp(tones + 0.17 * self.noise() - dome * nearest**2) * (0.15 + 0.85 * gap)

        palette = np.array([linear(color) for color in colors])
        return palette[kinds] * relief[..., None].astype(np.float32)

    def _cells(self, y: Array, x: Array, across: int) -> tuple[Array, Array, NDArray[np.intp]]:
        """Return Worley's cells, one seed per square: least and second distance, and whose."""
        seeds = self.rng.uniform(0.1, 0.9, size=(across, across, 2)).astype(np.float32)

        around = np.pad(np.arange(across), 2, mode="wrap")  # a wobble may leave the tile by one
        numbers = (around[:, None] * across + around).ravel()
        offset_y, offset_x = (seeds.reshape(-1, 2)[numbers, k] for k in (0, 1))

        row, col = np.floor(y), np.floor(x)
        within_y, within_x = y - row, x - col
        home = ((row + 2) * (across + 4) + (col + 2)).astype(np.intp)
        nearest = np.full(home.shape, np.inf, dtype=np.float32)
        second, cell = nearest.copy(), np.zeros(home.shape, dtype=np.intp)

        # The nearest two seeds lie in the nine squares around, except rare ones that do not show.
        for i in (-1, 0, 1):
            for j in (-1, 0, 1):
                square = home + (i * (across + 4) + j)
                dy, dx = offset_y[square] - (within_y - i), offset_x[square] - (within_x - j)
                distance = dy * dy + dx * dx
                np.copyto(cell, square, where=distance < nearest)
                second = np.minimum(second, np.maximum(nearest, distance))
                nearest = np.minimum(nearest, distance)

        return np.sqrt(nearest), np.sqrt(second), numbers[cell]

    def foliage(self, color: Color, *, leaves: int, length: float) -> Tile:
        """Paste leaves over leaves from the dark ground up; length is a share of the tile."""
        n, half = self.n, max(2, int(length * self.n / 2))
        tile = tinted(color, 0.3 * self.noise() - 2.2)
        stamps = [self._stamp(color, half) for _ in range(32)]

        for k in range(leaves):
            top, left = (n * self.rng.uniform(size=2)).astype(int)
            rows, cols, colors = stamps[int(self.rng.integers(len(stamps)))]
            # The first leaves lie deep in the shade of the others.
            tone = np.float32(np.exp(self.rng.normal(0.9 * k / leaves - 0.9, 0.22)))
            tile[(rows + top) % n, (cols + left) % n] = colors * tone

        tile *= np.exp(0.15 * self.noise())[..., None]
        return tile

    def _stamp(self, color: Color, half: int) -> tuple[Array, Array, Tile]:
        """Return a turned leaf, bright on one side: rows, columns and colors of its texels."""
        turn = self.rng.uniform(0, 2 * np.pi)
        square = np.arange(-half, half + 1, dtype=np.float32) / half
        along = np.cos(turn) * square[None] + np.sin(turn) * square[:, None]
        aside = np.cos(turn) * square[:, None] - np.sin(turn) * square[None]

        rows, cols = np.nonzero(abs(aside) < 0.42 * (1 - along**2))
        tone = 0.5 * np.exp(-((aside / 0.06) ** 2)) + 0.25 * along + 0.5 * aside
        hue = np.full(rows.size, self.rng.normal(0, 0.15))
        return rows, cols, tinted(color, tone[rows, cols], hue)

    def leaf(self, color: Color, *, tone: float) -> Tile:
        """Draw a leaf along x from its shaded foot: pale veins in the middle and at the sides."""
        y, x = self._grid(0.004)
        v, u = y - 0.5, x - 0.5

        # Side veins rise from the middle one at a slant.
        ribs = abs((14 * (u - 0.7 * abs(v))) % 1 - 0.5)
        veins = 0.45 * np.exp(-((v / 0.015) ** 2)) + 0.4 * np.clip(0.12 - ribs, 0, 1) / 0.12
        shade = tone + 0.9 * np.clip(u, -0.5, 0.2)
        return tinted(color, veins + shade + 0.22 * self.noise(), 0.1 * self.noise(2))

    def print(self, paper: Color, inks: Sequence[Color]) -> Tile:
        """Print a cover: a title, a picture of hills under a sun, and lines of type."""
        n, rng = self.n, self.rng
        first, second, third = (inks[k] for k in rng.permutation(len(inks))[:3])

        tile = tinted(paper, 0.05 * self.noise(2) + 0.03 * self.noise())
        self._type(tile[int(0.07 * n) : int(0.2 * n), int(0.08 * n) :], second, lines=1)

        low, high = int(0.24 * n), int(rng.uniform(0.55, 0.7) * n)
        left, right = int(rng.uniform(0.0, 0.2) * n), int(rng.uniform(0.75, 1.0) * n)
        picture = self._hills(first, second, third)
        tile[low:high, left:right] = picture[low:high, left:right]

        self._type(tile[high + int(0.05 * n) : int(0.93 * n), int(0.1 * n) :], third, lines=6)
        return tile

    def _hills(self, sky: Color, sun: Color, land: Color) -> Tile:
        """Draw a landscape in a few colors: ranges of hills, each darker than the one behind."""
        y, x = self._grid(0.0)
        tile = tinted(sky, 0.2 * self.noise() + 0.8 * y)

        center = self.rng.uniform(0.3, 0.7)
        radius = 0.09
        tile[np.hypot(y - 0.36, x - center) < radius] = linear(sun)

        for k in range(3):
            ridge = 0.4 + 0.1 * k + 0.035 * self.noise(2)[self.n // 2]
            ground = y > ridge[None]
            tile[ground] = tinted(land, 0.35 * self.noise() + 0.3 - 0.5 * k)[ground]

        return tile

    def _type(self, area: Tile, ink: Color, *, lines: int) -> None:
        """Set lines of letters, random marks of 3x5 squares, with spaces between the words."""
        lines = min(lines, area.shape[0] // 7)
        size = area.shape[0] // (7 * lines)
        letters = int(0.9 * area.shape[1]) // (4 * size)

        # A letter is 3 x 5 marks in a field of 4 x 7.
        marks = self._grains.choice([True, False], (lines, 7, letters, 4), p=[0.6, 0.4])
        marks[:, 5:], marks[..., 3] = False, False
        marks &= self._grains.choice([True, False], (lines, 1, letters, 1), p=[0.83, 0.17])

        block = np.kron(marks.reshape(lines * 7, letters * 4), np.ones((size, size), dtype=bool))
        area[: block.shape[0], : block.shape[1]][block] = linear(ink)


def tinted(color: Color, tone: Array, hue: Array | None = None) -> Tile:
    """Spread a color over a field of log brightness and, warm against cold, of hue."""
    red, green, blue = linear(color)
    bright = np.exp(tone).astype(np.float32, copy=False)
    warm = np.float32(1) if hue is None else np.exp(hue).astype(np.float32, copy=False)
    return np.stack([red * bright * warm, green * bright, blue * bright / warm], axis=-1)


def blend(under: Tile, over: Tile, share: Array) -> Tile:
    """Mix two tiles by the share of the upper one."""
    return under + (over - under) * np.asarray(share, dtype=np.float32)

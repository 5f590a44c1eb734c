"""Defines the cases: rendered rooms, scenes as they are and upsampled, real table tops.

A case is light and names the source of its images. Its task holds the images, and defines how their
maps are counted.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from phasestereo import match
from phasestereo.io import read_image
from phasestereo.rig.findings import unwarned
from phasestereo_bench.arrays import Floats, Image, Mask
from phasestereo_bench.cases import PLANES
from phasestereo_bench.datasets import Pair, Scene, find_scenes
from phasestereo_bench.degradation import Degradation
from phasestereo_bench.rendering import ROOMS, RoomKind, render_room
from phasestereo_bench.surfaces.measures import gray_of, kinds_of_pixels

UPSAMPLED = frozenset(
    f"{collection}/{scene}"
    for collection, scenes in (
        ("scenes2005/ThirdSize", ("Art", "Moebius")),
        ("scenes2006/ThirdSize", ("Aloe", "Lampshade1")),
    )
    for scene in scenes
)
"""Scenes to upsample: three with rich texture, one with a large plain shade."""

FACTORS = 1, 2, 3
"""Factors by which the sampling of an upsampled scene is finer."""

MEGAPIXELS = 0.5, 2.0
SEEDS = 3

AS_IS = "scenes as they are"
OWN = ", own pixels"

_UPSAMPLED_NOISE = 1.5  # gray levels
_TABLE_FOLDER = "tabletop"
_TABLE_FILES = "left.png", "right.png", "disparity.png"
_ROOM_NAMES = {"table": "rendered table tops", "room": "rooms", "curved": "plain curved things"}
_LONG_MEGAPIXELS = 68.0  # 8192 px wide

_SURE = 0.9  # confidence of the quarter-size match that the sensor's scale is fitted to
_FIT_ROUNDS, _FIT_LEAST = 15, 1.0  # px
_FIT_POINTS = 200


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One way to count the maps of a task.

    Attributes
    ----------
    row
        The row of the table.
    truth
        Disparities (H, W) at the scale of the view, px; NaN = unknown.
    kinds
        The pixels of each kind, as `kinds_of_pixels` returns them.
    every
        The view takes the middle pixel of each block of this many pixels in either direction, and
        divides its disparity by this number.
    """

    row: str
    truth: Floats
    kinds: Mapping[str, Mask]
    every: int = 1

    def seen(self, disparity: Floats) -> Floats:
        """Return the map at the scale of the view."""
        first = self.every // 2
        return disparity[first :: self.every, first :: self.every] / self.every


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """Images to match, and the views that count the maps."""

    left: Image
    right: Image
    num_disparities: int
    views: tuple[View, ...]


@dataclass(frozen=True, slots=True)
class RoomCase:
    """A rendered room at a size."""

    kind: RoomKind
    seed: int
    width: int
    height: int

    @property
    def row(self) -> str:
        """Row of the table."""
        return f"{_ROOM_NAMES[self.kind]}, {self.width * self.height / 1e6:.2g} MP"

    @property
    def name(self) -> str:
        """Name of the scene."""
        return f"{self.kind}-{self.seed}"

    def load(self) -> Task:
        """Render it."""
        pair = render_room(self.seed, self.kind, height=self.height, width=self.width)
        return Task(pair.left, pair.right, pair.num_disparities, (_view(self.row, pair),))


@dataclass(frozen=True, slots=True)
class SceneCase:
    """A scene as it is, or upsampled with fresh noise."""

    scene: Scene
    factor: int = 1
    row: str = AS_IS

    @property
    def name(self) -> str:
        """Name of the scene."""
        return str(self.scene)

    def load(self) -> Task:
        """Read the scene, and upsample it; count its maps at either scale."""
        pair = self.scene.load()
        known, visible = pair.scored
        factor = self.factor
        view = _view(self.row, pair, every=factor)
        if factor == 1:
            return Task(pair.left, pair.right, pair.num_disparities, (view,))

        left, right = (
            _upsampled(image, factor, seed) for seed, image in enumerate((pair.left, pair.right))
        )
        square = np.ones((factor, factor))
        truth = np.kron(known, square) * factor
        seen = np.kron(visible, square) > 0
        own = View(self.row + OWN, truth, kinds_of_pixels(truth, seen, gray_of(left)))
        return Task(left, right, pair.num_disparities * factor, (view, own))


@dataclass(frozen=True, slots=True)
class TableCase:
    """A real table top, with the map from the sensor that took the pair."""

    folder: Path
    row: str = field(default="real table tops", init=False)

    @property
    def name(self) -> str:
        """Name of the scene."""
        return f"{_TABLE_FOLDER}/{self.folder.name}"

    def load(self) -> Task:
        """Read the pair, and fit the sensor's map to a match at a quarter of the size."""
        images = [read_image(self.folder / name) for name in _TABLE_FILES]
        left, right, levels = (image.astype(np.uint8) for image in images)
        levels = levels if levels.ndim == 2 else levels[..., 0]
        if any(image.dtype != np.uint8 for image in images):
            raise ValueError(f"{self.folder}: its images must have 8 bits")
        if right.shape != left.shape or levels.shape != left.shape[:2]:
            raise ValueError(f"{self.folder}: its images differ in size")

        truth = _fitted(self.folder, left, right, levels)
        known = np.isfinite(truth)
        view = View(self.row, truth, kinds_of_pixels(truth, known, gray_of(left)))
        count = 16 * math.ceil((float(truth[known].max()) + 16) / 16)
        return Task(left, right, count, (view,))


SurfaceCase = RoomCase | SceneCase | TableCase


@lru_cache(1)
def load(case: SurfaceCase) -> Task:
    """Load a case; the jobs of all methods share it, so do not change it."""
    return case.load()


def surface_cases(
    folders: Iterable[Path] = (),
    *,
    megapixels: Sequence[float] = MEGAPIXELS,
    seeds: int = SEEDS,
) -> list[SurfaceCase]:
    """Return the cases of the suite.

    Parameters
    ----------
    folders
        Folders with the scenes of `UPSAMPLED` and `PLANES` as `find_scenes` finds them, or with
        table tops as ``tabletop/NAME/left.png``, ``right.png`` and ``disparity.png``; or the folder
        ``tabletop`` itself. Without any, only rooms.
    megapixels
        Sizes of the rooms, each from 0.01 to 67.
    seeds
        Number of rooms of each kind, >= 0.

    Raises
    ------
    OSError
        If a folder does not exist.
    ValueError
        If an argument is out of range, a folder has neither a scene nor a table top, or no case is
        left.
    """
    if seeds < 0:
        raise ValueError(f"seeds: got {seeds}; accepts 0 and more")
    wrong = [size for size in megapixels if not 0.01 <= size < _LONG_MEGAPIXELS]
    if wrong:
        raise ValueError(f"megapixels: got {wrong[0]:g}; accepts 0.01 to {_LONG_MEGAPIXELS:g}")

    rooms: list[SurfaceCase] = [
        RoomCase(kind, seed, *_room_size(size))
        for size in dict.fromkeys(megapixels)
        for kind in ROOMS
        for seed in range(seeds)
    ]

    scenes, tables = _found(folders)
    there = {str(scene): scene for scene in scenes}
    upsampled = [
        SceneCase(there[name], factor, AS_IS if factor == 1 else f"upsampled {factor}x")
        for factor in FACTORS
        for name in sorted(UPSAMPLED & set(there))
    ]
    planes = [SceneCase(there[name], row="large planes") for name in sorted(PLANES & set(there))]

    cases = [*rooms, *upsampled, *planes, *map(TableCase, tables)]
    if not cases:
        raise ValueError("there is nothing to match: no rooms are wanted, and no folder is given")
    return cases


def _room_size(megapixels: float) -> tuple[int, int]:
    """Return width and height, 4:3."""
    quarter = max(round(math.sqrt(megapixels * 1e6 / 12)), 8)
    return 4 * quarter, 3 * quarter


def _found(folders: Iterable[Path]) -> tuple[list[Scene], list[Path]]:
    """Return the scenes and the table tops of folders."""
    scenes: dict[tuple[Path, str], Scene] = {}
    tables: dict[Path, None] = {}

    for folder in folders:
        root = Path(folder).absolute()
        of_tables = root if root.name == _TABLE_FOLDER else root / _TABLE_FOLDER
        there = [
            each
            for each in sorted(of_tables.glob("*"))
            if all((each / name).is_file() for name in _TABLE_FILES)
        ]
        tables |= dict.fromkeys(there)

        try:
            scenes |= {(scene.folder, scene.name): scene for scene in find_scenes(root)}
        except ValueError as error:
            if not there:
                tops = f"{_TABLE_FOLDER}/*/{_TABLE_FILES[0]}"
                raise ValueError(f"{error}, and for {tops}") from error

    return list(scenes.values()), list(tables)


def _view(row: str, pair: Pair, *, every: int = 1) -> View:
    """Return the view of a pair at its own scale."""
    truth, seen = pair.scored
    kinds = kinds_of_pixels(truth, seen, gray_of(pair.left), pair.masks.get("curved"))
    return View(row, truth, kinds, every)


def _upsampled(image: Image, factor: int, seed: int) -> Image:
    """Interpolate an image with cubics, and add the noise of a sensor."""
    height, width = image.shape[:2]
    size = (width * factor, height * factor)
    smooth = np.asarray(Pillow.fromarray(image).resize(size, Pillow.Resampling.BICUBIC))
    return Degradation(noise=_UPSAMPLED_NOISE, seed=seed)(smooth)


def _fitted(folder: Path, left: Image, right: Image, levels: NDArray[Any]) -> Floats:
    """Return the sensor's map in px; its levels are linear in the disparity, and 0 is unknown.

    The scale and the offset fit the confident pixels of a quarter-size match best.
    """
    with unwarned():
        found = match(_quarter(left), _quarter(right), threads=1)

    # The middle of four by four pixels.
    height, width = found.disparity.shape
    level = levels[2::4, 2::4][:height, :width].astype(np.float64)
    use = (level > 0) & np.isfinite(found.disparity)
    if found.confidence is not None:
        use &= found.confidence >= _SURE
    x, y = level[use], 4.0 * found.disparity[use]
    if x.size < _FIT_POINTS or np.ptp(x) == 0:
        raise ValueError(f"{folder}: too little of it is matched to know the scale of its map")

    # Repeat least squares, each time without the pixels that are off by more than twice the median.
    keep = np.ones(x.size, dtype=bool)
    slope, offset = 0.0, 0.0
    for _ in range(_FIT_ROUNDS):
        slope, offset = np.polyfit(x[keep], y[keep], 1).tolist()
        off = np.abs(slope * x + offset - y)
        keep = off < max(_FIT_LEAST, 2 * float(np.median(off)))

    return np.where(levels > 0, slope * levels + offset, np.nan)


def _quarter(image: Image) -> Image:
    """Return the means of four by four pixels."""
    height, width = (4 * (size // 4) for size in image.shape[:2])
    blocks = image[:height, :width].reshape(height // 4, 4, width // 4, 4, -1)
    means: Image = np.rint(blocks.mean(axis=(1, 3))).astype(np.uint8)
    return means if image.ndim == 3 else means[..., 0]

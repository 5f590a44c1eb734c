"""Loads or renders the pairs to time: 8-bit gray images, from thumbnails to six megapixels."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo.io import read_image, write_image
from phasestereo_bench.datasets import find_scene
from phasestereo_bench.rendering import render_pair

Gray = NDArray[np.uint8]
Views = tuple[Gray, Gray]

_SIZED = re.compile(r"(\d+(?:\.\d+)?)MPx(\d+)")
_MOST_MEGAPIXELS, _MOST_DISPARITIES = 64, 1024


@dataclass(frozen=True, slots=True, eq=False)
class GrayPair:
    """Two images, uint8 (H, W), and the number of disparities to search, a multiple of 16."""

    name: str
    left: Gray
    right: Gray
    num_disparities: int

    @property
    def evaluations(self) -> int:
        """Pixels times disparities."""
        return self.left.size * self.num_disparities


class PairSource(NamedTuple):
    """The source of a pair: a function of a folder of data and a folder for rendered pairs."""

    num_disparities: int
    load: Callable[[Path | None, Path], Views]


def find_pairs(
    data: Path | None, *, cache: Path, names: Sequence[str] = ()
) -> tuple[list[GrayPair], list[str]]:
    """Load the available pairs.

    Parameters
    ----------
    data
        A folder that holds ``middlebury``, laid out as on the Middlebury site, and
        ``large/chess_1920x1080``, with ``left.png`` and ``right.png``; or Middlebury's folders
        themselves. None: only rendered pairs.
    cache
        Folder for rendered pairs; rendering takes ten seconds a megapixel the first time.
    names
        Only these of `PAIRS`, in this order, or sizes and disparities of pairs to render, such as
        "24MPx512"; empty: all of `PAIRS`.

    Returns
    -------
    tuple
        The pairs, and one line for each missing pair with the reason.

    Raises
    ------
    ImportError
        If OpenCV is not installed.
    OSError
        If the rendered pair cannot be written.
    ValueError
        If there is no pair of that name.
    """
    found, left_out = [], []
    for name in dict.fromkeys(names or PAIRS):
        source = _source(name)
        if source is None:
            accepts = f"{', '.join(PAIRS)}, and sizes such as 0.1MPx16 or 24MPx512"
            raise ValueError(f"pairs: got {name!r}; accepts {accepts}")
        try:
            left, right = source.load(data, cache)
        except Missing as error:
            left_out.append(f"left out: {name}, {error}")
        else:
            found.append(GrayPair(name, left, right, source.num_disparities))

    return found, left_out


def _source(name: str) -> PairSource | None:
    """Return the source of a pair: one of `PAIRS`, or rendered as its name says; or None."""
    sized = _SIZED.fullmatch(name)
    if sized is None:
        return PAIRS.get(name)

    megapixels, count = float(sized[1]), int(sized[2])
    if not (
        0.01 <= megapixels <= _MOST_MEGAPIXELS and count in range(16, _MOST_DISPARITIES + 1, 16)
    ):
        return None
    rows = round(math.sqrt(megapixels * 1e6 * 3 / 4))
    return _render(rows * 4 // 3, rows, count)


class Missing(Exception):  # noqa: N818 - not an error: some users do not have every pair
    """A pair is missing; the message names the files."""


def _scene(name: str, data: Path | None, _cache: Path) -> Views:
    """Read a Middlebury scene."""
    if data is None:
        raise Missing("which takes a folder of data")

    tree = data / "middlebury"
    try:
        pair = find_scene(tree if tree.is_dir() else data, name).load()
    except (OSError, ValueError) as error:
        raise Missing(str(error)) from error
    return _gray(pair.left), _gray(pair.right)


def _chess(data: Path | None, _cache: Path) -> Views:
    if data is None:
        raise Missing("which takes a folder of data")
    return _read(data / "large" / "chess_1920x1080", "left.png", "right.png")


def _render(width: int, height: int, count: int) -> PairSource:
    """Return a pair without faults; render it the first time."""
    return PairSource(count, partial(_rendered, size=(width, height, count)))


def _rendered(_data: Path | None, cache: Path, *, size: tuple[int, int, int]) -> Views:
    """Read a pair rendered earlier, or render it."""
    width, height, count = size
    files = tuple(f"rendered-{width}x{height}x{count}-{side}.png" for side in ("left", "right"))
    if not all((cache / file).exists() for file in files):
        pair = render_pair(height=height, width=width, num_disparities=count)
        for file, view in zip(files, (pair.left, pair.right), strict=True):
            write_image(cache / file, _gray(view))
    return _read(cache, *files)


def _read(folder: Path, left: str, right: str) -> Views:
    try:
        views = _gray(read_image(folder / left)), _gray(read_image(folder / right))
    except (OSError, ValueError) as error:
        raise Missing(str(error)) from error

    if views[0].shape != views[1].shape:
        raise Missing(f"whose images in {folder} differ in size")
    return views


def _gray(image: NDArray[np.generic]) -> Gray:
    """Return a gray image, converted as OpenCV does."""
    if image.dtype != np.uint8:
        raise ValueError(f"images must be of 8 bits, got {image.dtype}")
    if image.ndim == 2:
        return np.ascontiguousarray(image, np.uint8)

    cv2 = require("cv2", extra="opencv")
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(image[..., :3]), cv2.COLOR_RGB2GRAY))


PAIRS: Mapping[str, PairSource] = {
    "tsukuba": PairSource(16, partial(_scene, "scenes2001/tsukuba")),
    "cones": PairSource(64, partial(_scene, "scenes2003/cones")),
    "Motorcycle": PairSource(64, partial(_scene, "trainingQ/Motorcycle")),
    "chess": PairSource(256, _chess),
    "full-hd": _render(1920, 1080, 128),
    "rendered": _render(2964, 1988, 256),
}
"""The pairs by name, with the rendered pairs at the end. Other pairs are rendered by their names:
"0.1MPx16" to "24MPx512"."""

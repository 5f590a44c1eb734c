"""Pairs to be timed: 8-bit gray images, from thumbnails to six megapixels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasestereo._extras import require
from phasestereo.io import read_image, write_image
from phasestereo_bench.datasets import find_scene
from phasestereo_bench.rendering import render_pair

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    Gray = NDArray[np.uint8]
    Views = tuple[Gray, Gray]

_WIDTH, _HEIGHT, _COUNT = 2964, 1988, 256
_RENDERED = tuple(f"rendered-{_WIDTH}x{_HEIGHT}-{side}.png" for side in ("left", "right"))


@dataclass(frozen=True, slots=True, eq=False)
class GrayPair:
    """Two images, uint8 (H, W), and how many disparities to search, a multiple of 16."""

    name: str
    left: Gray
    right: Gray
    num_disparities: int

    @property
    def evaluations(self) -> int:
        """Pixels times disparities."""
        return self.left.size * self.num_disparities


class PairSource(NamedTuple):
    """Where a pair comes from: called with a folder of data and one for what is made."""

    num_disparities: int
    load: Callable[[Path | None, Path], Views]


def find_pairs(
    data: Path | None, *, cache: Path, names: Sequence[str] = ()
) -> tuple[list[GrayPair], list[str]]:
    """Load the pairs that are there.

    Parameters
    ----------
    data
        A folder that holds ``middlebury``, laid out as on the Middlebury site, and
        ``large/chess_1920x1080``, with ``left.png`` and ``right.png``; or Middlebury's folders
        themselves. None: there is only what can be rendered.
    cache
        Folder for the pair that is rendered, which takes about a minute the first time.
    names
        Only these of `PAIRS`, in this order; none: all.

    Returns
    -------
    tuple
        The pairs, and why the others are left out, a line each.

    Raises
    ------
    ImportError
        If OpenCV is not installed.
    OSError
        If the rendered pair cannot be written.
    ValueError
        If there is no pair of that name.
    """
    unknown = [name for name in names if name not in PAIRS]
    if unknown:
        raise ValueError(f"pairs: got {unknown[0]!r}; accepts {', '.join(PAIRS)}")

    found, left_out = [], []
    for name in dict.fromkeys(names or PAIRS):
        source = PAIRS[name]
        try:
            left, right = source.load(data, cache)
        except Missing as error:
            left_out.append(f"left out: {name}, {error}")
        else:
            found.append(GrayPair(name, left, right, source.num_disparities))

    return found, left_out


def is_rendered(cache: Path) -> bool:
    """Return whether the pair that takes a minute to render is there already."""
    return all((cache / file).exists() for file in _RENDERED)


class Missing(Exception):  # noqa: N818 - nothing went wrong: not everybody has every pair
    """A pair is not there; the message says what was looked for."""


def _scene(name: str, data: Path | None, _cache: Path) -> Views:
    """Read a scene of Middlebury's."""
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


def _rendered(_data: Path | None, cache: Path) -> Views:
    """Read the pair that was rendered earlier, or render it."""
    if not is_rendered(cache):
        pair = render_pair(height=_HEIGHT, width=_WIDTH, num_disparities=_COUNT)
        for file, view in zip(_RENDERED, (pair.left, pair.right), strict=True):
            write_image(cache / file, _gray(view))
    return _read(cache, *_RENDERED)


def _read(folder: Path, left: str, right: str) -> Views:
    try:
        views = _gray(read_image(folder / left)), _gray(read_image(folder / right))
    except (OSError, ValueError) as error:
        raise Missing(str(error)) from error

    if views[0].shape != views[1].shape:
        raise Missing(f"whose images in {folder} differ in size")
    return views


def _gray(image: NDArray[np.generic]) -> Gray:
    """Return an image as OpenCV makes it gray."""
    if image.dtype != np.uint8:
        raise ValueError(f"images must be of 8 bits, got {image.dtype}")
    if image.ndim == 2:
        return np.ascontiguousarray(image, np.uint8)

    cv2 = require("cv2", extra="opencv")
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(image[..., :3]), cv2.COLOR_RGB2GRAY))


PAIRS: MappingProxyType[str, PairSource] = MappingProxyType(
    {
        "tsukuba": PairSource(16, partial(_scene, "scenes2001/tsukuba")),
        "cones": PairSource(64, partial(_scene, "scenes2003/cones")),
        "Motorcycle": PairSource(64, partial(_scene, "trainingQ/Motorcycle")),
        "chess": PairSource(256, _chess),
        "rendered": PairSource(_COUNT, _rendered),
    }
)
"""The pairs by name, in the order of their size."""

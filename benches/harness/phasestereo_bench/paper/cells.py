"""One cell of the experiments: a pair, a degradation of its left image, and settings."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import phasestereo
from phasestereo.matcher import match
from phasestereo.metrics import middlebury_v2
from phasestereo_bench.datasets import find_scene
from phasestereo_bench.runner import Job, run

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterable

    import numpy as np
    from numpy.typing import NDArray

    from phasestereo.settings import Settings
    from phasestereo_bench.datasets import Pair
    from phasestereo_bench.paper.blurs import Blur

    Map = NDArray[np.float32]

__all__ = ["SCENES", "Cell", "Pairs", "Scores", "disparities", "load_pairs", "measure"]

SCENES = {"cones": "scenes2003/cones", "tsukuba": "scenes2001/tsukuba"}
"""The paper's pairs, in the order of its columns, and where Middlebury's folders have them."""


@dataclass(frozen=True, slots=True)
class Cell:
    """What is measured once, however many figures and tables show it."""

    scene: str
    blur: Blur
    settings: Settings

    def job(self, pairs: Pairs) -> Job:
        """Return the job that measures it.

        The key holds a digest of the pair and the version of this package: another pair under the
        same name, or another matcher, is another cell.
        """
        settings = self.settings
        is_phase = settings.cost == "phase"
        key: dict[str, str | float | None] = {
            "kind": "paper",
            "version": phasestereo.__version__,
            "scene": self.scene,
            "pair": pairs.digests[self.scene],
            "degradation": self.blur.kind,
            "amount": float(self.blur.amount),
            "recipe": self.blur.recipe,
            "method": settings.cost,
            "power": settings.power if is_phase else None,
            "bits": settings.bits if is_phase else None,
            "neighborhood": settings.neighborhood if is_phase else None,
            "window": settings.window,
            "penalty": float(cast("float", settings.penalty)),
        }
        arguments = {"folder": str(pairs.folder), "cell": self}
        return Job(key, score_cell, arguments)


@dataclass(frozen=True, slots=True)
class Pairs:
    """Where the pairs are, and what tells them from others of their names."""

    folder: Path
    digests: dict[str, str]


@dataclass(frozen=True, slots=True)
class Scores:
    """% of pixels that are off by more than 1 pixel, by region; None without a mask of it."""

    nonocc: float
    all: float | None
    disc: float | None


def measure(
    cells: Iterable[Cell],
    pairs: Pairs,
    store: Path,
    *,
    workers: int | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> dict[Cell, Scores]:
    """Measure cells, but for those which a store has already.

    Parameters
    ----------
    cells
        Which; any of them may come more than once.
    pairs
        As of `load_pairs`.
    store, workers, progress
        As for `phasestereo_bench.run`.

    Raises
    ------
    RuntimeError
        If a cell failed; those that did not are in the store.
    OSError, TypeError, ValueError, KeyboardInterrupt
        As `phasestereo_bench.run`.
    """
    # One image after another: a process keeps the last few that it degraded.
    ordered = sorted(dict.fromkeys(cells), key=lambda cell: (cell.scene, str(cell.blur)))
    jobs = [cell.job(pairs) for cell in ordered]
    records = run(jobs, store, workers=workers, progress=progress)
    failed = [record for record in records if record["status"] != "ok"]
    if failed:
        raise RuntimeError(
            f"{len(failed)} of {len(records)} cells failed, the first with: {failed[0]['error']}; "
            f"the others are kept in {store}"
        )
    regions = ("nonocc", "all", "disc")
    scores = [Scores(**{region: record[region] for region in regions}) for record in records]
    return dict(zip(ordered, scores, strict=True))


def load_pairs(folder: str | os.PathLike[str]) -> Pairs:
    """Find the paper's pairs in a Middlebury folder tree, and check that they can be scored.

    Raises
    ------
    OSError
        If the folder or a file of it cannot be read.
    ValueError
        If a pair is not there, or comes without truth or without a mask of what both images see.
    """
    root = Path(folder).absolute()
    return Pairs(root, {scene: _digest(load_pair(str(root), scene)) for scene in SCENES})


@lru_cache(maxsize=len(SCENES))
def load_pair(folder: str, scene: str) -> Pair:
    """Return a pair that can be scored; errors as those of `load_pairs`."""
    found = find_scene(folder, SCENES[scene])
    pair = found.load()
    if pair.truth is None or "nonocc" not in pair.masks:
        raise ValueError(
            f"{found.folder}: has no truth with a mask of the pixels that both images see "
            f"({found.layout.truth} and mask_nonocc.png, or the truth of either image)"
        )
    return pair


def score_cell(folder: str, cell: Cell) -> dict[str, Any]:
    """Match and return the percentages of pixels that are off by more than 1 pixel, by region."""
    pair = load_pair(folder, cell.scene)
    estimate = disparities(folder, cell)
    scores = middlebury_v2(estimate, pair)
    return {"nonocc": scores.nonocc, "all": scores.all, "disc": scores.disc}


def disparities(folder: str, cell: Cell) -> Map:
    """Return the disparities of the left image, pixels."""
    pair = load_pair(folder, cell.scene)
    left = degraded(folder, cell.scene, cell.blur)
    count = pair.num_disparities
    return match(
        left, pair.right, num_disparities=count, settings=cell.settings, threads=1
    ).disparity


@lru_cache(maxsize=4)
def degraded(folder: str, scene: str, blur: Blur) -> NDArray[np.uint8]:
    """Return the left image of a pair, degraded; cells of one image are measured in a row."""
    image: NDArray[np.uint8] = blur(load_pair(folder, scene).left)
    image.flags.writeable = False
    return image


def _digest(pair: Pair) -> str:
    content = hashlib.sha256()
    for array in (pair.left, pair.right, pair.truth, pair.masks["nonocc"]):
        content.update(cast("Map", array).tobytes())
    return content.hexdigest()[:12]

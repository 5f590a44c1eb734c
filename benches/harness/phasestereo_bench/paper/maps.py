"""The disparity maps of Figure 5: the third experiment at one amount of blur."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, cast

from phasestereo.io import write_disparity
from phasestereo.metrics import bad_pixels
from phasestereo_bench.paper.cells import SCENES, degraded, disparities, load_pair
from phasestereo_bench.paper.experiments import AREAS, MAPS_LEVEL
from phasestereo_bench.paper.methods import NSAD, PHASE, SAD
from phasestereo_bench.paper.study import cell_at

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from phasestereo_bench.paper.cells import Pairs
    from phasestereo_bench.paper.study import Study

    Map = NDArray[np.float32]

__all__ = ["Found", "SceneMaps", "make_maps", "write_maps"]


class Found(NamedTuple):
    """What a method found: its name, disparities in pixels, and % of bad non-occluded pixels."""

    method: str
    name: str
    disparity: Map
    bad: float


class SceneMaps(NamedTuple):
    """The row of a pair: the left image as it was matched, what was found, and the truth."""

    scene: str
    left: NDArray[Any]
    found: list[Found]
    truth: Map


def make_maps(study: Study, pairs: Pairs, protocol: str) -> list[SceneMaps]:
    """Match again, to have the maps: phase codes by the first rule for L, SAD, normalised SAD."""
    folder = str(pairs.folder)
    rows = []
    for scene in SCENES:
        pair = load_pair(folder, scene)
        truth = cast("Map", pair.truth)
        found = []
        for method in (SAD, NSAD, PHASE):
            series = next(s for s in AREAS.series(protocol) if s.method is method)
            cell = cell_at(series, AREAS, scene, MAPS_LEVEL, study.choices)
            disparity = disparities(folder, cell)
            bad = bad_pixels(disparity, truth, 1.0, pair.masks["nonocc"])
            found.append(Found(method.cost, method.name, disparity, bad))
        left = degraded(folder, scene, AREAS.blur(MAPS_LEVEL))
        rows.append(SceneMaps(scene, left, found, truth))
    return rows


def write_maps(rows: list[SceneMaps], folder: Path) -> list[Path]:
    """Write every map as a PFM file, named after its pair and method; return the files."""
    files = []
    for row in rows:
        maps = {each.method: each.disparity for each in row.found}
        for name, disparity in {**maps, "truth": row.truth}.items():
            files.append(folder / f"{row.scene}_{name}.pfm")
            write_disparity(files[-1], disparity)
    return files

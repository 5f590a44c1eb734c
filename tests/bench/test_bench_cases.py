"""Cases: which image is degraded, by what, and what the other one becomes."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from phasestereo import io
from phasestereo_bench import middlebury_jobs, run_jobs
from phasestereo_bench.cases import Case
from phasestereo_bench.datasets import Scene, find_scenes
from phasestereo_bench.degradation import Degradation, disk_psf, suite

for module in ("scipy", "PIL"):
    pytest.importorskip(module)

SHIFT = 4


def plant(root: Path, name: str, *, truth: bool = True, gray: bool = False) -> Path:
    """Plant a scene of 2001's layout, everywhere at disparity SHIFT; return the tree's root."""
    folder = root / "scenes2001" / name
    folder.mkdir(parents=True)

    rng = np.random.default_rng(len(name))
    texture = rng.integers(40, 216, (48, 72 + SHIFT, 3), dtype=np.uint8)

    if gray:
        texture = texture[:, :, 0]

    left, right = ("im0.pgm", "im1.pgm") if gray else ("im2.ppm", "im6.ppm")
    io.write_image(folder / left, texture[:, :-SHIFT].copy())
    io.write_image(folder / right, texture[:, SHIFT:].copy())

    if truth:
        level = np.full((48, 72), 8 * SHIFT, np.uint8)
        for file in ("disp0.pgm", "disp1.pgm") if gray else ("disp2.pgm", "disp6.pgm"):
            io.write_image(folder / file, level)

    return root


def run_middlebury(*arguments: Any, workers: int | None = None, **options: Any) -> list[Any]:
    """Return the records of the cells that `middlebury_jobs` makes of these arguments."""
    with TemporaryDirectory() as folder:
        jobs = middlebury_jobs(*arguments, **options)
        return run_jobs(jobs, Path(folder) / "records.jsonl", workers=workers)


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    return find_scenes(plant(tmp_path, "one"))[0]


def views(case: Case, *, true_blur: bool = False) -> dict[str, NDArray[np.uint8]]:
    pair = case.pair(true_blur=true_blur)
    return {"left": pair.left, "right": pair.right}


@pytest.mark.parametrize(("side", "other"), [("left", "right"), ("right", "left")])
@pytest.mark.parametrize("name", suite())
def test_one_side_alone_is_degraded(scene: Scene, name: str, side: str, other: str) -> None:
    pair = scene.load()
    seen = views(Case(scene, "one-sided-blur", name, side))
    np.testing.assert_array_equal(seen[other], getattr(pair, other))
    np.testing.assert_array_equal(seen[side], suite()[name](getattr(pair, side)))


@pytest.mark.parametrize(("side", "other"), [("left", "right"), ("right", "left")])
def test_true_blur_is_that_of_the_other_image(scene: Scene, side: str, other: str) -> None:
    pair = scene.load()
    seen = views(Case(scene, "one-sided-blur", "disk 3", side), true_blur=True)
    np.testing.assert_array_equal(seen[other], Degradation(disk_psf(3))(getattr(pair, other)))
    np.testing.assert_array_equal(seen[side], suite()["disk 3"](getattr(pair, side)))


def test_which_rows_have_a_true_blur(scene: Scene) -> None:
    cases = [Case(scene, "one-sided-blur", name, "left") for name in suite()]
    without = {case.degradation for case in cases if case.kernel is None}
    assert without == {"sharp", "contrast 1.5 0.6", "mixed"}
    with pytest.raises(ValueError, match="no true blur of 'mixed'"):
        views(Case(scene, "one-sided-blur", "mixed", "left"), true_blur=True)

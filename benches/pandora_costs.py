"""Pandora's pipelines with one matching cost or another, on sharp pairs and on blurred ones.

    python benches/pandora_costs.py FOLDER

Prints the table of docs/pandora.md: bad pixels in percent, means over tsukuba, venus and cones of
Middlebury's FOLDER. It needs pandora-plugin-libsgm besides Pandora, and two minutes. Images are
made gray by luma; "blurred" is the right image as the row "gauss 2" of the suite one-sided-blur has
it. Scored are non-occluded pixels, but for a border of 10 and those columns on the left whose range
leaves the right image. A pixel without an estimate is bad; what the cross-check rejects keeps its
estimate.
"""

from __future__ import annotations

import logging
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandora
import xarray

from phasestereo_bench.datasets import find_scene
from phasestereo_bench.degradation import suite

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from phasestereo_bench.datasets import Pair

SCENES = "tsukuba", "venus", "cones"
BORDER = 10
BLURRED = suite()["gauss 2"]
COSTS: dict[str, tuple[str, int, tuple[int, int] | None]] = {
    # what it is called: its method, its window, and (P1, P2): those of CARS for census
    "`census`, 5": ("census", 5, (8, 32)),
    "`census`, 11": ("census", 11, (20, 80)),
    "`zncc`, 9": ("zncc", 9, None),
    "`phase`, 5": ("phase", 5, (4, 16)),
    "`phase`, 9": ("phase", 9, None),
}


def main(folder: Path) -> None:
    """Print the table, a row as soon as it is known."""
    logging.disable(logging.WARNING)  # the state machine reports every step
    pandora.import_plugin()
    pairs = [find_scene(folder, name).load() for name in SCENES]
    print("| matching cost | `cbca` | `cbca`, blurred | `sgm` | `sgm`, blurred |")  # noqa: T201
    print("|---|---|---|---|---|")  # noqa: T201 -- what this script is for
    for name, (method, window, penalty) in COSTS.items():
        steps = [{"aggregation": {"aggregation_method": "cbca"}}]
        steps += [] if penalty is None else [{"optimization": semi_global(*penalty)}]
        cost = {"matching_cost_method": method, "window_size": window}
        means = [
            np.mean([wrong(pair, pipeline(cost, step), is_blurred=blurred) for pair in pairs])
            for step in steps
            for blurred in (False, True)
        ]
        cells = [f"{mean:.1f}" for mean in means] + [""] * (4 - len(means))
        print(f"| {name} | {' | '.join(cells)} |", flush=True)  # noqa: T201


def semi_global(p1: int, p2: int) -> dict[str, Any]:
    """Return the step of pandora-plugin-libsgm."""
    penalty = {"P1": p1, "P2": p2, "p2_method": "constant", "penalty_method": "sgm_penalty"}
    return {"optimization_method": "sgm", "overcounting": False, "penalty": penalty}


def pipeline(cost: dict[str, Any], step: dict[str, Any]) -> dict[str, Any]:
    """Return a whole pipeline with one matching cost and one way to smooth."""
    steps = {
        "matching_cost": cost,
        **step,
        "disparity": {"disparity_method": "wta", "invalid_disparity": "NaN"},
        "refinement": {"refinement_method": "vfit"},
        "filter": {"filter_method": "median", "filter_size": 3},
        "validation": {"validation_method": "cross_checking_accurate"},
    }
    return {"pipeline": steps}


def wrong(pair: Pair, config: dict[str, Any], *, is_blurred: bool) -> float:
    """Return the share of bad pixels in percent."""
    count = pair.num_disparities
    right = BLURRED(pair.right) if is_blurred else pair.right
    views = as_dataset(pair.left, (-count, 0)), as_dataset(right, (0, count))
    machine = pandora.state_machine.PandoraMachine()
    told = [view.assign_coords(band_im=[None]) for view in views]
    checked = pandora.check_configuration.check_pipeline_section(config, *told, machine)
    disparity = -pandora.run(machine, *views, checked)[0]["disparity_map"].data
    inner = slice(BORDER, -BORDER), slice(count + BORDER, -BORDER)
    is_right = np.abs(disparity - pair.truth)[inner] <= 1  # False for NaN
    return float(100 * np.mean(~is_right[pair.masks["nonocc"][inner]]))


def as_dataset(image: NDArray[Any], disparities: tuple[int, int]) -> Any:
    """Return an image as Pandora reads it from a file."""
    gray = image @ [0.299, 0.587, 0.114] if image.ndim == 3 else image
    rows, cols = gray.shape
    found = xarray.Dataset(
        {"im": (("row", "col"), gray.astype(np.float32))},
        {"row": np.arange(rows), "col": np.arange(cols)},
        {"valid_pixels": 0, "no_data_mask": 1, "crs": None, "transform": None},
    )
    return pandora.img_tools.add_disparity(found, list(disparities), window=None)


if __name__ == "__main__":
    main(Path(sys.argv[1]))

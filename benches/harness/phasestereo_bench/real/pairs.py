"""Loads real pairs with a truth: another exposure, and lenses focused at different distances."""

from pathlib import Path
from typing import Any

import numpy as np

from phasestereo.io import read_image
from phasestereo_bench.datasets import Pair, find_scenes
from phasestereo_bench.middlebury import wrong_shares

_EXPOSURE = "MotorcycleE"  # like Motorcycle, with another exposure of the right image
_FOCUS = "real_defocus/breakfast"
_SHIFT = 16  # px: the disparity that the harness gives the pair
_COUNT = 64  # disparities to search


def find_pairs(root: Path) -> dict[str, Path]:
    """Return the folders of the available real pairs, by their names in tables.

    Parameters
    ----------
    root
        Holds Middlebury's folder tree in ``middlebury``, and ``real_defocus/breakfast``: the two
        photographs of Watanabe and Nayar (IJCV 1998), one focused far and one near, through a lens
        that shows both at the same scale.
    """
    pairs = {}
    if (root / "middlebury").is_dir():
        for scene in find_scenes(root / "middlebury"):
            if scene.name == _EXPOSURE:
                pairs["exposure"] = scene.folder

    if (root / _FOCUS / "left.png").is_file():
        pairs["focus"] = root / _FOCUS

    return pairs


def load_pair(name: str, folder: Path) -> Pair:
    """Load a real pair; move the right image of "focus" by 16 px, which is then the truth.

    Raises
    ------
    OSError, ValueError, ImportError
        If its files cannot be read.
    """
    if name == "exposure":
        return find_scenes(folder)[0].load()

    left, right = (
        read_image(folder / f"{side}.png").astype(np.uint8, copy=False)
        for side in ("left", "right")
    )

    # The first columns have no match: it would lie left of the right image.
    known = np.zeros(left[:, _SHIFT:].shape[:2], np.bool_)
    known[:, _SHIFT:] = True
    truth = np.full(known.shape, _SHIFT, np.float32)
    left, right = left[:, :-_SHIFT].copy(), right[:, _SHIFT:].copy()

    return Pair(name, left, right, truth, None, {"nonocc": known}, _COUNT, None)


def score_pair(name: str, folder: Path, spec: str) -> dict[str, Any]:
    """Match a real pair; return shares of wrong pixels, %, as ``"bad_1"`` and ``"bad_2"``."""
    return wrong_shares(load_pair(name, folder), spec)

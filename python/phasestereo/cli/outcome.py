"""What a match came to: everything that ``phasestereo match`` may be asked to write or to show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo.cli.geometry import Rig
from phasestereo.cli.scoring import Truth
from phasestereo.metrics import Score
from phasestereo.rectification import Rectification
from phasestereo.result import Result
from phasestereo.settings import Settings

Image = NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """A result, its pair, and its score.

    Parameters
    ----------
    pair
        The left and the right image.
    result
        The result.
    disparities
        The smallest disparity searched, and how many were.
    truth, score
        The disparities known to be right, if any, and the metrics against them.
    rig
        The geometry of the pair, if it is known.
    place
        Where on Earth the left image lies, if its file says so.
    names
        The names of the images' files.
    rectified
        How the pair was rectified, if it was.
    """

    pair: tuple[Image, Image]
    result: Result
    disparities: tuple[int, int]
    truth: Truth | None = None
    score: Score | None = None
    rig: Rig | None = None
    place: Any = None
    names: tuple[str, str] = ("left", "right")
    rectified: Rectification | None = None


def rehearsal(disparities: tuple[int, int], settings: Settings, rig: Rig | None = None) -> Outcome:
    """Return the smallest outcome there is that has the smallest and the largest disparity."""
    low, count = disparities
    high = low + count - 1
    extremes = np.array([[low, low, high, high]] * 2, dtype=np.float32)  # a surface each
    black = np.zeros(extremes.shape, dtype=np.uint8)
    flags = np.zeros(extremes.shape, dtype=np.uint16)
    ones = np.ones_like(extremes) if settings.confidence else None

    result = Result(extremes, flags, ones, settings, {"matching": 0.0}, uncertainty=ones)

    small = None if rig is None else rig.of_size(extremes.shape)
    return Outcome((black, black), result, disparities, rig=small)

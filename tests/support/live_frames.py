"""Frames for the page of a run."""

from __future__ import annotations

import numpy as np

import phasestereo as ps
from phasestereo_live.video.streaming import Frame

ROWS, COLS, COUNT, SHIFT = 60, 90, 16, 5


SCENE = np.random.default_rng(0).integers(0, 256, (ROWS, COLS + SHIFT, 3), np.uint8)


LEFT, RIGHT = SCENE[:, :-SHIFT].copy(), SCENE[:, SHIFT:].copy()


FAST = ps.PRESETS["fast"]


def frame(index: int = 0, apart: float | None = None) -> Frame:
    result = ps.match(LEFT, RIGHT, num_disparities=COUNT, settings=FAST)
    return Frame(index, index / 10, LEFT, RIGHT, result, apart)

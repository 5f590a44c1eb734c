"""Pairs that are made quickly."""

from __future__ import annotations

from typing import Any

import numpy as np


def noise_pair(rows: int, cols: int, shift: int, seed: int = 0) -> tuple[Any, Any]:
    """Return a pair of random texture in which every pixel has the disparity ``shift``."""
    texture = np.random.default_rng(seed).integers(0, 256, (rows, cols + shift), np.uint8)
    return texture[:, :cols], texture[:, shift:]

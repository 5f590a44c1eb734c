"""How the cameras of pairs stand to each other, from what their images show, and nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from phasestereo._core import rectify_pairs
from phasestereo._images import Pixels
from phasestereo.io.rigs.cameras import Cameras, Maps


class EstimatedMaps(NamedTuple):
    """The maps that rectify a pair, the expected error in rows, and sentences."""

    maps: Maps
    error: float
    sentences: tuple[str, ...]


def estimated(pairs: Sequence[tuple[Pixels, Pixels]]) -> EstimatedMaps:
    """Estimate the cameras of pairs that all come from the same two.

    Parameters
    ----------
    pairs
        As `opened_alike` returns them, all of one size.

    Raises
    ------
    ValueError
        If they differ in size, or the images do not show enough; the message says why.
    """
    size = pairs[0][0].shape[1], pairs[0][0].shape[0]
    if any(pair[0].shape[:2] != size[::-1] for pair in pairs):
        raise ValueError(f"others: got pairs of another size; accepts that of left, {size[::-1]}")

    for pair in pairs:
        for image, side in zip(pair, ("left", "right"), strict=True):
            if not np.isfinite(image).all():
                raise ValueError(f"{side}: got NaN or infinite pixels; accepts finite ones")

    matrices, error, sentences = rectify_pairs(pairs)
    return EstimatedMaps(Cameras(matrices=matrices).warp(size, None).maps, error, tuple(sentences))

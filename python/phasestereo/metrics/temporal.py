"""How steady the disparity maps of a video are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phasestereo._images import as_numbers
from phasestereo.metrics.pixels import Floats, Mask

_LEAST_FRAMES = 2


def temporal_deviation(estimates: Sequence[Floats] | Floats, mask: Mask | None = None) -> float:
    """Return the standard deviation of a pixel's disparity over the frames, mean over the pixels.

    It says how much the maps of a scene that stands still flicker, whether they are right or not.
    Scored are pixels that have a finite estimate in every frame: look at how many these are, too.

    Parameters
    ----------
    estimates
        Disparities in px of two frames at least, float (N, H, W) or a sequence of (H, W); NaN or
        infinite = missing.
    mask
        Pixels to score, bool (H, W): those whose true disparity is the same in all frames. Without
        one, all.

    Returns
    -------
    float
        px, 0 and above. The deviation is that of all frames about their mean (N, not N - 1).

    Raises
    ------
    TypeError
        If the disparities are not floats, or the mask is not bool.
    ValueError
        If there are fewer than two frames, shapes differ, or nothing is left to score.
    """
    if len(estimates) < _LEAST_FRAMES:
        raise ValueError(f"estimates: got {len(estimates)} frames; accepts two or more")
    size = as_numbers(estimates[0], "estimates", "f").shape
    stack = np.stack([as_numbers(each, "estimates", "f", size) for each in estimates])
    scored = np.isfinite(stack).all(axis=0)
    if mask is not None:
        scored &= as_numbers(mask, "mask", "b", size)

    if not scored.any():
        raise ValueError("nothing is left to score: no pixel has an estimate in every frame")

    return float(stack[:, scored].astype(np.float64).std(axis=0).mean())

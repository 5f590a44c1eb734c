"""How steady the disparity maps of a video are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phasestereo.metrics.pixels import Floats, Mask, checked_disparities, checked_mask

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
    maps = [checked_disparities("estimates", estimate) for estimate in estimates]

    if len(maps) < _LEAST_FRAMES:
        raise ValueError(f"estimates must be of two frames or more, got {len(maps)}")

    shapes = sorted({each.shape for each in maps})
    if len(shapes) > 1 or len(shapes[0]) != 2:  # (H, W)
        raise ValueError(f"estimates must be 2-D (H, W) and of one shape, got {shapes}")

    stack = np.stack(maps)
    scored = np.isfinite(stack).all(axis=0)
    if mask is not None:
        scored &= checked_mask(mask, shapes[0])

    if not scored.any():
        raise ValueError("nothing is left to score: no pixel has an estimate in every frame")

    return float(stack[:, scored].astype(np.float64).std(axis=0).mean())

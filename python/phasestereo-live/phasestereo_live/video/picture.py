"""Turn frames into pictures to look at, in the same colors throughout a video."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from phasestereo._images import as_pixels, as_rgb8
from phasestereo.views.picture import NEUTRAL, colorize, hatched
from phasestereo_live.video.streaming import Frame

_STEPS = 256  # of the colors: one more means no estimate


class FramePicture:
    """Puts the disparities of a frame, in color, beside its left image.

    It looks up the colors of `phasestereo.views.picture.colorize` in a table. They mean the same in
    every picture, so a video does not flicker.

    Parameters
    ----------
    low, high
        Disparities at the ends of the colors; beyond them the colors stay.

    Raises
    ------
    TypeError, ValueError
        If these are not finite numbers, or low is not below high.
    ImportError
        If matplotlib is not installed.
    """

    def __init__(self, low: float, high: float) -> None:
        if not (math.isfinite(low) and math.isfinite(high)):
            raise ValueError(f"low: got {low} and high {high}; accepts finite numbers")

        if not low < high:
            raise ValueError(f"low: got {low}; accepts less than high, which is {high}")

        self._low = low
        self._scale = (_STEPS - 1) / (high - low)
        ramp = np.linspace(low, high, _STEPS)[np.newaxis]
        none = np.array([NEUTRAL], np.uint8)
        self._colors = np.concatenate([colorize(ramp, low=low, high=high)[0], none])

    def __call__(self, frame: Frame) -> NDArray[np.uint8]:
        """Return the picture: uint8 (H, 2 W, 3), RGB; untrusted pixels are hatched."""
        disparity = frame.result.disparity
        steps = np.rint((disparity - np.float32(self._low)) * np.float32(self._scale))
        steps = np.where(np.isnan(steps), _STEPS, np.clip(steps, 0, _STEPS - 1))
        colored: NDArray[np.uint8] = self._colors[steps.astype(np.intp)]
        unsure = np.isfinite(disparity) & ~frame.result.trusted
        left = as_rgb8(as_pixels(frame.left, "left"))
        return np.concatenate([left, hatched(colored, unsure)], axis=1)

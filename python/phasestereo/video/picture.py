"""Frames as pictures to look at, all of a video in the same colours."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from phasestereo.picture import NEUTRAL, colorize

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from phasestereo.streaming import Frame

_STEPS = 256  # of the colours: one more stands for no estimate


class FramePicture:
    """Puts the disparities of a frame, in colour, beside its left image.

    The colours are those of `phasestereo.picture.colorize`, looked up in a table. They mean the
    same in every picture, so that a video does not flicker.

    Parameters
    ----------
    low, high
        Disparities at the ends of the colours; beyond them the colours stay.

    Raises
    ------
    TypeError, ValueError
        If these are no finite numbers, or low is not below high.
    ImportError
        If matplotlib is not installed.
    """

    def __init__(self, low: float, high: float) -> None:
        if not low < high:
            raise ValueError(f"low: got {low}; accepts less than high, which is {high}")
        self._low, self._scale = low, (_STEPS - 1) / (high - low)
        ramp = np.linspace(low, high, _STEPS)[np.newaxis]
        none = np.array([NEUTRAL], np.uint8)
        self._colours = np.concatenate([colorize(ramp, low=low, high=high)[0], none])

    def __call__(self, frame: Frame) -> NDArray[np.uint8]:
        """Return the picture: uint8 (H, 2 W, 3), RGB."""
        disparity = frame.result.disparity
        steps = np.rint((disparity - np.float32(self._low)) * np.float32(self._scale))
        steps = np.where(np.isnan(steps), _STEPS, np.clip(steps, 0, _STEPS - 1))
        coloured = self._colours[steps.astype(np.intp)]
        return np.concatenate([viewable(frame.left), coloured], axis=1)


def viewable(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Return an image as uint8 (H, W, 3); floats are stretched between their extremes."""
    pixels = image.reshape(*image.shape[:2], -1)[:, :, :3]
    if pixels.dtype == np.uint16:
        pixels = pixels >> 8
    elif pixels.dtype.kind == "f":
        known = pixels[np.isfinite(pixels)]
        low, high = (known.min(), known.max()) if known.size else (0.0, 1.0)
        stretched = (pixels - low) * (255 / max(high - low, np.finfo(np.float32).tiny))
        pixels = np.nan_to_num(stretched).clip(0, 255)
    return np.broadcast_to(pixels.astype(np.uint8), (*pixels.shape[:2], 3))

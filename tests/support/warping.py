"""Images moved as a badly mounted camera moves them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage


def moved(
    image: NDArray[Any], *, down: float = 0.0, clockwise: float = 0.0, scale: float = 1.0
) -> NDArray[Any]:
    """Move what an image shows down by pixels, turn it about the center by degrees, scale it."""
    turn = np.deg2rad(clockwise)
    inverse = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) / scale
    center = (np.array(image.shape[:2]) - 1) / 2
    offset = center - inverse @ (center + np.array([down, 0]))

    channels = [
        ndimage.affine_transform(plane.astype(np.float64), inverse, offset, mode="mirror")
        for plane in np.moveaxis(np.atleast_3d(image), 2, 0)
    ]
    stacked: NDArray[np.float64] = np.stack(channels, axis=2).reshape(image.shape)

    if image.dtype == np.uint8:
        stacked = np.clip(np.rint(stacked), 0, 255)
    return stacked.astype(image.dtype)

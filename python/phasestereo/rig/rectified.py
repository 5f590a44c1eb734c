"""What a match makes of a pair that is far from rectified."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

_Plane: TypeAlias = NDArray[np.float32]
_Point: TypeAlias = tuple[float, float]
_Camera: TypeAlias = tuple[float, _Point, _Point, list[list[float]], _Point]

RectifiedByCore: TypeAlias = (
    "tuple[list[_Plane], _Plane, _Plane, tuple[_Camera, _Camera], float, float]"
)
"""What the core returns: columns and rows of the left image, then of the right one; disparities,
rows, cameras, the focal length of the rectified images, and the error of their rows."""


@dataclass(frozen=True, slots=True, eq=False)
class Rectified:
    """The rectified pair that was matched in place of one that is far from rectified.

    Parameters
    ----------
    disparity
        float32 (H, W), pixels: rectified left pixel (x, y) corresponds to rectified right pixel
        (x - disparity, y). NaN as in `Result.disparity`. A depth goes by these.
    rows
        float32 (H, W), pixels: left pixel (x, y), as the image came, corresponds to right pixel
        (x - ``result.disparity``, y + rows). NaN where there is no disparity.
    maps
        ``((left x, left y), (right x, right y))``, each float32 (H, W): the column and the row of
        the image as it came at which a rectified pixel is read, as ``cv2.remap`` takes them. NaN
        where no ray of that camera comes from.
    calibration
        The cameras as OpenCV has them: ``K1, D1, R1, P1, K2, D2, R2, P2``. `phasestereo.rectify`
        takes it as a calibration, for other pairs of the same cameras. The focal length is hardly
        known from two images, and their distance not at all.
    error
        Rows by which blocks of the rectified images differ, root mean square, pixels.
    """

    disparity: _Plane
    rows: _Plane
    maps: tuple[tuple[_Plane, _Plane], tuple[_Plane, _Plane]]
    calibration: Mapping[str, NDArray[np.float64]]
    error: float


def as_rectified(found: RectifiedByCore | None) -> Rectified | None:
    """Return what the core found as Python has it."""
    if found is None:
        return None

    (left_x, left_y, right_x, right_y), disparity, rows, cameras, focal, error = found
    calibration = {}
    for index, (length, center, distortion, rotation, target) in enumerate(cameras, 1):
        calibration[f"K{index}"] = _intrinsics(length, center)
        calibration[f"D{index}"] = np.array([*distortion, 0.0, 0.0])
        calibration[f"R{index}"] = np.array(rotation)
        calibration[f"P{index}"] = np.column_stack([_intrinsics(focal, target), np.zeros(3)])

    maps = (left_x, left_y), (right_x, right_y)
    return Rectified(disparity, rows, maps, calibration, error)


def _intrinsics(focal: float, center: _Point) -> NDArray[np.float64]:
    return np.array([[focal, 0, center[0]], [0, focal, center[1]], [0, 0, 1]])

"""The rectified pair that a match makes from a pair far from rectified."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

_Plane: TypeAlias = NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rectified:
    """The rectified pair that was matched instead of a pair far from rectified.

    Parameters
    ----------
    disparity
        float32 (H, W), pixels: rectified left pixel (x, y) corresponds to rectified right pixel (x
        - disparity, y). NaN as in `Result.disparity`. Depths follow from these.
    rows
        float32 (H, W), pixels: original left pixel (x, y) corresponds to right pixel (x -
        ``result.disparity``, y + rows). NaN without a disparity.
    maps
        ``((left x, left y), (right x, right y))``, each float32 (H, W): the column and the row of
        the original image at which a rectified pixel is read, as ``cv2.remap`` takes them. NaN
        where the camera has no ray.
    calibration
        The cameras by OpenCV's names: ``K1, D1, R1, P1, K2, D2, R2, P2``. `phasestereo.rectify`
        takes it as a calibration, for other pairs of the same cameras. Two images hardly show the
        focal length, and never the distance of the cameras.
    error
        Rows by which blocks of the rectified images differ, root mean square, pixels.

    Examples
    --------
    >>> rectified = ps.match(left, right).rectified  # None: the pair was matched as it is
    """

    disparity: _Plane
    rows: _Plane
    maps: tuple[tuple[_Plane, _Plane], tuple[_Plane, _Plane]]
    calibration: Mapping[str, NDArray[np.float64]]
    error: float

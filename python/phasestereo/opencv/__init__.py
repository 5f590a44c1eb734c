"""A stereo matcher that replaces OpenCV's: same names, same numbers, same channel order.

    from phasestereo.opencv import StereoPhase_create

    stereo = StereoPhase_create(minDisparity=0, numDisparities=64, blockSize=5)
    disparity = stereo.compute(left, right)  # int16, 16 = 1 px, (minDisparity - 1) * 16: none

This package adapts the interface and does no matching: `parameters` are OpenCV's, with get and set;
`stereo` computes; `filtering` serves `cv2.ximgproc`. Images are BGR, as OpenCV reads them. Only
`createDisparityWLSFilter` needs OpenCV.
"""

from __future__ import annotations

from phasestereo.opencv.filtering import (
    RightMatcher,
    createDisparityWLSFilter,
    createRightMatcher,
)
from phasestereo.opencv.stereo import StereoPhase, StereoPhase_create

__all__ = [
    "RightMatcher",
    "StereoPhase",
    "StereoPhase_create",
    "createDisparityWLSFilter",
    "createRightMatcher",
]

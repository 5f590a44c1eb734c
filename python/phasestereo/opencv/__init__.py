"""A stereo matcher that takes the place of OpenCV's: its names, its numbers, its channel order.

    from phasestereo.opencv import StereoPhase_create

    stereo = StereoPhase_create(minDisparity=0, numDisparities=64, blockSize=5)
    disparity = stereo.compute(left, right)  # int16, 16 = 1 px, (minDisparity - 1) * 16: none

Here belongs what makes that so, and no matching: `parameters` are OpenCV's, with get and set;
`stereo` computes; `filtering` is for what `cv2.ximgproc` asks of a matcher. Images are BGR, as
OpenCV reads them. But for `createDisparityWLSFilter` nothing here needs OpenCV.
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

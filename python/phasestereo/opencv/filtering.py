"""Counterparts of `cv2.ximgproc`: the matcher of the right image, and the WLS filter."""

# ruff: noqa: N802 -- the names are OpenCV's

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._extras import require
from phasestereo._numbers import check_type
from phasestereo.opencv.stereo import StereoPhase

NO_CHECK = 1_000_000
"""The disp12MaxDiff with which `cv2.ximgproc` switches the left-right check off."""
# Means of bad-1.0 (%) over two rendered and two Middlebury pairs, non-occluded (all pixels); maps
# as they are: 3.9 (15.5).
#   as below              4.0 (11.1)      radius 2            4.3 (11.4)
#   weight 2000           4.4 (11.3)      weight 8000         5.0 (11.8)
#   color 1.0            3.8 (11.9), with 4 times the mean error: divisions by next to 0
RADIUS, WEIGHT, COLOR = 1, 500.0, 1.5
"""The filter's depth discontinuity radius, lambda and sigma."""


class RightMatcher:
    """The other view of a `StereoPhase`; `createRightMatcher` makes one."""

    def __init__(self, matcher_left: StereoPhase) -> None:
        check_type("matcher_left", matcher_left, StereoPhase, "a StereoPhase")
        self._left = matcher_left

    def compute(self, right: ArrayLike, left: ArrayLike) -> NDArray[np.int16]:
        """Return `StereoPhase.compute_right` of the pair; the right image comes first."""
        return self._left.compute_right(left, right)

    def getMinDisparity(self) -> int:
        """Return the right image's smallest one, ``1 - (minDisparity + numDisparities)``."""
        return 1 - self._left.getMinDisparity() - self._left.getNumDisparities()

    def getNumDisparities(self) -> int:
        """Return the number of disparities searched."""
        return self._left.getNumDisparities()

    def __repr__(self) -> str:
        return f"RightMatcher({self._left!r})"


def createRightMatcher(matcher_left: StereoPhase) -> RightMatcher:
    """Make the matcher of the right image, as `cv2.ximgproc.createRightMatcher` does.

    Parameters
    ----------
    matcher_left
        The matcher of the left image; its later changes apply here, too.

    Raises
    ------
    TypeError
        If it is not a `StereoPhase`.
    """
    return RightMatcher(matcher_left)


def createDisparityWLSFilter(matcher_left: StereoPhase) -> Any:
    """Make a WLS filter for a matcher, as `cv2.ximgproc.createDisparityWLSFilter` does.

    Like OpenCV's function, it switches the matcher's checks off (disp12MaxDiff 1000000,
    speckleWindowSize and uniquenessRatio 0): the filter has its own. It works on whole images,
    without a border to leave out, and is set for cleaner maps than OpenCV's: lambda 500, sigma 1.5,
    depth discontinuity radius 1.

    Parameters
    ----------
    matcher_left
        The matcher whose maps will be filtered.

    Returns
    -------
    cv2.ximgproc.DisparityWLSFilter
        With confidence: its ``filter`` also takes the right image's map.

    Raises
    ------
    ImportError
        If OpenCV is not installed (``pip install 'phasestereo[opencv]'``).
    TypeError
        If the matcher is not a `StereoPhase`.
    """
    RightMatcher(matcher_left)  # refuses other matchers

    ximgproc = require("cv2.ximgproc", extra="opencv")
    wls = ximgproc.createDisparityWLSFilterGeneric(use_confidence=True)
    wls.setDepthDiscontinuityRadius(RADIUS)
    wls.setLambda(WEIGHT)
    wls.setSigmaColor(COLOR)

    matcher_left.setDisp12MaxDiff(NO_CHECK)
    matcher_left.setSpeckleWindowSize(0)
    matcher_left.setUniquenessRatio(0)
    return wls

"""What `cv2.ximgproc` makes of a matcher: that of the right image, and the WLS filter for both."""

# ruff: noqa: N802 -- the names are OpenCV's

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from phasestereo._extras import require
from phasestereo.opencv.stereo import StereoPhase

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

NO_CHECK = 1_000_000
"""The disp12MaxDiff by which `cv2.ximgproc` switches the left-right check off."""
DISCONTINUITY_RADIUS = 1
"""How far from jumps in depth the filter doubts disparities, pixels.

Of 1, 2, 3 and 5 this had the least errors on three of five scenes and nearly so on the others."""


class RightMatcher:
    """The other view of a `StereoPhase`; `createRightMatcher` makes one."""

    def __init__(self, matcher_left: StereoPhase) -> None:
        if not isinstance(matcher_left, StereoPhase):
            got = type(matcher_left).__name__
            raise TypeError(f"matcher_left: got {got}; accepts a StereoPhase")
        self._left = matcher_left

    def compute(self, right: ArrayLike, left: ArrayLike) -> NDArray[np.int16]:
        """Return `StereoPhase.compute_right` of the pair; the right image comes first."""
        return self._left.compute_right(left, right)

    def getMinDisparity(self) -> int:
        """Return the right image's smallest, ``1 - (minDisparity + numDisparities)``."""
        return 1 - self._left.getMinDisparity() - self._left.getNumDisparities()

    def getNumDisparities(self) -> int:
        """Return how many disparities are searched."""
        return self._left.getNumDisparities()

    def __repr__(self) -> str:
        """Tell whose right matcher it is."""
        return f"RightMatcher({self._left!r})"


def createRightMatcher(matcher_left: StereoPhase) -> RightMatcher:
    """Make the matcher of the right image, as `cv2.ximgproc.createRightMatcher` does.

    Parameters
    ----------
    matcher_left
        The matcher of the left image; what is set there later holds here, too.

    Raises
    ------
    TypeError
        If it is not a `StereoPhase`.
    """
    return RightMatcher(matcher_left)


def createDisparityWLSFilter(matcher_left: StereoPhase) -> Any:
    """Make a WLS filter for a matcher, as `cv2.ximgproc.createDisparityWLSFilter` does.

    Like that it switches the matcher's checks off (disp12MaxDiff 1000000, speckleWindowSize and
    uniquenessRatio 0): the filter has its own. The filter works on whole images; there is no border
    to be left out.

    Parameters
    ----------
    matcher_left
        The matcher whose maps are to be filtered.

    Returns
    -------
    cv2.ximgproc.DisparityWLSFilter
        With confidence: its ``filter`` takes the right image's map, too.

    Raises
    ------
    ImportError
        If OpenCV is not installed (``pip install 'phasestereo[opencv]'``).
    TypeError
        If the matcher is not a `StereoPhase`.
    """
    RightMatcher(matcher_left)
    matcher_left.setDisp12MaxDiff(NO_CHECK)
    matcher_left.setSpeckleWindowSize(0)
    matcher_left.setUniquenessRatio(0)
    wls = require("cv2.ximgproc", extra="opencv").createDisparityWLSFilterGeneric(True)  # noqa: FBT003 - cv2 takes it by position
    wls.setDepthDiscontinuityRadius(DISCONTINUITY_RADIUS)
    return wls

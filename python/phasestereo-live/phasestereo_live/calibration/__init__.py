"""Calibrate two cameras from pictures of a board: poses, intrinsics, and their accuracy.

    import phasestereo_live as live

    rig = live.calibrate("boards/", board="9x6", square=0.025)
    rig.save("calibration.yaml")
    print(rig.error, rig.advice)

`sources` reads pictures and videos, `boards` finds boards in them, `solving` fits the cameras with
OpenCV and computes their accuracy, `advising` names missing pictures, and `record` holds the
calibration. All of it needs the extra ``rectify``.
"""

from __future__ import annotations

from phasestereo_live.calibration.calibrating import calibrate
from phasestereo_live.calibration.record import BoardView, DepthError, StereoCalibration

__all__ = ["BoardView", "DepthError", "StereoCalibration", "calibrate"]

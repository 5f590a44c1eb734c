"""Two cameras calibrated by pictures of a board: where each stands, how it sees, and how exactly.

    import phasestereo_live as live

    rig = live.calibrate("boards/", board="9x6", square=0.025)
    rig.save("calibration.yaml")
    print(rig.error, rig.advice)

`sources` reads pictures and videos, `boards` finds boards in them, `solving` has OpenCV fit the
cameras and works out how exactly they are known, `advising` says what is missing, and `record` is
what comes of it. All of it needs the extra ``rectify``.
"""

from __future__ import annotations

from phasestereo_live.calibration.calibrating import calibrate
from phasestereo_live.calibration.record import BoardView, DepthError, StereoCalibration

__all__ = ["BoardView", "DepthError", "StereoCalibration", "calibrate"]

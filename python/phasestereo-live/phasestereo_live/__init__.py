"""Match videos, recordings and running cameras frame by frame, and calibrate cameras.

    import phasestereo_live as live

    for frame in live.stream("video.mp4", num_disparities=64, layout="side-by-side"):
        frame.result.disparity

`calibrate` calibrates two cameras from pictures of a board, and `walls` tests them at a wall.
`video` writes videos and draws frames, `ros` reads and writes recordings, `rerun` logs frames,
`viewer` shows them in a browser. Each part imports its dependencies on first use.
"""

from __future__ import annotations

from phasestereo_live.calibration import StereoCalibration, calibrate
from phasestereo_live.video.streaming import Failure, Frame, Stream, stream

__all__ = ["Failure", "Frame", "StereoCalibration", "Stream", "calibrate", "stream"]

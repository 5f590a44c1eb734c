"""Matching frames as they come: from videos, folders, cameras, and recordings of robots.

    import phasestereo_live as live

    for frame in live.stream("video.mp4", num_disparities=64, layout="side-by-side"):
        frame.result.disparity

`video` has what writes videos and draws frames, `ros` reads and writes recordings, `rerun` logs
frames, `viewer` shows them in a browser. What a part needs besides is imported when it is used.
"""

from __future__ import annotations

from phasestereo_live.video.streaming import Failure, Frame, Stream, stream

__all__ = ["Failure", "Frame", "Stream", "stream"]

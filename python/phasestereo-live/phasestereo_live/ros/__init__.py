"""Recordings of robots, read and written without ROS: mcap, rosbag2's SQLite, ROS 1's bag.

    from phasestereo_live import ros

    recording = ros.open_recording("drive.mcap", "/left/image_raw", "/right/image_raw")
    with live.stream(recording, rectify=recording.cameras) as frames:
        for frame in frames:
            header = recording.headers[frame.index]

Here belong the files (`bags`, through the library rosbags, held to bounds by `reading`), what pairs
the frames of two topics (`pairing`), what images are in messages (`images`), what ``camera_info``
holds (`infos`) and the messages that come out (`messages`), which the node of ROS 2 makes, too. It
needs the extra ``ros``.
"""

from __future__ import annotations

from phasestereo_live.ros.bags import RecordingWriter
from phasestereo_live.ros.pairing import Header, UnpairedError
from phasestereo_live.ros.recordings import Recording, open_recording

__all__ = ["Header", "Recording", "RecordingWriter", "UnpairedError", "open_recording"]

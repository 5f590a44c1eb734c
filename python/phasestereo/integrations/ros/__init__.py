"""Recordings of robots, read and written without ROS: mcap, rosbag2's SQLite, ROS 1's bag.

    from phasestereo.integrations import ros

    recording = ros.open_recording("drive.mcap", "/left/image_raw", "/right/image_raw")
    with ps.stream(recording, rectify=recording.cameras) as frames:
        for frame in frames:
            header = recording.headers[frame.index]

Here belong the files (`bags`, through the library rosbags), what pairs the frames of two topics
(`pairing`), what images are in messages (`images`), what ``camera_info`` holds (`infos`) and the
messages that come out (`messages`), which the node of ROS 2 makes, too. It needs the extra ``ros``.
"""

from __future__ import annotations

from phasestereo.integrations.ros.bags import RecordingWriter
from phasestereo.integrations.ros.pairing import Header, UnpairedError
from phasestereo.integrations.ros.recordings import Recording, open_recording

__all__ = ["Header", "Recording", "RecordingWriter", "UnpairedError", "open_recording"]

"""Read and write recordings of robots without ROS: mcap, rosbag2's SQLite, ROS 1's bag.

    from phasestereo_live import ros

    recording = ros.open_recording("drive.mcap", "/left/image_raw", "/right/image_raw")
    with live.stream(recording, rectify=recording.cameras) as frames:
        for frame in frames:
            header = recording.headers[frame.index]

The modules cover the files (`bags`, with the library rosbags, within the bounds of `reading`), the
pairing of two topics (`pairing`), the images in messages (`images`), the contents of
``camera_info`` (`infos`) and the output messages (`messages`), which the ROS 2 node also makes. The
package needs the extra ``ros``.
"""

from __future__ import annotations

from phasestereo_live.ros.bags import RecordingWriter
from phasestereo_live.ros.pairing import Header, UnpairedError
from phasestereo_live.ros.recordings import Recording, open_recording

__all__ = ["Header", "Recording", "RecordingWriter", "UnpairedError", "open_recording"]

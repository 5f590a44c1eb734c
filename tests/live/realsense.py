"""Recordings that librealsense makes of a device in software, and its pipeline that plays them.

realsense.py record SCENE RECORDING | play RECORDING

SCENE is an image, ``.npy``, as wide as the left view and 20 more columns: the right view is that
many to the right.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from itertools import islice
from typing import Any

import numpy as np
import pyrealsense2 as rs

import phasestereo as ps
from support.documentation import example

SHIFT, COUNT = 20, 4


def record(scene: str, path: str) -> None:
    image = np.load(scene)
    rows, cols = image.shape[0], image.shape[1] - SHIFT
    device = rs.software_device()
    sensor = device.add_sensor("Stereo Module")
    profiles = []
    for number in (1, 2):
        stream = rs.video_stream()
        stream.type, stream.index, stream.uid = rs.stream.infrared, number, number
        stream.width, stream.height, stream.fps, stream.bpp = cols, rows, 30, 1
        stream.fmt = rs.format.y8
        k = rs.intrinsics()
        k.width, k.height, k.fx, k.fy = cols, rows, 400, 400
        k.ppx, k.ppy = (cols - 1) / 2, (rows - 1) / 2
        k.model, k.coeffs = rs.distortion.brown_conrady, [0, 0, 0, 0, 0]
        stream.intrinsics = k
        profiles.append(sensor.add_video_stream(stream))
    pose = rs.extrinsics()  # leads points of the first camera to the second one
    pose.rotation, pose.translation = [1, 0, 0, 0, 1, 0, 0, 0, 1], [-0.05, 0, 0]
    profiles[0].register_extrinsics_to(profiles[1], pose)
    recorder = rs.recorder(path, device)
    recorded = recorder.query_sensors()[0]
    recorded.open(recorded.get_stream_profiles())
    recorded.start(rs.frame_queue(100))
    for index in range(COUNT):
        for number, profile in enumerate(profiles):
            frame = rs.software_video_frame()
            frame.pixels = np.ascontiguousarray(image[:, SHIFT * number : SHIFT * number + cols])
            frame.stride, frame.bpp = cols, 1
            frame.timestamp, frame.frame_number = 1000 + 33.3 * index, index + 1
            frame.domain = rs.timestamp_domain.system_time
            frame.profile = profile.as_video_stream_profile()
            sensor.on_video_frame(frame)
        time.sleep(0.05)
    recorded.stop()
    recorded.close()
    del recorded, recorder


def play(path: str) -> None:
    """Run the lines of the documentation on a recording in the place of a camera."""
    live = rs.config

    def of_file() -> Any:
        config = live()
        config.enable_device_from_file(path)
        return config

    rs.config = of_file
    names: dict[str, Any] = {"np": np}
    exec(example("docs/realsense.md", "pyrealsense2"), names)  # noqa: S102 - our own
    found = []
    for left, right in islice(names["pairs"], 2):
        result = ps.match(left, right, num_disparities=48, preset="fast")
        found.append([*left.shape, float(np.median(result.disparity))])
    print(json.dumps(found))  # noqa: T201 - what the test reads


if __name__ == "__main__":
    jobs: dict[str, Callable[..., None]] = {"record": record, "play": play}
    jobs[sys.argv[1]](*sys.argv[2:])

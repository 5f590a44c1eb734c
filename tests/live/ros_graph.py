"""Two processes of ROS 2: the node of phasestereo, and a program that sends it pairs and listens.

ros_graph.py node | pairs

Images are sent "best effort", as cameras send them: pairs are sent until enough are answered.
"""

from __future__ import annotations

import array
import json
import sys
import time
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from stereo_msgs.msg import DisparityImage

ROWS, COLS, SHIFT, FOCAL, BASELINE = 64, 96, 5, 80.0, 0.12
PAIRS = 5
PATIENCE = 2.0  # seconds for the answer to a pair, which may be lost, before the next is sent
KINDS = {
    "disparity": DisparityImage,
    "camera_info": CameraInfo,
    "depth": Image,
    "points2": PointCloud2,
    "/diagnostics": DiagnosticArray,
}


class TimeSynchronizer:
    """What ROS's message_filters, which is in no registry of Python, does: one call a stamp."""

    def __init__(self, views: list[Any], _queue_size: int) -> None:
        self._waiting: dict[tuple[int, int], dict[int, Any]] = {}
        self._count = len(views)
        for number, (node, kind, topic, qos) in enumerate(views):
            # Of a callback with two parameters rclpy fills the second, too.
            node.create_subscription(kind, topic, partial(self._add, number), qos)

    def registerCallback(self, callback: Any) -> None:  # noqa: N802 - its name in message_filters
        self._callback = callback

    def _add(self, number: int, message: Any) -> None:
        stamp = message.header.stamp
        found = self._waiting.setdefault((stamp.sec, stamp.nanosec), {})
        found[number] = message
        if len(found) == self._count:
            self._callback(*(found[at] for at in range(self._count)))


def run_node() -> None:
    filters: Any = ModuleType("message_filters")
    filters.Subscriber = lambda node, kind, topic, qos_profile: (node, kind, topic, qos_profile)
    filters.TimeSynchronizer = TimeSynchronizer
    sys.modules["message_filters"] = filters
    sys.path.insert(0, str(Path(__file__).parents[2] / "python/phasestereo-live/ros"))
    from phasestereo_ros.node import main  # noqa: PLC0415 - with what it imports

    main()


def image(pixels: NDArray[np.uint8], stamp: int) -> Image:
    message = Image(height=ROWS, width=COLS, encoding="rgb8", step=3 * COLS)
    message.data = array.array("B", pixels.tobytes())
    message.header.frame_id = "left_optical"
    message.header.stamp.sec = stamp
    return message


def info(shift: float, stamp: int) -> CameraInfo:
    cx, cy = (COLS - 1) / 2, (ROWS - 1) / 2
    message = CameraInfo(height=ROWS, width=COLS, distortion_model="plumb_bob", d=[0.0] * 5)
    message.k = [FOCAL, 0.0, cx, 0.0, FOCAL, cy, 0.0, 0.0, 1.0]
    message.r = np.eye(3).ravel().tolist()
    message.p = [FOCAL, 0.0, cx, shift, 0.0, FOCAL, cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    message.header.stamp.sec = stamp
    return message


def keep(messages: list[Any], message: Any) -> None:
    messages.append(message)


def send(senders: list[Any], stamp: int) -> None:
    """Send a pair, whose number is its time in seconds, and its geometry."""
    scene = np.random.default_rng(stamp).integers(0, 256, (ROWS, COLS + SHIFT, 3), np.uint8)
    messages = (
        image(np.ascontiguousarray(scene[:, :-SHIFT]), stamp),
        image(np.ascontiguousarray(scene[:, SHIFT:]), stamp),
        info(0.0, stamp),
        info(-FOCAL * BASELINE, stamp),
    )
    for sender, message in zip(senders, messages, strict=True):
        sender.publish(message)


def run_pairs() -> None:
    rclpy.init()
    node = Node("pairs")
    found: dict[str, list[Any]] = {topic: [] for topic in KINDS}
    for topic, kind in KINDS.items():
        node.create_subscription(kind, topic, partial(keep, found[topic]), 10)
    topics = "left/image_rect", "right/image_rect", "left/camera_info", "right/camera_info"
    senders = [
        node.create_publisher(kind, topic, qos_profile_sensor_data)
        for topic, kind in zip(topics, (Image, Image, CameraInfo, CameraInfo), strict=True)
    ]

    ready = [*(sender.get_subscription_count for sender in senders)]
    ready += [partial(node.count_publishers, topic) for topic in KINDS]
    while not all(one() for one in ready):
        rclpy.spin_once(node, timeout_sec=0.05)

    stamp = 0
    while min(len(messages) for messages in found.values()) < PAIRS:
        stamp += 1
        send(senders, stamp)
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until and not all(
            messages and messages[-1].header.stamp.sec == stamp for messages in found.values()
        ):
            rclpy.spin_once(node, timeout_sec=0.05)
    print(json.dumps(summary(found)))  # noqa: T201 - what the test reads
    rclpy.shutdown()


def summary(found: dict[str, list[Any]]) -> dict[str, Any]:
    maps = [np.frombuffer(one.image.data, "<f4") for one in found["disparity"]]
    depths = [np.frombuffer(one.data, "<f4") for one in found["depth"]]
    clouds = [np.frombuffer(one.data, "<f4").reshape(-1, 4) for one in found["points2"]]
    return {
        "stamps": {topic: [one.header.stamp.sec for one in all_] for topic, all_ in found.items()},
        "frames": sorted({one.header.frame_id for one in found["depth"]}),
        "geometry": [[one.f, one.t] for one in found["disparity"]],
        "disparity": [float(np.median(one)) for one in maps],
        "depth": [float(np.nanmedian(one)) for one in depths],
        "points": [float(np.nanmedian(one[:, 2])) for one in clouds],
        "statuses": sorted(status.name for status in found["/diagnostics"][0].status),
    }


if __name__ == "__main__":
    {"node": run_node, "pairs": run_pairs}[sys.argv[1]]()

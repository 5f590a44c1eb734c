"""Recordings of robots for tests, made by rosbags itself, and what it reads back of them."""

from __future__ import annotations

import io
import shutil
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from support import counterpart

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

rosbag1, rosbag2 = counterpart("rosbags.rosbag1"), counterpart("rosbags.rosbag2")
typesys = counterpart("rosbags.typesys")

ROS1 = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
ROS2 = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
TOPICS = "/rig/left/image_raw", "/rig/right/image_raw"
INFOS = "/rig/left/camera_info", "/rig/right/camera_info"
START = 1_700_000_000 * 10**9  # ns


def header(types: Any, stamp: int, frame: str = "left_optical") -> Any:
    """Return a header."""
    seconds, rest = divmod(stamp, 10**9)
    time = types.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest)
    seq = {"seq": 0} if types is ROS1 else {}
    return types.types["std_msgs/msg/Header"](stamp=time, frame_id=frame, **seq)


def image(types: Any, stamp: int, samples: NDArray[Any], encoding: str, pad: int = 0) -> Any:
    """Return an image message of samples as they are stored, rows padded by some bytes."""
    lines = samples.reshape(len(samples), -1).view(np.uint8)
    padded = np.pad(lines, ((0, 0), (0, pad)))

    return types.types["sensor_msgs/msg/Image"](
        header=header(types, stamp),
        height=samples.shape[0],
        width=samples.shape[1],
        encoding=encoding,
        is_bigendian=int(samples.dtype.byteorder == ">"),
        step=padded.shape[1],
        data=padded.reshape(-1),
    )


def compressed(types: Any, stamp: int, samples: NDArray[Any], kind: str, text: str) -> Any:
    """Return a compressed image message."""
    file = io.BytesIO()
    Image.fromarray(samples).save(file, kind)
    data = np.frombuffer(file.getvalue(), np.uint8)
    name = "sensor_msgs/msg/CompressedImage"
    return types.types[name](header=header(types, stamp), format=text, data=data)


def info(
    types: Any,
    size: tuple[int, int],
    matrices: dict[str, Any],
    model: str = "plumb_bob",
    *,
    binning: int = 0,
    window: tuple[int, int, int, int] = (0, 0, 0, 0),
    frame: str = "left_optical",
) -> Any:
    """Return a camera_info message of K, D, R and P, for images of this many columns and rows.

    A window is x and y of its first pixel, columns and rows.
    """
    x, y, columns, rows = window
    roi = types.types["sensor_msgs/msg/RegionOfInterest"](
        x_offset=x, y_offset=y, height=rows, width=columns, do_rectify=False
    )

    given = {
        name if types is ROS1 else name.lower(): np.asarray(matrix, np.float64).ravel()
        for name, matrix in matrices.items()
    }

    return types.types["sensor_msgs/msg/CameraInfo"](
        header=header(types, START, frame),
        width=size[0],
        height=size[1],
        distortion_model=model,
        binning_x=binning,
        binning_y=binning,
        roi=roi,
        **given,
    )


def straight(size: tuple[int, int], focal: float, baseline: float, doffs: float = 0.0) -> list[Any]:
    """Return K, D, R and P of both cameras of a rectified pair."""
    cx, cy = (size[0] - 1) / 2, (size[1] - 1) / 2
    found = []
    for shift, offset in ((0.0, 0.0), (-focal * baseline, doffs)):
        k = np.array([[focal, 0, cx + offset], [0, focal, cy], [0, 0, 1]])
        p = np.column_stack([k, [shift, 0, 0]])
        found.append({"K": k, "D": np.zeros(5), "R": np.eye(3), "P": p})
    return found


@dataclass
class Bag:
    """What goes into a recording: topics, times and messages in their order."""

    types: Any = field(default=ROS2)
    items: list[tuple[str, int, Any]] = field(default_factory=list)

    def add(self, topic: str, stamp: int, message: Any) -> None:
        """Add a message."""
        self.items.append((topic, stamp, message))

    def write(self, path: Path, packed: str = "none") -> Path:
        """Write a .bag, a .mcap file, or with any other name a folder of rosbag2.

        A .bag is packed by "bz2" or "lz4", others by zstd: "storage", "message" or "file".
        """
        if path.suffix == ".bag":
            writer = rosbag1.Writer(path)
            if packed != "none":
                writer.set_compression(writer.CompressionFormat[packed.upper()])
            with writer:
                self._fill(writer, self.types.serialize_ros1)
            return path

        folder = path.with_suffix("") if path.suffix == ".mcap" else path
        plugins = rosbag2.StoragePlugin
        plugin = plugins.MCAP if path.suffix == ".mcap" else plugins.SQLITE3

        writer = rosbag2.Writer(folder, version=8, storage_plugin=plugin)
        mode = rosbag2.CompressionMode[packed.upper()]
        writer.set_compression(mode, rosbag2.CompressionFormat.ZSTD)
        with writer:
            self._fill(writer, self.types.serialize_cdr)

        if path.suffix == ".mcap":
            (folder / f"{folder.name}.mcap").rename(path)
            shutil.rmtree(folder)

        return path

    def _fill(self, writer: Any, encode: Any) -> None:
        connections: dict[str, Any] = {}
        for topic, stamp, message in self.items:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=self.types)
            writer.write(connections[topic], stamp, encode(message, kind))


def read(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Return times and messages of a recording by topic, as rosbags reads them."""
    found: dict[str, list[tuple[int, Any]]] = {}
    for topic, time, message in _messages(path):
        found.setdefault(topic, []).append((time, message))
    return found


def _messages(path: Path) -> Iterator[tuple[str, int, Any]]:
    is_ros1 = path.suffix == ".bag"
    reader = (rosbag1 if is_ros1 else rosbag2).Reader(path)
    reader.open()
    decode = ROS1.deserialize_ros1 if is_ros1 else ROS2.deserialize_cdr

    for connection, time, data in reader.messages(connections=reader.connections):
        yield connection.topic, time, decode(data, connection.msgtype)

    reader.close()

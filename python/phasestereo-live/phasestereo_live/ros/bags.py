"""Read and write files of messages with the library rosbags."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from phasestereo._extras import require
from phasestereo.io.drafts import growing
from phasestereo.io.files import StrPath, named, suffix, target_of
from phasestereo_live._closing import Closing
from phasestereo_live.ros.reading import SUFFIXES, reader_of

_SURPLUS = bytes(4)


class Item(NamedTuple):
    """A recorded message: its topic, its time (ns since 1970), and a function that reads it."""

    topic: str
    time: int
    read: Callable[[], Any]


def is_recording(path: StrPath) -> bool:
    """Return whether a path is a recording, by its suffix or by the contents of the folder."""
    place = Path(path)
    return suffix(place) in SUFFIXES or (place / "metadata.yaml").is_file()


class Bag:
    """An open recording.

    Parameters
    ----------
    path
        An ``.mcap`` or ``.db3`` file, a folder of rosbag2, or a ``.bag`` of ROS 1.

    Raises
    ------
    OSError
        If it does not exist or cannot be read.
    ValueError
        If it is not a recording or is cut short.
    ImportError
        If rosbags is not installed.
    """

    def __init__(self, path: StrPath) -> None:
        self._path = Path(path)
        stores = require("rosbags.typesys", extra="ros")
        is_ros1 = suffix(path) == ".bag"
        store = stores.Stores.ROS1_NOETIC if is_ros1 else stores.Stores.ROS2_HUMBLE
        types = stores.get_typestore(store)
        self._decode = types.deserialize_ros1 if is_ros1 else types.deserialize_cdr

        self._path.stat()  # the system reports a missing file
        self._reader: Any = None
        with named(os.fspath(path)):
            reader = reader_of(self._path)
            reader.open()
            self._reader = reader

    @property
    def topics(self) -> dict[str, tuple[str, int]]:
        """The type and the number of messages in each topic."""
        return {one.topic: (one.msgtype, one.msgcount) for one in self._reader.connections}

    def items(self, topics: Sequence[str]) -> Iterator[Item]:
        """Yield the messages of some topics in the order of recording.

        Raises
        ------
        ValueError
            If the file is damaged.
        """
        wanted = [one for one in self._reader.connections if one.topic in topics]
        if not wanted:
            return  # the library would yield all
        with named(os.fspath(self._path)):
            for connection, time, data in self._reader.messages(connections=wanted):
                yield Item(connection.topic, time, self._later(data, connection.msgtype))

    def _later(self, data: bytes, kind: str) -> Callable[[], Any]:
        def read() -> Any:
            with named("message"):
                try:
                    return self._decode(data, kind)
                except Exception:
                    # librealsense before 2.56 leaves four bytes after the images of its .bag.
                    if bytes(data[-4:]) != _SURPLUS:
                        raise
                    return self._decode(data[:-4], kind)

        return read

    def close(self) -> None:
        """Close the files; a second call does nothing."""
        reader, self._reader = self._reader, None
        if reader is not None:
            reader.close()


class RecordingWriter(Closing):
    """Writes messages to a recording.

    The recording takes its place when you close it, also when an error ends the ``with`` block.
    Without a single message it writes nothing, and an earlier file stays.

    Parameters
    ----------
    path
        ``.mcap``: one file of ROS 2; ``.db3``: a folder of rosbag2, which must not exist yet;
        ``.bag``: one file of ROS 1.

    Raises
    ------
    OSError
        If its folder does not exist or is not writable, or the path is not a file.
    ValueError
        If the suffix is unknown.
    ImportError
        If rosbags is not installed.
    """

    def __init__(self, path: StrPath) -> None:
        if suffix(path) not in SUFFIXES:
            names = ", ".join(SUFFIXES)
            raise ValueError(f"path of a recording must end in {names}, got {os.fspath(path)!r}")

        self._kind = suffix(path)
        self._target = target_of(path)
        if self._kind == ".db3" and self._target.exists():
            raise FileExistsError(17, "exists already: a recording is a folder", str(path))

        stores = require("rosbags.typesys", extra="ros")
        self.is_ros1 = self._kind == ".bag"
        name = stores.Stores.ROS1_NOETIC if self.is_ros1 else stores.Stores.ROS2_HUMBLE
        self._types = stores.get_typestore(name)

        self._home = growing(self._target)
        self._home.mkdir()  # only a trial shows every possible error
        self._home.rmdir()

        self._writer: Any = None
        self._connections: dict[str, Any] = {}

    def make(self, kind: str, **fields: Any) -> Any:
        """Make a message of a type such as ``"sensor_msgs/msg/Image"``, with the names of ROS 2.

        Parameters
        ----------
        kind
            Its type.
        **fields
            Its fields.
        """
        if self.is_ros1 and kind == "std_msgs/msg/Header":
            fields["seq"] = 0
        if self.is_ros1 and kind == "stereo_msgs/msg/DisparityImage":
            fields["T"] = fields.pop("t")
        if self.is_ros1 and kind == "sensor_msgs/msg/CameraInfo":
            fields |= {name.upper(): fields.pop(name) for name in "dkrp"}

        return self._types.types[kind](**fields)

    def write(self, topic: str, stamp: int, message: Any) -> None:
        """Append a message.

        Parameters
        ----------
        topic
            Its topic.
        stamp
            Recording time, ns since 1970.
        message
            A message from `make`.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        kind = message.__msgtype__
        if self._writer is None:
            self._open()

        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic, kind, typestore=self._types
            )

        encode = self._types.serialize_ros1 if self.is_ros1 else self._types.serialize_cdr
        self._writer.write(self._connections[topic], stamp, encode(message, kind))

    def close(self) -> None:
        """Complete the recording and put it in its place."""
        writer, self._writer = self._writer, None
        if writer is None:
            return

        try:
            writer.close()
            # A rosbag2 in SQLite is the whole folder that rosbags makes; the others are one file in
            # it.
            is_folder = self._kind == ".db3"
            made = self._home / self._target.stem
            inner = made if is_folder else next(self._home.rglob(f"*{self._kind}"))
            inner.replace(self._target)
        finally:
            shutil.rmtree(self._home, ignore_errors=True)

    def _open(self) -> None:
        self._home.mkdir()
        made = self._home / self._target.stem
        if self.is_ros1:
            module = require("rosbags.rosbag1", extra="ros")
            writer = module.Writer(made.with_name(f"{made.name}.bag"))
        else:
            module = require("rosbags.rosbag2", extra="ros")
            plugins = {".mcap": module.StoragePlugin.MCAP, ".db3": module.StoragePlugin.SQLITE3}
            writer = module.Writer(made, version=8, storage_plugin=plugins[self._kind])
        writer.open()
        self._writer = writer

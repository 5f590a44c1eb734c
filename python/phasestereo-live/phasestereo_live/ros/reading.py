"""Read recordings with the library rosbags, within bounds.

The library trusts the lengths in a file, so this module gives it files with bounds: they check the
beginning first, and read no piece longer than the file or than the limit of a record. Packed data
has bounds, too:

- A chunk unpacks to the size in its record, a message of a packed recording to the size in its
  frame: at most `RECORD`, checked before unpacking.
- Chunks that overlap in time unpack to four times `RECORD`; the library holds them together.
- A packed file, which the library unpacks to disk, grows to 100 times its size at most, or
  `RECORD`.
"""

from __future__ import annotations

import bz2
import io
import os
from itertools import accumulate
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

from phasestereo._extras import require
from phasestereo.io.files import check_head, open_regular, read_bounded, suffix
from phasestereo.io.limits import RECORD

_HEADS = {".mcap": b"\x89MCAP0\r\n", ".db3": b"SQLite format 3\0", ".bag": b"#ROSBAG V2.0\n"}
SUFFIXES = tuple(_HEADS)

_METADATA = 2**19  # bytes of a metadata.yaml at most; it has a few hundred for each topic
_TOGETHER = 4 * RECORD
_TIMES = 100  # recordings become a few times shorter; zstd shrinks zeros to a 30 000th


def reader_of(path: Path) -> Any:
    """Return the reader of a recording, not yet open: a ``Reader`` of rosbags.

    Raises
    ------
    OSError
        If a file cannot be read.
    ValueError
        If one does not begin as its suffix requires; SQLite would open it by its name.
    ImportError
        If rosbags is not installed.
    """
    for file in sorted(path.iterdir()) if path.is_dir() else [path]:
        if head := _HEADS.get(suffix(file)):
            check_head(file, head)

    return (_ros1 if suffix(path) == ".bag" else _ros2)()(_Place(path))


class _Records(io.BufferedReader):
    """A file that reads no piece longer than the limit of a record, or than the file."""

    def read(self, size: int | None = -1, /) -> bytes:
        """Read up to a number of bytes; fewer at the end of a file."""
        rest = max(0, os.fstat(self.fileno()).st_size - self.tell())
        wanted = rest if size is None or size < 0 else min(size, rest)
        if wanted > RECORD:
            raise ValueError(f"asks for {wanted} bytes at once; records have {RECORD} at most")
        return super().read(wanted)


class _Place(type(Path())):  # type: ignore[misc]  # the system's kind of path
    """A path; the library opens its files, and those that a folder names, within bounds."""

    def open(self, *_: Any, **__: Any) -> _Records:
        """Open a regular file to read its bytes."""
        return _Records(open_regular(self).detach())  # type: ignore[attr-defined]  # is buffered

    def read_text(self, *_: Any, **__: Any) -> str:
        """Return the text of ``metadata.yaml``."""
        with open_regular(self) as file:
            return read_bounded(file, _METADATA).decode()


def _unpack(unpacker: Any, packed: bytes, claimed: int) -> bytes:
    """Unpack data of a claimed size."""
    if not 0 <= claimed <= RECORD:
        raise ValueError(f"claims to unpack to {claimed} bytes; records have {RECORD} at most")
    found: bytes = unpacker.decompress(packed, max_length=claimed + 1)
    if len(found) != claimed:
        raise ValueError(f"claims to unpack to {claimed} bytes, and has others")
    return found


def _ros1() -> Any:
    """Return the class that reads recordings of ROS 1."""
    module = require("rosbags.rosbag1.reader", extra="ros")
    unpackers = {
        "bz2": bz2.BZ2Decompressor,
        "lz4": require("lz4.frame", extra="ros").LZ4FrameDecompressor,
    }

    # This imports the library of these classes only when needed: its types are unknown.
    class Ros1(module.Reader):  # type: ignore[misc, name-defined]
        def read_chunk(self) -> Any:
            """Return a chunk's position, and its unpacker to the size that its head claims."""
            start = self.bio.tell()
            head = module.Header.read(self.bio, module.RecordType.CHUNK)
            self.bio.seek(start)
            chunk = super().read_chunk()
            unpacker, claimed = head.get_string("compression"), head.get_uint32("size")
            if unpacker not in unpackers:
                return chunk
            return chunk._replace(
                decompressor=lambda packed: _unpack(unpackers[unpacker](), packed, claimed)
            )

    return Ros1


def _ros2() -> Any:
    """Return the class that reads recordings of ROS 2."""
    module = require("rosbags.rosbag2.reader", extra="ros")
    mcap = require("rosbags.rosbag2.storage_mcap", extra="ros")
    lz4, zstd = require("lz4.frame", extra="ros"), mcap.zstd

    def of_message(packed: bytes) -> bytes:
        claimed = zstd.get_frame_info(packed).decompressed_size
        if claimed is None:  # ROS states it, and asks for it
            raise ValueError("a message does not say to how much it unpacks")
        return _unpack(zstd.ZstdDecompressor(), packed, claimed)

    class OfFile(zstd.ZstdFile):  # type: ignore[misc, name-defined]
        def __init__(self, file: _Records, mode: str) -> None:
            super().__init__(file, mode)
            self.left = max(RECORD, _TIMES * os.fstat(file.fileno()).st_size)

        def read(self, size: int | None = -1) -> bytes:
            found: bytes = super().read(size)
            self.left -= len(found)
            if self.left < 0:
                raise ValueError(f"unpacks to more than {_TIMES} times its size")
            return found

    class Mcap(mcap.McapReader):  # type: ignore[misc, name-defined]
        def read_index(self) -> None:
            """Also read the available chunks."""
            super().read_index()
            ends = [(one.message_start_time, one.uncompressed_size) for one in self.chunks]
            ends += [(one.message_end_time + 1, -one.uncompressed_size) for one in self.chunks]
            if max(accumulate(size for _, size in sorted(ends)), default=0) > _TOGETHER:
                raise ValueError(f"chunks of one time unpack to more than {_TOGETHER} bytes")

    class Folder(module.DirectoryReader):  # type: ignore[misc, name-defined]
        # Paths of packed files lead to the files that the library unpacked.
        STORAGE_PLUGINS: ClassVar = {
            "mcap": lambda path: Mcap(_Place(path)),
            "sqlite3": module.Sqlite3Reader,
        }

    class Ros2(module.Reader):  # type: ignore[misc, name-defined]
        STORAGE_PLUGINS: ClassVar = {"dir": Folder, ".mcap": Mcap, ".db3": module.Sqlite3Reader}

    # The library finds unpackers only by names in its modules: replace them for the whole process.
    module.zstd = SimpleNamespace(decompress=of_message, open=OfFile)
    mcap.DECOMPRESSORS |= {
        "lz4": lambda packed, size: _unpack(lz4.LZ4FrameDecompressor(), packed, size),
        "zstd": lambda packed, size: _unpack(zstd.ZstdDecompressor(), packed, size),
    }
    return Ros2

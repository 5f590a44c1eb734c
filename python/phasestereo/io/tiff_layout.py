"""Read and bound the declared contents of a TIFF file before a decoder sees it.

Decoders follow the chain of directories anywhere, and allocate any size in a directory. This module
follows the chain once, reads no directory twice and no tag beyond the end of the file, and counts
the blocks (strips or tiles): then the size of a picture in memory is known.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from phasestereo.io.limits import UNPACKING, check_size, check_unpacked, max_pixels

TIFF_MAGICS = b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"
"""How a TIFF or BigTIFF file starts."""

MAX_DIRECTORIES = 256
"""Directories of a file at most: a picture, its mask, and overviews of them."""

_MOST_BLOCKS = 2**24
_FREE_BLOCK = 2**22  # pixels that a block may have even in a small picture
# Bytes of a value, by the number of its type; neither this module nor a decoder needs others.
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4,
          16: 8, 17: 8, 18: 8}  # fmt: skip
_WHOLE = {1: "u1", 3: "u2", 4: "u4", 13: "u4", 16: "u8", 18: "u8"}
_WIDTH, _HEIGHT, _BITS, _COMPRESSION, _SAMPLES, _PLANAR = 256, 257, 258, 259, 277, 284
_STRIPS, _STRIP_ROWS, _STRIP_BYTES = 273, 278, 279
_TILE_WIDTH, _TILE_HEIGHT, _TILES, _TILE_BYTES = 322, 323, 324, 325
_NONE, _LZW, _DEFLATE, _OLD_DEFLATE, _PACKBITS = 1, 5, 8, 32946, 32773

DEFLATED = _DEFLATE, _OLD_DEFLATE
BOUNDED = _NONE, _LZW, *DEFLATED, _PACKBITS
"""The compressions whose output is bounded when tifffile reads them, as `read_image` has it do."""

# What a byte of these unpacks to at most.
_RATIOS = {_NONE: 1, _LZW: 1400, _PACKBITS: 64} | dict.fromkeys(DEFLATED, UNPACKING)


@dataclass(frozen=True, slots=True)
class Directory:
    """One directory of a TIFF file.

    Parameters
    ----------
    tags
        The type, the number of values and the bytes of each tag, by its number; of those with many
        values where they begin in the file instead.
    order
        Byte order: "<" or ">".
    length
        Bytes of the file.
    """

    tags: Mapping[int, tuple[int, int, bytes | int]]
    order: str
    length: int

    def number(self, tag: int, default: int | None = None) -> int:
        """Return the first value of a tag."""
        kind, count, content = self.tags.get(tag, (4, 0, b""))
        if not count:
            if default is None:
                raise ValueError(f"the TIFF has no tag {tag}")
            return default

        if kind not in _WHOLE or isinstance(content, int):
            raise ValueError(f"the TIFF's tag {tag} is not a whole number")
        return int(np.frombuffer(content, self.order + _WHOLE[kind], 1)[0])

    @property
    def has_pixels(self) -> bool:
        """Whether it belongs to a picture, not only to tags."""
        return _WIDTH in self.tags

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.number(_WIDTH), self.number(_HEIGHT)

    @property
    def sample(self) -> int:
        """Bits of a pixel, all its samples."""
        return max(1, self.number(_BITS, 1)) * max(1, self.number(_SAMPLES, 1))

    @property
    def compression(self) -> int:
        """How blocks are compressed, by its number in TIFF."""
        return self.number(_COMPRESSION, _NONE)

    @property
    def block(self) -> tuple[int, int]:
        """Width and height of a block."""
        width, height = self.size
        if _TILES in self.tags or _TILE_WIDTH in self.tags:
            sides = self.number(_TILE_WIDTH), self.number(_TILE_HEIGHT)
        else:
            sides = width, min(height, self.number(_STRIP_ROWS, height))

        if min(sides) < 1:
            raise ValueError(f"the TIFF has blocks of {sides[0]} x {sides[1]} pixels")
        return sides

    @property
    def block_bytes(self) -> int:
        """Bytes of an unpacked block; of one plane of samples where they are stored by planes."""
        return self.block[0] * self.block[1] * self._stored_sample // 8

    @property
    def _stored_sample(self) -> int:
        separate = self.number(_PLANAR, 1) == 2
        return max(1, self.number(_BITS, 1)) if separate else self.sample

    def check_blocks(self) -> None:
        """Refuse blocks whose number is not the picture's, or that are much larger than it."""
        (width, height), (across, down) = self.size, self.block
        if min(width, height) < 1:
            raise ValueError(f"the header says {width} x {height} pixels: that is not an image")

        # Samples may be stored by planes, each with blocks of its own.
        planes = max(1, self.number(_SAMPLES, 1)) if self.number(_PLANAR, 1) == 2 else 1
        wanted = -(-width // across) * -(-height // down) * planes
        found = self.tags.get(_TILES, self.tags.get(_STRIPS, (4, 0, b"")))[1]
        if found != wanted or wanted > _MOST_BLOCKS:
            raise ValueError(
                f"some strips or tiles of the TIFF page are missing: it has {found} of the "
                f"{wanted} that {width} x {height} pixels take (at most {_MOST_BLOCKS} are read)"
            )

        if across * down > max(_FREE_BLOCK, 4 * width * height):
            raise ValueError(
                f"the TIFF has blocks of {across} x {down} pixels for {width} x {height}: more "
                "than the picture needs"
            )

    def places(self, file: BinaryIO) -> NDArray[np.uint64]:
        """Return the offsets of the blocks in the file; 0: left out."""
        return self._many(file, _TILES if _TILES in self.tags else _STRIPS)

    def stored(self, file: BinaryIO) -> NDArray[np.uint64]:
        """Return the sizes of the blocks in the file, in bytes."""
        places = self.places(file)
        name = _TILE_BYTES if _TILE_BYTES in self.tags else _STRIP_BYTES
        rest = np.uint64(self.length) - np.minimum(places, np.uint64(self.length))

        if name not in self.tags:
            return rest

        counts = self._many(file, name)
        if len(counts) != len(places):
            raise ValueError("some strips or tiles of the TIFF page are missing")
        return np.asarray(np.where(places > 0, np.minimum(counts, rest), 0), np.uint64)

    def _many(self, file: BinaryIO, tag: int) -> NDArray[np.uint64]:
        kind, count, content = self.tags.get(tag, (4, 0, b""))
        if kind not in _WHOLE:
            raise ValueError(f"the TIFF's tag {tag} holds no whole numbers")

        if isinstance(content, int):
            file.seek(content)
            content = file.read(count * _SIZES[kind])

        return np.frombuffer(content, self.order + _WHOLE[kind], count).astype(np.uint64)


def read_layout(file: BinaryIO) -> list[Directory]:
    """Return the directories of a TIFF file; refuse a chain in a circle or out of the file.

    Raises
    ------
    ValueError
        If the chain is such, or it is empty or longer than `MAX_DIRECTORIES`.
    """
    length = file.seek(0, os.SEEK_END)
    file.seek(0)
    head = file.read(16).ljust(16, b"\0")

    # BigTIFF has the offset of the first directory in 8 bytes, after the size of offsets.
    order, big = ("<" if head[:2] == b"II" else ">"), b"+" in head[2:4]
    (offset,) = struct.unpack_from(order + ("Q" if big else "I"), head, 8 if big else 4)

    found: list[Directory] = []
    seen: set[int] = set()
    while offset:
        if offset in seen:
            raise ValueError("the directories of the TIFF lead in a circle")
        if len(found) == MAX_DIRECTORIES:
            raise ValueError(f"the TIFF has more than {MAX_DIRECTORIES} directories")
        seen.add(offset)
        tags, offset = _read_directory(file, offset, order, length, big=big)
        found.append(Directory(tags, order, length))

    if not found:
        raise ValueError("the TIFF has no directory")
    return found


def _read_directory(
    file: BinaryIO, offset: int, order: str, length: int, *, big: bool
) -> tuple[dict[int, tuple[int, int, bytes | int]], int]:
    """Return the tags of a directory, and the position of the next one."""
    # An entry has a tag, a type, a count and, in `inside` bytes, its value or where that is.
    word, step, inside = ("Q", 20, 8) if big else ("I", 12, 4)
    (count,) = struct.unpack(
        order + ("Q" if big else "H"), _bytes(file, offset, 8 if big else 2, length)
    )

    if count > 2**16:
        raise ValueError(f"a directory of the TIFF has {count} tags; at most {2**16} are read")

    start = offset + (8 if big else 2)
    body = _bytes(file, start, count * step + inside, length)

    tags: dict[int, tuple[int, int, bytes | int]] = {}
    for place in range(0, count * step, step):
        tag, kind, values = struct.unpack_from(order + "HH" + word, body, place)
        size = values * _SIZES.get(kind, 0)
        content: bytes | int = body[place + step - inside : place + step]
        if size > inside:
            (where,) = struct.unpack(order + word, content)  # type: ignore[arg-type]
            if where + size > length:
                raise ValueError(f"the TIFF's tag {tag} reaches beyond the end of the file")
            # Long values, such as the positions of all blocks, are read only when needed.
            content = where if size > 2**12 else _bytes(file, where, size, length)
        tags.setdefault(tag, (kind, values if size else 0, content))

    (following,) = struct.unpack(order + word, body[-inside:])
    return tags, following


def _bytes(file: BinaryIO, offset: int, count: int, length: int) -> bytes:
    if offset + count > length:
        raise ValueError("the TIFF's directories reach beyond the end of the file")
    file.seek(offset)
    return file.read(count)


def check_whole(file: BinaryIO, directory: Directory) -> None:
    """Refuse a picture too large to read as a whole, or too large for its bytes."""
    check_size(*directory.size)
    directory.check_blocks()

    pixels = directory.size[0] * directory.size[1]
    if directory.block_bytes > max(_FREE_BLOCK, 16 * max_pixels()):
        raise ValueError(f"a block of the TIFF unpacks to {directory.block_bytes} bytes")

    stored = directory.stored(file)
    ratio = _RATIOS.get(directory.compression)
    if ratio is not None:
        share = float((stored > 0).mean())  # blocks may be left out: "no data", to GDAL
        check_unpacked(int(pixels * share * directory.sample) // 8, int(stored.sum()), ratio)

    if not stored.all() and directory.block_bytes > 16 * _FREE_BLOCK:
        raise ValueError(
            f"blocks of {directory.block_bytes} bytes are left out of the TIFF: it holds none of "
            "what it claims"
        )

"""Open arrays in untrusted Zarr folders: check files before Zarr reads them.

This module reads metadata up to a bound; they name the codec that unpacks the chunks. Chunks must
be in regular files, alone or in shards, and must not declare more bytes than their pixels take.
"""

from __future__ import annotations

import json
import math
import stat
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from phasestereo._extras import require
from phasestereo.io.files import open_regular, read_bounded, refuse_special
from phasestereo.io.limits import SMALL

_METADATA = "zarr.json", ".zarray", ".zattrs", ".zgroup", ".zmetadata"
_SAME_SIZE = {
    "bytes", "endian", "transpose", "crc32c", "shuffle", "delta", "fixedscaleoffset", "astype",
    "bitround", "quantize", "sharding_indexed",
}  # fmt: skip
"""Steps whose output is as long as their input, or a few times as long."""

_TIMES, _MORE = 8, 4096
"""A chunk may unpack to this many times the bytes of its pixels, plus this many."""


def open_array(path: str, max_bytes: int) -> Any:
    """Open the array of a folder, to read it.

    Raises
    ------
    OSError
        If metadata is not in a regular file.
    ValueError
        Or any error of Zarr, if it does not hold an array; if the packing of its chunks has no
        bound.
    ImportError
        If Zarr is not installed.
    """
    zarr = require("zarr", extra="large")
    packer = _packer(Path(path))

    # This imports Zarr, the library of this class, only when needed: its types are unknown.
    class Bounded(zarr.storage.LocalStore):  # type: ignore[misc, name-defined]
        async def get(self, key: str, prototype: Any = None, byte_range: Any = None) -> Any:
            most = SMALL if key.rpartition("/")[2] in _METADATA else max_bytes
            _check_file(self.root / key, most)
            return await super().get(key, prototype, byte_range)

    array = zarr.open_array(Bounded(path, read_only=True), mode="r")
    if packer is not None:
        # The oldest supported version of Zarr does not have the public name of this.
        for codec in array._async_array.codec_pipeline:
            _bound(codec, packer, _TIMES * array.dtype.itemsize)
    return array


def _bound(codec: Any, packer: str, times: int) -> None:
    """Have codecs first check the bytes per pixel of each chunk, also within shards."""
    for inner in getattr(codec, "codecs", ()):
        _bound(inner, packer, times)

    # Zarr's second version has a single step that does all of them.
    if not hasattr(codec, "compressor") and not codec.to_dict()["name"].endswith(packer):
        return
    decode = codec.decode

    async def looked_at(chunks_and_specs: Iterable[tuple[Any, Any]]) -> Any:
        chunks = [*chunks_and_specs]
        for chunk, spec in chunks:
            if chunk is not None:  # None has only fill values
                most = times * math.prod(spec.shape) + _MORE
                _check_claim(chunk.as_buffer_like(), packer, most)
        return await decode(chunks)

    object.__setattr__(codec, "decode", looked_at)  # for this array alone: a frozen dataclass


def _packer(folder: Path) -> str | None:
    """Return the name of the codec for whole chunks, if the metadata give it."""
    for name in ("zarr.json", ".zarray"):
        if (folder / name).exists():
            with open_regular(folder / name) as file:
                steps = [*_steps(json.loads(read_bounded(file, SMALL)))]
            break
    else:
        return None  # Zarr reports this in its own words

    packers = [step for step in steps if step not in _SAME_SIZE]
    if len(packers) > 1 or not {*packers} <= {*_CLAIMS}:
        raise ValueError(f"packed by {', '.join(packers)}; accepts one of {', '.join(_CLAIMS)}")
    return packers[0] if packers else None


def _steps(metadata: Any) -> Iterator[str]:
    """Yield the names of the steps for chunks, in the second or the third version of Zarr."""
    told = [metadata.get("compressor"), *(metadata.get("filters") or ())]
    for step in [*told, *(metadata.get("codecs") or ())]:
        if step is not None:
            yield str(step.get("id", step.get("name"))).removeprefix("numcodecs.")
            yield from _steps(step.get("configuration") or {})


def _check_file(path: Path, most: int) -> None:
    """Refuse a long file or one that is not regular; a missing chunk holds fill values."""
    try:
        status = path.stat()
    except OSError:
        return
    refuse_special(path, status.st_mode)
    if stat.S_ISDIR(status.st_mode):  # Zarr treats a folder as a chunk of fill values
        raise ValueError(f"{path}: a folder where a file should be")
    if status.st_size > most:
        raise ValueError(f"{path}: has {status.st_size} bytes; at most {most} are read")


def _check_claim(chunk: Any, packer: str, most: int) -> None:
    """Refuse a chunk that unpacks to more than its pixels need, or does not declare its size."""
    try:
        needed = _CLAIMS[packer](bytes(chunk), most)
    except (struct.error, IndexError, zlib.error):
        raise ValueError(f"a chunk is not packed by {packer}") from None
    if needed > most:
        raise ValueError(f"a chunk unpacks to {needed} bytes or more; at most {most} are read")


def _of_zstd(chunk: bytes, most: int) -> int:
    """Return the size that a frame states; a frame without a size counts as too large."""
    head = chunk[4]
    size = (1 if head & 32 else 0, 2, 4, 8)[head >> 6]
    if not size:
        return most + 1
    start = 5 + (0 if head & 32 else 1) + (0, 1, 2, 4)[head & 3]
    says = int.from_bytes(chunk[start : start + size], "little")
    return says + 256 if size == 2 else says


def _of_deflate(chunk: bytes, most: int) -> int:
    """Return the unpacked bytes of one member, as Zarr writes it, up to the bound."""
    unpacker = zlib.decompressobj(wbits=47)  # with any header
    unpacked = len(unpacker.decompress(chunk, most + 1))
    return most + 1 if unpacker.unused_data else unpacked


_CLAIMS: dict[str, Callable[[bytes, int], int]] = {
    "zstd": _of_zstd,
    "blosc": lambda chunk, _: struct.unpack_from("<I", chunk, 4)[0],
    "lz4": lambda chunk, _: struct.unpack_from("<I", chunk)[0],
    "gzip": _of_deflate,
    "zlib": _of_deflate,
}
"""Functions that return the unpacked bytes of a chunk, as its header states them."""

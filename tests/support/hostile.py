"""Small files that claim much, and what reads each of them is to refuse.

Run as a program, it reads the hostile files of a folder with every reader that takes them, and
prints a line of JSON for each: what was raised, seconds of the processor, and by how much resident
memory grew.
"""

from __future__ import annotations

import io
import json
import struct
import sys
import time
import zipfile
import zlib
from contextlib import suppress
from copy import copy
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from support import sampled

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    Entry = tuple[int, int, int | tuple[int, ...] | bytes]

SHORT, LONG = 3, 4  # types of a TIFF's tags
WIDTH, HEIGHT, BITS, COMPRESSION, PHOTOMETRIC, SAMPLES = 256, 257, 258, 259, 262, 277
STRIPS, STRIP_ROWS, STRIP_BYTES, TILE_WIDTH, TILE_HEIGHT, TILES, TILE_BYTES = (
    273, 278, 279, 322, 323, 324, 325,
)  # fmt: skip
DEFLATE, PACKBITS = 8, 32773


def tiff(tags: dict[int, int | tuple[int, ...]], data: bytes = b"", following: int = 0) -> bytes:
    """Return a TIFF file: a header, data from byte 8 on, and one directory with these tags."""
    start = 8 + len(data) + len(data) % 2
    extra = start + 2 + 12 * len(tags) + 4

    body, beyond = struct.pack("<H", len(tags)), b""
    for tag, value in sorted(tags.items()):
        # Values of more than four bytes lie behind the directory, which then holds their place.
        values = (value,) if isinstance(value, int) else value
        packed = struct.pack(f"<{len(values)}I", *values)
        if len(packed) > 4:
            where, beyond = extra + len(beyond), beyond + packed
            packed = struct.pack("<I", where)
        body += struct.pack("<HHI", tag, LONG, len(values)) + packed

    head = struct.pack("<2sHI", b"II", 42, start)
    return head + data.ljust(start - 8, b"\0") + body + struct.pack("<I", following) + beyond


def page(width: int, height: int, **others: int) -> dict[int, int | tuple[int, ...]]:
    """Return the tags of a page of one strip that begins at byte 8."""
    tags: dict[int, int | tuple[int, ...]] = {
        WIDTH: width, HEIGHT: height, BITS: 8, COMPRESSION: 1, PHOTOMETRIC: 1, SAMPLES: 1,
        STRIPS: 8, STRIP_ROWS: height, STRIP_BYTES: width * height,
    }  # fmt: skip
    names = {"bits": BITS, "compression": COMPRESSION, "rows": STRIP_ROWS, "stored": STRIP_BYTES}
    return tags | {names[name]: value for name, value in others.items()}


def zeros(size: int) -> bytes:
    """Return zeros as zlib packs them, made quickly: some pieces that are all the same."""
    packer = zlib.compressobj(9)
    head = packer.compress(b"") + packer.flush(zlib.Z_FULL_FLUSH)
    piece = packer.compress(bytes(2**24)) + packer.flush(zlib.Z_FULL_FLUSH)
    return head + piece * (size // 2**24) + packer.flush()


def zstd_zeros(size: int, *, said: bool = True) -> bytes:
    """Return zeros as zstd packs them, four bytes for 128 KiB; it may say how many."""
    says = b"\xc0\x58" + struct.pack("<Q", size) if said else b"\0\x58"
    block = (2**17 << 3 | 1 << 1).to_bytes(3, "little") + b"\0"
    last = (block[0] | 1).to_bytes(1, "little") + block[1:]
    return b"\x28\xb5\x2f\xfd" + says + block * (size // 2**17 - 1) + last


def mcap(packer: str, packed: bytes, claimed: int) -> bytes:
    """Return a recording of one chunk."""

    def record(code: int, content: bytes) -> bytes:
        return struct.pack("<BQ", code, len(content)) + content

    def text(of: bytes) -> bytes:
        return struct.pack("<I", len(of)) + of

    head = struct.pack("<QQQI", 0, 0, claimed, 0) + text(packer.encode())
    chunk = record(6, head + struct.pack("<Q", len(packed)) + packed)
    end = record(2, struct.pack("<QQI", 0, 0, 0))
    return b"\x89MCAP0\r\n" + record(1, text(b"ros2") + text(b"")) + chunk + end + b"\x89MCAP0\r\n"


SHARDED = {
    "zarr_format": 3, "node_type": "array", "shape": [64, 64], "data_type": "uint8",
    "fill_value": 0, "attributes": {},
    "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [64, 64]}},
    "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
    "codecs": [{"name": "sharding_indexed", "configuration": {
        "chunk_shape": [64, 64], "index_location": "end",
        "codecs": [{"name": "bytes"}, {"name": "zstd", "configuration": {"level": 0}}],
        "index_codecs": [{"name": "bytes", "configuration": {"endian": "little"}}],
    }}],
}  # fmt: skip
"""The metadata of a Zarr array of one shard of one chunk."""


def shard(chunk: bytes) -> bytes:
    return chunk + struct.pack("<QQ", 0, len(chunk))


def looping() -> bytes:
    whole = tiff(page(4, 4), bytes(16))
    start = struct.unpack_from("<I", whole, 4)[0]
    return tiff(page(4, 4), bytes(16), following=start)


def long_chain() -> bytes:
    """Return a TIFF of ten thousand directories, none of which is seen twice."""
    content = bytearray(tiff(page(4, 4), bytes(16)))
    for _ in range(10_000):
        content += struct.pack("<HHHII", 1, WIDTH, LONG, 1, 4) + struct.pack("<I", 0)

    first = struct.unpack_from("<I", content, 4)[0]
    # Every directory points to the next: 18 bytes each, the pointer being the last four.
    start, place = len(tiff(page(4, 4), bytes(16))), first + 2 + 12 * 9
    for number in range(10_000):
        struct.pack_into("<I", content, place, start + 18 * number)
        place = start + 18 * number + 14

    return bytes(content)


def tiff_bomb() -> bytes:
    packed = zeros(2**31)
    return tiff(page(10, 10, compression=DEFLATE, stored=len(packed)), packed)


def large_tile() -> bytes:
    packed = zeros(2**28)
    tags = page(10, 10, compression=DEFLATE)
    for tag in (STRIPS, STRIP_ROWS, STRIP_BYTES):
        del tags[tag]
    sides = {TILE_WIDTH: 2**16, TILE_HEIGHT: 2**15}
    return tiff(tags | sides | {TILES: 8, TILE_BYTES: len(packed)}, packed)


def png(width: int, height: int, kind: int, data: bytes = b"") -> bytes:
    def chunk(name: bytes, content: bytes) -> bytes:
        checksum = struct.pack(">I", zlib.crc32(name + content))
        return struct.pack(">I", len(content)) + name + content + checksum

    header = struct.pack(">IIBBBBB", width, height, 8, kind, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")
    )


def npz(name: str, size: int, copies: int = 1) -> bytes:
    """Return a packed .npz file of arrays of this many zeros, which share what is stored."""
    packed, header = io.BytesIO(), io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "|u1", "fortran_order": False, "shape": (size,)}
    )

    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
            file.write(header.getvalue())
            for _ in range(size // 2**24):
                file.write(bytes(2**24))

        # Further entries point to the same packed bytes.
        (entry,) = archive.infolist()
        for number in range(1, copies):
            archive.filelist.append(copy(entry))
            archive.filelist[-1].filename = f"{name}{number}.npy"

    return packed.getvalue()


def many(count: int) -> bytes:
    """Return a .npz file of this many arrays."""
    packed = io.BytesIO()
    arrays: dict[str, Any] = {f"a{number}": np.zeros(1) for number in range(count)}
    np.savez(packed, **arrays)
    return packed.getvalue()


def npy(header: bytes, version: bytes = b"\x01\x00") -> bytes:
    return b"\x93NUMPY" + version + struct.pack("<H", len(header)) + header


def billion_laughs() -> bytes:
    """Return YAML of a few lines, each of which names the one before it ten times."""
    lines = ["a0: &a0 [1, 1]"]
    lines += [f"a{n}: &a{n} [" + ", ".join([f"*a{n - 1}"] * 10) + "]" for n in range(1, 12)]
    return "\n".join([*lines, "K1: *a11"]).encode()


def entities() -> bytes:
    """Return XML that does the same."""
    lines = [f'<!ENTITY a{n} "{f"&a{n - 1};" * 10}">' for n in range(1, 12)]
    head = '<?xml version="1.0"?>\n<!DOCTYPE x [\n<!ENTITY a0 "1 ">\n'
    body = '\n]>\n<opencv_storage><K1 type_id="opencv-matrix"><rows>3</rows><cols>3</cols>'
    tail = "<dt>d</dt><data>&a11;</data></K1></opencv_storage>"
    return (head + "\n".join(lines) + body + tail).encode()


IMAGES = "read_image", "read_geotiff", "open_raster", "is_geotiff"
RIGS = ("read_rig",)

# Name -> content, and the readers that are to refuse it. Their names end as the readers want.
CONTENTS: dict[str, tuple[Callable[[], bytes], tuple[str, ...]]] = {
    "loop.tif": (looping, IMAGES),
    "wide.bin": (lambda: b"100000&100000&1&" + bytes(400), ("read_depth",)),
    "cut.bin": (lambda: b"10000&10000&3&" + bytes(400), ("read_depth",)),
    "chain.tif": (long_chain, IMAGES),
    "bomb.tif": (tiff_bomb, ("read_image",)),
    "tile.tif": (large_tile, ("read_image", "read_geotiff", "open_raster")),
    "strip.tif": (
        lambda: tiff(page(2**16, 2**17, compression=DEFLATE, stored=16), bytes(16)),
        ("read_image", "read_geotiff", "open_raster"),
    ),
    "sparse.tif": (
        lambda: tiff(page(2**14, 2**13) | {STRIPS: 0, STRIP_BYTES: 0}),
        ("read_image", "read_geotiff"),
    ),
    "strips.tif": (
        lambda: tiff(page(1, 2**27, rows=1, stored=1)),
        ("read_image", "read_geotiff", "open_raster"),
    ),
    "samples.tif": (
        lambda: tiff(page(2**12, 2**12) | {SAMPLES: 65535}, bytes(64)),
        ("read_image", "read_geotiff", "open_raster"),
    ),
    "tag.tif": (lambda: tiff(page(4, 4) | {270: (7,) * 3})[:-8], IMAGES),
    "rgba.png": (lambda: png(2**14, 2**14, 6, zeros(2**30)), ("read_image",)),
    "empty.png": (lambda: png(14000, 14000, 6), ("read_image",)),
    "empty.pgm": (lambda: b"P5\n14000 14000\n255\n", ("read_image",)),
    "large.pgm": (lambda: b"P5\n1000000000 1000000000\n255\n", ("read_image",)),
    "q.npz": (lambda: npz("Q", 2**28), RIGS),
    "statistics.npz": (lambda: npz("plain", 2**28), ("load_statistics",)),
    "rig.npz": (lambda: npz("K1", 2**30, copies=16), RIGS),
    "maps.npz": (lambda: many(300), RIGS),
    "aliases.yml": (billion_laughs, RIGS),
    "deep.yml": (lambda: b"K1: " + b"[" * 2**16, RIGS),
    "long.yml": (lambda: b"K1: [" + b"1, " * 2**20 + b"1]\n", RIGS),
    "numbers.yml": (lambda: b"a: [" + b"1.5, " * 26_000 + b"1]\n", RIGS),
    "entities.xml": (entities, RIGS),
    "restoration.json": (
        lambda: b"phasestereo back 1\n" + b'{"size":[9,9],"runs":[' + b"1," * 2**21 + b"1]}",
        ("load_restoration",),
    ),
    "line.csv": (lambda: b"left,right\n" + b"," * 2**20, ("read_pairs",)),
    "line.jsonl": (lambda: b" " * 2**20, ("read_manifest",)),
    "arrays.npz": (lambda: many(300), ("read_rig", "load_statistics")),
    "bomb.mcap": (lambda: mcap("zstd", zstd_zeros(2**31), 2**20), ("open_recording",)),
    "claim.mcap": (lambda: mcap("zstd", zstd_zeros(2**31), 2**31), ("open_recording",)),
    "unsaid.mcap": (
        lambda: mcap("zstd", zstd_zeros(2**31, said=False), 2**20),
        ("open_recording",),
    ),
    "bomb.zarr": (lambda: shard(zstd_zeros(2**31)), ("open_raster",)),
    "packed.tif": (
        lambda: tiff(page(2**11, 2**11, compression=PACKBITS, stored=2**21), bytes(2**21)),
        ("read_image",),
    ),
    "header.npy": (
        lambda: b"\x93NUMPY\x02\x00" + struct.pack("<I", 2**31) + b"{",
        ("read_image", "open_raster", "read_rig"),
    ),
    "row.npy": (
        lambda: npy(b"{'descr': '|u1', 'fortran_order': False, 'shape': (1, 1099511627776), }\n"),
        ("read_image", "open_raster", "read_rig"),
    ),
}


def make(folder: Path) -> None:
    """Write all of them."""
    for name, (content, _) in CONTENTS.items():
        path = folder / name
        if path.suffix == ".zarr":
            (path / "c" / "0").mkdir(parents=True)
            (path / "zarr.json").write_text(json.dumps(SHARDED), "utf-8")
            path = path / "c" / "0" / "0"
        path.write_bytes(content())


def cases(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield a reader and a file that it is to refuse."""
    for name, (_, readers) in CONTENTS.items():
        yield from ((reader, folder / name) for reader in readers)


def readers() -> dict[str, Callable[[Path], Any]]:
    """Return the readers of files, by the name of the function."""
    import phasestereo as ps  # noqa: PLC0415 -- the process that makes the files needs none of it
    from phasestereo.io.tiff import is_geotiff  # noqa: PLC0415
    from phasestereo.rectification.record import read_calibration  # noqa: PLC0415
    from phasestereo_large import batch, geotiff  # noqa: PLC0415
    from phasestereo_large.bands import load  # noqa: PLC0415
    from phasestereo_large.windows import open_raster  # noqa: PLC0415
    from phasestereo_live.ros import open_recording  # noqa: PLC0415

    def open_one(path: Path) -> None:
        with open_raster(path):
            pass

    return {
        "read_image": ps.io.read_image,
        "read_geotiff": geotiff.read_geotiff,
        "open_raster": open_one,
        "open_recording": open_recording,
        "is_geotiff": is_geotiff,
        "read_depth": ps.io.read_depth,
        "read_rig": read_calibration,
        "load_restoration": ps.Restoration.load,
        "load_statistics": load,
        "read_pairs": lambda path: batch.read_pairs(path, num_disparities=8),
        "read_manifest": batch.read_manifest,
    }


def resident(name: str) -> int:
    """Return the bytes of memory that this process has (VmRSS) or had at most (VmHWM)."""
    for line in Path("/proc/self/status").read_text("ascii").splitlines():
        if line.startswith(name):
            return 1024 * int(line.split()[1])
    raise LookupError(name)


def main(folder: Path) -> None:
    """Read each file, and say what came of it."""
    every = readers()

    warm = folder / "warm"  # what is imported with the first file is not the file's
    for name in every:
        with suppress(OSError, ValueError):
            every[name](warm)

    for reader, path in sampled([*cases(folder)], 4):
        Path("/proc/self/clear_refs").write_text("5", "ascii")  # the most is that from now on

        # Of the processor: other processes of a busy machine are not the file's either.
        before, started = resident("VmRSS"), time.process_time()
        try:
            every[reader](path)
            raised = "nothing"
        except Exception as error:  # noqa: BLE001 -- whatever it is, it is recorded
            raised = f"{type(error).__name__}: {error}"

        taken = {"seconds": time.process_time() - started, "bytes": resident("VmHWM") - before}
        outcome = {"reader": reader, "file": path.name, "raised": raised, **taken}
        print(json.dumps(outcome), flush=True)  # noqa: T201


if __name__ == "__main__":
    main(Path(sys.argv[1]))

"""Mutated files for every reader, and strange arrays for the matcher: only documented errors come.

    python -m support.fuzzing [--seconds 300] [--seed N] [--files N] [--output tests/found]

A process reads one mutated file after another; another one watches it. What raises anything but
what the reader documents, takes too long or ends the process is kept in the output folder, and is
read by the tests from then on. Prints what was read, a line for each reader.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import io
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.io import savemat

import phasestereo as ps
import phasestereo_large as large
from phasestereo.io import (
    read_calibration,
    read_depth,
    read_disparity,
    read_image,
    read_pair,
    read_pfm,
    write_depth,
    write_image,
)
from phasestereo.io.tiff import is_geotiff
from phasestereo.rectification.record import Rectification, read_calibration as read_rig
from phasestereo_large import geotiff
from phasestereo_large.bands import load
from phasestereo_large.batch import Record, read_manifest, read_pairs
from phasestereo_large.geotiff import read_geotiff, write_geotiff
from phasestereo_large.windows import open_raster

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

FOUND = Path(__file__).parents[1] / "found"
SECONDS = 2.0  # that a small file may take
_PATIENCE = 30.0  # seconds without a word after which the reading process hangs
_DOCUMENTED = (ValueError,)  # the files are there, and the system lets them be read
_OF_MATCH = TypeError, ValueError, MemoryError
_INTERESTING = (0, 1, 2, 127, 128, 255, 256, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63)

CALIB = """cam0=[100.5 0 20; 0 100.5 15; 0 0 1]
cam1=[100.5 0 22; 0 100.5 15; 0 0 1]
doffs=2
baseline=60
width=21
height=19
ndisp=8
"""


def read_windows(path: Path) -> None:
    """Read a raster as the out-of-core matcher does."""
    with open_raster(path, max_bytes=2**26) as raster:
        for first in range(0, min(raster.size[0], 2**12), 64):
            raster.read(first, min(first + 64, raster.size[0]), (0, min(raster.size[1], 2**12)))


def read_array(path: Path) -> None:
    """Read a Zarr array of which this file is a part."""
    array = path.with_suffix(".zarr")
    shutil.rmtree(array, ignore_errors=True)
    shutil.copytree(path.parent / "corpus" / "whole.array", array)
    name = "zarr.json" if path.suffix == ".meta" else "c/0/0"
    shutil.copy(path, array / name)
    read_windows(array)


def read_list(path: Path) -> None:
    """Read a list of pairs."""
    read_pairs(path, num_disparities=8)


def match_strange(path: Path) -> None:
    """Match arrays and settings that the content of a file stands for."""
    chance = random.Random(path.read_bytes())  # noqa: S311 -- no secret
    samples = np.random.default_rng(chance.randrange(2**32))
    sides = [chance.choice((0, 1, 2, 3, 5, 33, 40, 70, 90)) for _ in range(2)]
    shape = (*sides, *chance.choice(((), (), (), (1,), (2,), (3,), (4,))))

    def image() -> Any:
        kind = chance.choice((*_TYPES, *_TYPES, "int16", ">u2", "bool"))

        made = samples.normal(100, 50, shape).astype(kind)

        if made.dtype.kind == "f" and made.size and chance.random() < 0.7:
            value = chance.choice((np.nan, np.inf, -1e38, 1e300, 0))
            made.flat[chance.randrange(made.size)] = value

        step = chance.choice((1, 1, -1, 2))
        return made[::step] if chance.random() < 0.5 else np.asfortranarray(made)

    left = image()
    right = image() if chance.random() < 0.3 else left.copy()

    given: dict[str, Any] = {"preset": chance.choice(("fast", "paper", "robust"))}

    for name, values in _KNOBS.items():
        if chance.random() < 0.04:
            given[name] = chance.choice(values)

    if "noise" in given:
        given["known"] = ps.Known(noise=given.pop("noise"))
    if chance.random() < 0.3:
        given["left_mask"] = samples.random(left.shape[:2]) < chance.choice((0.0, 0.5, 1.0))

    with np.errstate(all="ignore"):
        count = chance.choice((-1, 0, 1, 1, 2, 5, 16, 16, 10**6))
        found = ps.match(left, right, num_disparities=count, **given)

    if found.disparity.shape != left.shape[:2] or np.isinf(found.disparity).any():
        raise AssertionError(f"{found.disparity.shape}, {found.disparity}")


_TYPES = "uint8", "uint16", "float32", "float64"

_KNOBS: dict[str, tuple[Any, ...]] = {
    "min_disparity": (-40, -1, 3, 10**6, -(2**31), 2.0),
    "window": (1, 4, 9, 101, -3, 10**9),
    "neighborhood": (3, 7, 2, 0),
    "p1": (0, 1e30, float("nan"), (1, 2), -1),
    "p2": (0, 2.5, -1),
    "threads": (1, 2, 0, 10**9),
    "noise": (0, 2.5, float("inf"), (1, 2)),
    "intensity_range": ((0, 1), (1, 0), (float("nan"), 1)),
    "subpixel": (True, False, 3),
    "median": (True, 3, 0),
    "noise_threshold": (0.0, 1.0, -1.0, float("nan")),
    "sizes": (1, 2, 3, 2.0),
    "despike": (True, False, 3),
    "denoise": (True, False, 2.0),
    "lr_check": (0, 1, -1, 1e9),
    "speckle_size": (0, 10**9, -1),
    "min_confidence": (0.5, 2.0, float("nan")),
    "right_mask": (np.zeros((1, 1), bool), None, 3),
}


READERS: dict[str, tuple[Callable[[Path], Any], tuple[str, ...]]] = {
    "read_image": (
        read_image,
        (".png", ".jpg", ".bmp", ".pgm", ".ppm", ".pbm", ".tif", ".npy", ".pfm"),
    ),
    "read_disparity": (read_disparity, (".png", ".tif", ".npy", ".pfm")),
    "read_depth": (read_depth, (".png", ".tif", ".npy", ".pfm", ".bin")),
    "read_geotiff": (read_geotiff, (".tif",)),
    "is_geotiff": (is_geotiff, (".tif",)),
    "open_raster": (read_windows, (".tif", ".npy")),
    "open_zarr": (read_array, (".meta", ".chunk")),
    "read_pair": (read_pair, (".mpo",)),
    "read_pfm": (read_pfm, (".pfm",)),
    "read_calibration": (read_calibration, (".calib",)),
    "read_calibration of Q": (
        partial(read_calibration, size=(640, 480)),
        (".npz", ".txt", ".yml", ".xml", ".npy"),
    ),
    "read_rig": (read_rig, (".yaml", ".rig", ".saved", ".conf", ".oak", ".cameras", ".mat")),
    "load_rectification": (Rectification.load, (".saved",)),
    "load_statistics": (load, (".statistics",)),
    "read_pairs": (read_list, (".csv",)),
    "read_manifest": (read_manifest, (".jsonl",)),
    "match": (match_strange, (".seed",)),
}
"""What reads files, and the suffixes of those in the corpus that it is given."""


def make_corpus(folder: Path) -> list[Path]:
    """Write small valid files of every format, and return them in an order that is always so."""
    folder.mkdir(parents=True, exist_ok=True)
    samples = np.random.default_rng(0)
    gray = samples.integers(0, 256, (19, 21), np.uint8)
    wide, real = gray.astype(np.uint16) * 257, gray.astype(np.float32) / np.float32(7)
    color = samples.integers(0, 256, (19, 21, 3), np.uint8)
    for ending in ("png", "jpg", "bmp", "pgm", "tif", "npy"):
        write_image(folder / f"gray.{ending}", gray)
    for ending in ("png", "jpg", "bmp", "ppm", "tif", "npy"):
        write_image(folder / f"color.{ending}", color)
    for ending in ("png", "pgm", "tif", "npy"):
        write_image(folder / f"wide.{ending}", wide)
    for ending in ("tif", "npy", "pfm"):
        write_image(folder / f"real.{ending}", real)
    write_depth(folder / "colmap.bin", real + 1)
    write_image(folder / "alpha.png", np.dstack([color, gray]))
    _by_pillow(folder, gray, color)
    _by_tifffile(folder, gray, color, real)
    place = geotiff.Georeference(crs="EPSG:32631", transform=(0.5, 0, 500000, 0, -0.5, 4800000))
    write_geotiff(folder / "placed.tif", gray, like=place, tags={"A": "b"})
    write_geotiff(folder / "masked.tif", np.where(real > 3, real, np.nan), like=place)
    array = _array(folder, gray)
    _words(folder, gray)
    _rigs(folder, gray)
    return sorted(path for path in folder.iterdir() if path != array)


def _by_pillow(folder: Path, gray: Any, color: Any) -> None:
    from PIL import Image  # noqa: PLC0415

    Image.fromarray(color).quantize(17).save(folder / "palette.png")
    Image.fromarray(gray > 99).save(folder / "bits.png")
    Image.fromarray(gray > 99).save(folder / "bits.pbm")

    exif = b"Exif\0\0II*\0"
    Image.fromarray(color).save(folder / "progressive.jpg", progressive=True, exif=exif)
    Image.fromarray(gray).save(folder / "packed.tif", compression="packbits")

    Image.fromarray(gray).save(folder / "lzw.tif", compression="tiff_lzw")

    views = Image.fromarray(color), Image.fromarray(color[::-1])
    views[0].save(folder / "views.mpo", save_all=True, append_images=[views[1]])

    (folder / "plain.pgm").write_text("P2\n3 2\n255\n0 1 2\n3 4 255\n", "ascii")


def _by_tifffile(folder: Path, gray: Any, color: Any, real: Any) -> None:
    import tifffile  # noqa: PLC0415

    with tifffile.TiffWriter(folder / "overview.tif", bigtiff=True) as writer:
        writer.write(gray, tile=(16, 16), compression="zlib", predictor=True)
        writer.write(gray[::2, ::2], subfiletype=1)

    tifffile.imwrite(folder / "strips.tif", color, rowsperstrip=3, compression="zlib")
    tifffile.imwrite(folder / "big.tif", real, byteorder=">", description="a description" * 9)

    planes = np.moveaxis(color, 2, 0)
    tifffile.imwrite(folder / "planes.tif", planes, planarconfig="separate", photometric="rgb")


def _array(folder: Path, gray: Any) -> Path:
    import zarr  # noqa: PLC0415

    whole = folder / "whole.array"
    array = zarr.create_array(whole, shape=gray.shape, chunks=(16, 16), dtype=gray.dtype)
    array[:] = gray

    shutil.copy(whole / "zarr.json", folder / "a.meta")
    shutil.copy(whole / "c/0/0", folder / "a.chunk")

    return whole


def _words(folder: Path, gray: Any) -> None:
    (folder / "a.seed").write_bytes(b"\x15" * 32)
    (folder / "a.calib").write_text(CALIB, "ascii")

    q = np.array([[1, 0, 0, -20], [0, 1, 0, -15], [0, 0, 0, 100], [0, 0, 1 / 60, 2 / 60]])
    np.save(folder / "q.npy", q)
    np.savez_compressed(folder / "q.npz", Q=q, other=np.zeros(3))

    words = " ".join(map(str, q.ravel()))
    (folder / "q.txt").write_text("\n".join(" ".join(map(str, row)) for row in q), "ascii")
    (folder / "q.yml").write_text(
        "%YAML:1.0\n---\nQ: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n   data: [ "
        f"{words.replace(' ', ', ')} ]\n",
        "ascii",
    )
    (folder / "q.xml").write_text(
        '<?xml version="1.0"?>\n<opencv_storage>\n<Q type_id="opencv-matrix">\n  <rows>4</rows>\n'
        f"  <cols>4</cols>\n  <dt>d</dt>\n  <data>\n    {words}</data></Q>\n</opencv_storage>\n",
        "ascii",
    )

    with (folder / "a.csv").open("w", newline="", encoding="utf-8") as file:
        names = ["left", "right", "name", "num_disparities"]
        csv.writer(file).writerows([names, ["a.png", "b,.png", "x", 3]])

    record = Record(name="x", state="done", left="l", right="r", num_disparities=3, min_disparity=0,
                    recipe="0" * 32, files={"x.tif": 3}, seconds=0.5, blur="none")  # fmt: skip
    lines = [json.dumps(asdict(record) | {"name": name}) for name in ("x", "y")]
    (folder / "a.jsonl").write_text("\n".join([*lines, ""]), "utf-8")

    image = np.kron(gray, np.ones((8, 8), np.uint8))

    statistics = large.pair_statistics(
        lambda first, last: (image[first:last], image[first:last], None, None),
        image.shape[:2],
        num_disparities=8,
    )
    statistics.save(folder / "a.statistics")


def _makers(folder: Path, matrices: dict[str, Any]) -> None:
    """Write calibrations as a ZED, an OAK, Metashape and MATLAB have them."""
    lens = "fx=100\nfy=100\ncx=10\ncy=9\nk1=0.1\nk2=0\n"
    sections = f"[LEFT_CAM_VGA]\n{lens}[RIGHT_CAM_VGA]\n{lens}[STEREO]\nBaseline=63\nCV_VGA=0.02\n"
    (folder / "zed.conf").write_text(sections, "ascii")

    pose = {"rotationMatrix": np.eye(3).tolist(), "translation": {"x": -7.5, "y": 0, "z": 0}}
    camera = {"cameraType": 0, "distortionCoeff": [0] * 14, "width": 21, "height": 19,
              "intrinsicMatrix": matrices["K1"].tolist()}  # fmt: skip
    chain = [
        [n, camera | {"extrinsics": pose | {"toCameraSocket": to}}] for n, to in ((1, 2), (2, -1))
    ]
    sockets = {"leftCameraSocket": 1, "rightCameraSocket": 2}
    oak = {"cameraData": chain, "stereoRectificationData": sockets}
    (folder / "eeprom.oak").write_text(json.dumps(oak), "ascii")

    frame = "<resolution width='21' height='19'/><f>100</f><cx>1</cx><k1>0.1</k1>"
    sensor = f"<sensor id='0' type='frame'><calibration>{frame}</calibration></sensor>"
    views = "".join(
        f"<camera id='{n}' sensor_id='0'><transform>1 0 0 {n} 0 1 0 0 0 0 1 0 0 0 0 1</transform>"
        "</camera>"
        for n in (0, 1)
    )
    chunk = f"<chunk><sensors>{sensor}</sensors><cameras>{views}</cameras></chunk>"
    (folder / "metashape.cameras").write_text(f"<document>{chunk}</document>", "ascii")
    savemat(folder / "rig.mat", matrices, do_compression=True)


def _rigs(folder: Path, gray: Any) -> None:
    """Write calibrations of both cameras, and a pair that was rectified by one."""
    intrinsics = "  intrinsics: [100.0, 100.0, 10.0, 9.0]\n  resolution: [21, 19]\n"
    lens = "  camera_model: pinhole\n  distortion_model: radtan\n" + intrinsics
    lens += "  distortion_coeffs: [0.1, 0.0, 0.0, 0.0]\n"
    place = "  T_cn_cnm1: [[1, 0, 0, -0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"
    (folder / "chain.yaml").write_text(f"cam0:\n{lens}cam1:\n{lens}{place}", "ascii")

    camera, baseline = np.array([[100.0, 0, 10], [0, 100, 9], [0, 0, 1]]), np.array([-60.0, 0, 0])
    matrices: dict[str, Any] = {
        "K1": camera,
        "K2": camera,
        "D1": np.zeros(5),
        "D2": np.zeros(5),
        "R": np.eye(3),
    }

    with (folder / "matrices.rig").open("wb") as file:
        np.savez_compressed(file, **matrices, T=baseline, imageSize=np.array([21, 19]))

    _makers(folder, matrices | {"T": baseline})

    mask, flat = np.ones(gray.shape, bool), np.zeros(gray.shape, np.float32)
    Rectification(
        left=gray, right=gray, left_mask=mask, right_mask=mask, maps=((flat, flat), (flat, flat)),
        Q=np.eye(4), method="calibration", interpolation="linear", error=0.1, sentences=("a",),
    ).save(folder / "rectified.saved")  # fmt: skip


def mutate(content: bytes, chance: random.Random, others: list[bytes]) -> bytes:
    """Return a file that differs from this one in one place or in some."""
    changed = bytearray(content)
    for _ in range(chance.choice((1, 1, 1, 2, 4, 16))):
        place = chance.randrange(len(changed) + 1)
        # What a file says of itself is mostly at its ends.
        if chance.random() < 0.5:
            place = min(chance.randrange(200), len(changed))

        kind = chance.randrange(8)
        if kind < 2:
            changed[place : place + 1] = bytes([chance.randrange(256)])
        elif kind < 4:
            size = chance.choice((2, 4, 4, 8))
            number = chance.choice(_INTERESTING) + chance.choice((-1, 0, 0, 1))
            order = chance.choice(("little", "big"))
            changed[place : place + size] = (number % 2 ** (8 * size)).to_bytes(size, order)
        elif kind == 4:
            del changed[place : place + chance.choice((1, 4, 100))]
        elif kind == 5:
            changed[place:place] = changed[place : place + chance.choice((1, 8, 300))]
        elif kind == 6:
            other = chance.choice(others)
            start = chance.randrange(len(other) + 1)
            changed[place : place + 8] = other[start : start + chance.choice((4, 64, 1000))]
        else:
            del changed[max(place, 1) :]

    return bytes(changed)


def flipped(content: bytes, most: int = 48) -> Iterator[bytes]:
    """Yield files that differ from this one in one byte: at both ends, and at even steps between.

    What a file says of itself is mostly at its ends; of a zip archive, in the directory at the end.
    """
    ends = most // 3
    places = {*range(ends), *range(len(content) - ends, len(content))}
    places.update(range(0, len(content), max(len(content) * 3 // most, 1)))
    for place in sorted(place for place in places if 0 <= place < len(content)):
        yield content[:place] + bytes([content[place] ^ 0xFF]) + content[place + 1 :]


def cases(corpus: list[Path], seed: int) -> Iterator[tuple[str, str, bytes]]:
    """Yield readers, suffixes and contents for ever, the same ones for the same seed."""
    chance = random.Random(seed)  # noqa: S311 -- no secret

    contents = {path: path.read_bytes() for path in corpus}
    given = {
        name: [path for path in corpus if path.suffix in suffixes]
        for name, (_, suffixes) in READERS.items()
    }

    names = list(READERS)
    while True:
        name = chance.choice(names)
        path = chance.choice(given[name])
        alike = [contents[other] for other in corpus if other.suffix == path.suffix]
        yield name, path.suffix, mutate(contents[path], chance, alike)


def complaint(name: str, path: Path) -> str | None:
    """Read a file; return the fault in the outcome, or None."""
    started = time.monotonic()

    documented = _OF_MATCH if name == "match" else _DOCUMENTED
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            READERS[name][0](path)
    except documented as error:
        if name != "match" and path.stem not in str(error):
            return f"{error!r}, which does not name the file"
    except Exception as error:  # noqa: BLE001 -- this is what is looked for
        return repr(error)

    seconds = time.monotonic() - started
    return f"{seconds:.1f} s" if seconds > SECONDS else None


def read_all(folder: Path, seed: int, files: int | None, seconds: float | None) -> Counter[str]:
    """Read mutated files until there are this many, or time is over; say of each before it is read.

    What is wrong is a line of JSON on standard output, as is in the end how many were read.
    """
    read: Counter[str] = Counter()
    end = time.monotonic() + (float("inf") if seconds is None else seconds)
    for name, ending, content in cases(make_corpus(folder / "corpus"), seed):
        if time.monotonic() > end or (files is not None and read.total() >= files):
            break

        path = folder / f"{name}{ending}"
        path.write_bytes(content)

        if message := complaint(name, path):
            print(json.dumps({"file": str(path), "raised": message}), flush=True)  # noqa: T201
            keep(path)

        read[name] += 1
        if read.total() % 1000 == 0:
            print(json.dumps({"read": read.total()}), flush=True)  # noqa: T201
        path.unlink()

    return read


def keep(path: Path, output: Path | None = None) -> Path:
    """Copy a file to those that the tests read."""
    target = Path(os.environ.get("PHASESTEREO_FOUND", output or FOUND))
    target.mkdir(exist_ok=True)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:12]
    return Path(shutil.copy(path, target / f"{path.stem}-{digest}{path.suffix}"))


def main() -> int:
    """Fuzz for a while; the number of files that were found is the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=300)
    parser.add_argument("--files", type=int)
    parser.add_argument("--seed", type=int, default=time.time_ns() % 2**32)
    parser.add_argument("--output", type=Path, default=FOUND)
    parser.add_argument("--worker", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()

    if given.worker:
        read = read_all(given.worker, given.seed, given.files, given.seconds)
        print(json.dumps({"counts": read}), flush=True)  # noqa: T201
        return 0

    return min(_watch(given), 100)


def _watch(given: argparse.Namespace) -> int:
    """Start reading processes until the time is over, one after the other that ended."""
    found, counts = 0, Counter[str]()
    end, seed = time.monotonic() + given.seconds, given.seed

    while (left := end - time.monotonic()) > 1 and (
        given.files is None or counts.total() < given.files
    ):
        with tempfile.TemporaryDirectory() as name:
            words = [sys.executable, "-m", "support.fuzzing", "--worker", name, "--seed", str(seed)]
            words += ["--seconds", str(left)]
            if given.files is not None:
                words += ["--files", str(given.files - counts.total())]

            process = subprocess.Popen(  # noqa: S603 -- ourselves
                words, stdout=subprocess.PIPE, text=True,
                env=os.environ | {"PHASESTEREO_FOUND": str(given.output)},
            )  # fmt: skip
            timer = _Alarm(process)

            for line in process.stdout or io.StringIO():
                timer.hear()
                content = json.loads(line)
                counts.update(content.get("counts", {}))
                if "raised" in content:
                    found += 1
                    print(f"{content['file']}: {content['raised']}")  # noqa: T201
            if process.wait():
                found += 1
                if not (at_hand := list(Path(name).glob("*.*"))):
                    raise RuntimeError("the reading process cannot be started")
                for path in at_hand:
                    print(f"ended the process ({process.returncode}): {keep(path, given.output)}")  # noqa: T201

            timer.stop()

        seed += 1

    for reader, count in sorted(counts.items()):
        print(f"{reader}: {count} files")  # noqa: T201
    print(f"{counts.total()} files, {found} found, seed {given.seed}")  # noqa: T201
    return found


class _Alarm:
    """Ends a process that has said nothing for too long."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        import threading  # noqa: PLC0415

        self._heard, self._over = time.monotonic(), threading.Event()
        self._process = process
        threading.Thread(target=self._look, daemon=True).start()

    def hear(self) -> None:
        self._heard = time.monotonic()

    def stop(self) -> None:
        self._over.set()

    def _look(self) -> None:
        while not self._over.wait(1):
            if time.monotonic() - self._heard > _PATIENCE:
                self._process.kill()


if __name__ == "__main__":
    sys.exit(main())

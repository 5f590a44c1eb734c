"""A pair far larger than memory: made of real texture, matched under a limit, held against truth.

    python benches/large_pair.py FOLDER --data MIDDLEBURY

Makes two GeoTIFF files in FOLDER (once), matches them by `phasestereo large` in a
process of its own, and prints its peak of resident memory as the kernel counts it, its time for a
billion pairs of a pixel and a disparity, and how far it is from the disparities that the pair was
made with. Then the whole pair is matched in memory, which has to be there, and bands of both are
compared, bit by bit. With the defaults the pair has 20 000 x 8 000 pixels and 256 disparities.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import rasterio
from rasterio.windows import Window

import phasestereo as ps
from phasestereo_bench.datasets import find_scenes
from phasestereo_large import geotiff

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    Gray = NDArray[np.uint8]

PATCH = 256  # side of the pieces of real images that the texture is made of, pixels
SAMPLED = 64  # rows of each of the bands that are compared
PLACE = rasterio.Affine(0.3, 0.0, 500_000.0, 0.0, -0.3, 5_400_000.0)


@dataclass(frozen=True, slots=True)
class Size:
    """Rows, columns and disparities of the pair."""

    rows: int
    cols: int
    disparities: int


def main(folder: Path, data: Path, size: Size, options: list[str], memory: str) -> None:
    """Make the pair, match it both ways, and report."""
    names = folder / "left.tif", folder / "right.tif"
    if not all(name.exists() for name in names):
        make(names, data, size)
    output = folder / "disparity.tif"
    output.unlink(missing_ok=True)
    seconds, peak = matched(names, output, size, [*options, "--max-memory", memory])
    volume = size.rows * size.cols * size.disparities
    say(f"peak of resident memory {peak / 1e6:.0f} MB, limit {memory}")
    say(f"{seconds:.1f} s, {seconds / volume * 1e9:.2f} s for 10^9 pairs of pixel and disparity")
    with rasterio.open(output) as file:
        found = file.read(1)
    tell_errors(found, size)
    tell_differences(found, names, size, options)


def make(names: tuple[Path, Path], data: Path, size: Size) -> None:
    """Write the pair: rows of patches, and the left image by the disparities that it has."""
    scenes = [scene.load().left for scene in find_scenes(data)]
    images = [image if image.ndim == 2 else image.mean(axis=2) for image in scenes]
    layout = {
        "driver": "GTiff", "dtype": "uint8", "count": 1, "height": size.rows, "width": size.cols,
        "tiled": True, "compress": "deflate", "crs": "EPSG:32632", "transform": PLACE,
    }  # fmt: skip
    with (
        rasterio.open(names[0], "w", **layout) as left,
        rasterio.open(names[1], "w", **layout) as right,
    ):
        for top, texture in strips(images, size):
            rows = np.arange(top, top + len(texture))
            window = Window(0, top, size.cols, len(texture))
            right.write(texture[:, size.disparities :], 1, window=window)
            left.write(warped(texture, truth(rows, size), size), 1, window=window)


def strips(images: list[NDArray[Any]], size: Size) -> Iterator[tuple[int, Gray]]:
    """Yield strips of patches, wider than the image by the disparities."""
    rng = np.random.default_rng(0)
    for top in range(0, size.rows, PATCH):
        strip = np.hstack(
            [patch(images, rng) for _ in range(-(-(size.cols + size.disparities) // PATCH))]
        )
        yield top, strip[: size.rows - top, : size.cols + size.disparities]


def patch(images: list[NDArray[Any]], rng: np.random.Generator) -> Gray:
    """Return a piece of one of the images, perhaps mirrored."""
    image = images[rng.integers(len(images))]
    y, x = (rng.integers(length - PATCH + 1) for length in image.shape)
    turn = rng.choice([-1, 1], 2)
    piece: Gray = image[y : y + PATCH, x : x + PATCH][:: turn[0], :: turn[1]].astype(np.uint8)
    return piece


def truth(rows: NDArray[np.int64], size: Size) -> NDArray[np.float64]:
    """Return the disparities of rows of the left image: hills, over nine tenths of the range."""
    y, x = rows[:, np.newaxis], np.arange(size.cols)
    hills = np.sin(2 * np.pi * x / 5000) * np.cos(2 * np.pi * y / 3000)
    return size.disparities * (0.5 + 0.45 * hills)


def warped(texture: Gray, disparity: NDArray[np.float64], size: Size) -> Gray:
    """Return the left image, in which pixel x shows what the right one has at x - d."""
    places = np.arange(size.cols) + size.disparities - disparity
    whole = places.astype(np.int64)
    near, far = (np.take_along_axis(texture, whole + step, axis=1).astype(float) for step in (0, 1))
    shown: Gray = np.rint(near + (places - whole) * (far - near)).astype(np.uint8)
    return shown


def matched(
    names: tuple[Path, Path], output: Path, size: Size, options: list[str]
) -> tuple[float, int]:
    """Match from file to file; return seconds and the most resident memory, in bytes."""
    command = [sys.executable, "-m", "phasestereo", "large", *map(str, names), "-o", str(output)]
    command += ["--num-disparities", str(size.disparities), *options]
    started = time.perf_counter()
    process = subprocess.Popen(command)  # noqa: S603 - our own command
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(process.returncode)
    return time.perf_counter() - started, usage.ru_maxrss * 1024


def tell_errors(found: NDArray[np.float32], size: Size) -> None:
    """Print how far disparities are from those that the pair was made with."""
    errors = np.abs(found[::16] - truth(np.arange(0, size.rows, 16), size))
    missing = np.isnan(errors)
    wrong = (errors[~missing] > 1).mean()
    say(
        f"of every 16th row: median error {np.nanmedian(errors):.3f} px, "
        f"off by more than 1 px {wrong:.2%}, "
        f"without estimate {missing.mean():.2%}"
    )


def tell_differences(
    found: NDArray[np.float32], names: tuple[Path, Path], size: Size, options: list[str]
) -> None:
    """Match the whole pair in memory, and print how many pixels differ in any bit."""
    preset = options[options.index("--preset") + 1] if "--preset" in options else "robust"
    left, right = (geotiff.read_geotiff(name).image for name in names)
    started = time.perf_counter()
    whole = ps.match(left, right, num_disparities=size.disparities, preset=preset)
    say(f"in memory: {time.perf_counter() - started:.1f} s")
    bands = [slice(top, top + SAMPLED) for top in range(0, size.rows, size.rows // 10)]
    bits = [[map_[rows].view(np.uint32) for rows in bands] for map_ in (found, whole.disparity)]
    different = sum(int((a != b).sum()) for a, b in zip(*bits, strict=True))
    say(f"{len(bands)} bands of {SAMPLED} rows compared: {different} pixels differ")
    every = int((found.view(np.uint32) != whole.disparity.view(np.uint32)).sum())
    say(f"all rows: {every} pixels differ")


def say(line: str) -> None:
    """Print a line at once."""
    print(line, flush=True)  # noqa: T201 - what this script is for


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--data", type=Path, required=True, help="folder with Middlebury's scenes")
    parser.add_argument("--rows", type=int, default=8_000)
    parser.add_argument("--cols", type=int, default=20_000)
    parser.add_argument("--disparities", type=int, default=256)
    parser.add_argument("--max-memory", default="1GB")
    known, rest = parser.parse_known_args()
    known.folder.mkdir(parents=True, exist_ok=True)
    main(
        known.folder,
        known.data,
        Size(known.rows, known.cols, known.disparities),
        rest,
        known.max_memory,
    )

"""What large runs take: rates measured on this machine, and what they come to on more workers.

    python benches/planning.py LEFT RIGHT

Prints the figures of docs/large.md (planning) for one pair of image files, best of 2 megapixels.
Measured, on one thread: a match of the pair from files to files, as a batch does it; bands of a
strip of 30 000 columns, which is the pair side by side; the statistics of that strip; and what a
batch of tiny pairs takes, which is what there is to a pair besides matching it. The rest is
multiplication.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from time import perf_counter, process_time
from typing import TYPE_CHECKING, Any

import numpy as np
from distributed import Client

import phasestereo as ps
import phasestereo_large as large
from phasestereo.io import read_image, write_image
from phasestereo_large.batch import PairFiles, run
from phasestereo_large.batch.work import Order, match_files

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from phasestereo_large.bands import Reader

COUNT = 256  # disparities
STRIP = 30_000  # rows and columns of the strip
BAND = 2048  # rows of a band: little of its halo is done twice
PAIRS = 100_000  # in the archive
TINY = 400  # pairs of 64 x 64 pixels, so that next to nothing is left but what each pair costs
WORKERS = 1, 10, 100
NETWORK = 1.25e9  # bytes a second: ten gigabits
ROUNDS = 3
ROBUST = ps.PRESETS["robust"]
WAYS = {
    "fast": ps.PRESETS["fast"],
    "robust": ROBUST,
    "robust, one path": replace(ROBUST, optimizer="so"),
}


@dataclass(frozen=True, slots=True)
class Rate:
    """What one pair takes: seconds of one thread, bytes read and bytes written."""

    seconds: float
    read: int
    written: int


def main(left: Path, right: Path) -> None:
    """Measure, then print both plans."""
    images = read_image(left), read_image(right)
    pixels = images[0].shape[0] * images[0].shape[1]
    pairs = {name: pair_rate(left, right, way) for name, way in WAYS.items()}
    each, client = tiny_pairs()
    head("one thread", "GDE/s of pairs, files and all", "GDE/s of bands of a strip")
    bands = {name: band_rate(images, way) for name, way in WAYS.items()}
    for name in WAYS:
        rate = pixels * COUNT / pairs[name].seconds / 1e9
        strip = BAND * STRIP * COUNT / bands[name] / 1e9
        say(f"| {name} | {rate:.2f} | {strip:.2f} |")
    seconds = statistics_seconds(images)
    say(f"\nstatistics of the strip for robust: {seconds:.0f} s")
    say(
        f"tiny pairs: {1e3 * each:.1f} ms each in a loop; of a cluster's client and scheduler "
        f"{1e3 * client:.1f} ms"
    )
    for name in ("fast", "robust"):
        plan_archive(name, pairs[name], client)
    for name, way in WAYS.items():
        plan_strip(name, bands[name] / BAND, seconds if way.compensate_blur else 0.0)


def pair_rate(left: Path, right: Path, settings: ps.Settings) -> Rate:
    """Match the pair as a batch does, on one thread."""
    pair = PairFiles(name="pair", left=left, right=right, num_disparities=COUNT)
    seconds = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        order = Order(settings=settings, folder=folder, suffix=".tif", layers=(), threads=1)
        for _ in range(ROUNDS):
            started = perf_counter()
            match_files(pair, order, order.recipe(pair))
            seconds.append(perf_counter() - started)
        written = (folder / "pair.tif").stat().st_size
    read = left.stat().st_size + right.stat().st_size
    return Rate(median(seconds), read, written)


def band_rate(images: tuple[NDArray[Any], ...], way: ps.Settings) -> float:
    """Return the seconds that a band of the strip takes."""
    sides = [strip(image) for image in images]
    known = large.pair_statistics(
        reader(sides), (STRIP, STRIP), num_disparities=COUNT, settings=way, threads=1
    )
    started = perf_counter()
    large.match_rows(reader(sides), known, BAND, 2 * BAND, threads=1)
    return perf_counter() - started


def statistics_seconds(images: tuple[NDArray[Any], ...]) -> float:
    """Return the seconds that the statistics of the strip take, on all threads."""
    started = perf_counter()
    large.pair_statistics(
        reader([strip(image) for image in images]), (STRIP, STRIP), num_disparities=COUNT
    )
    return perf_counter() - started


def strip(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Return the image, gray, side by side as often as the strip has room for."""
    gray = image if image.ndim == 2 else image.mean(axis=2).astype(np.uint8)
    return np.tile(gray, (1, -(-STRIP // gray.shape[1])))[:, :STRIP]


def reader(sides: list[NDArray[np.uint8]]) -> Reader:
    """Return a reader of rows of a strip whose rows repeat."""

    def read(first: int, last: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8], None, None]:
        rows = np.arange(first, last) % len(sides[0])
        return sides[0][rows], sides[1][rows], None, None

    return read


def tiny_pairs() -> tuple[float, float]:
    """Return the seconds that a tiny pair takes in a loop, and those of client and scheduler."""
    with tempfile.TemporaryDirectory() as name, Client(n_workers=2) as client:
        folder = Path(name)
        write_image(folder / "tiny.png", np.zeros((64, 64), np.uint8))
        files = [
            PairFiles(
                name=f"{n}", left=folder / "tiny.png", right=folder / "tiny.png", num_disparities=1
            )
            for n in range(TINY)
        ]
        settings = ps.PRESETS["fast"]
        order = Order(settings=settings, folder=folder, suffix=".tif", layers=(), threads=1)
        started = perf_counter()
        for pair in files:
            match_files(pair, order, order.recipe(pair))
        between = perf_counter()
        busy = process_time()
        run(files, folder / "maps", scheduler=client.scheduler.address, settings=settings)
        return (between - started) / TINY, (process_time() - busy) / TINY


def plan_archive(preset: str, rate: Rate, dispatched: float) -> None:
    """Print what the archive takes."""
    read, written = (PAIRS * size for size in (rate.read, rate.written))
    say(f"\n{PAIRS} pairs, {preset}: reads {read / 1e9:.0f} GB, writes {written / 1e9:.0f} GB")
    head("workers", "time", "read and written", "of ten gigabits", "of the client")
    for workers in WORKERS:
        seconds = PAIRS * rate.seconds / workers
        flow = (read + written) / seconds
        busy = PAIRS * dispatched / seconds
        say(
            f"| {workers} | {duration(seconds)} | {flow / 1e6:.0f} MB/s | {flow / NETWORK:.0%} | "
            f"{busy:.0%} |"
        )


def plan_strip(name: str, row: float, statistics: float) -> None:
    """Print what the strip takes, in bands of its own for each worker."""
    read, written = 2 * STRIP * STRIP, 4 * STRIP * STRIP
    say(f"\n{STRIP} x {STRIP}, {name}: reads {read / 1e9:.1f} GB, writes {written / 1e9:.1f} GB\n")
    head("workers", "statistics", "bands", "read and written", "of ten gigabits")
    for workers in WORKERS:
        seconds = STRIP * row / workers
        flow = (read + written) / seconds
        say(
            f"| {workers} | {statistics:.0f} s | {duration(seconds)} | {flow / 1e6:.0f} MB/s | "
            f"{flow / NETWORK:.0%} |"
        )


def duration(seconds: float) -> str:
    """Return a duration in words."""
    units = (86400 * 2, 86400, "days"), (3600 * 2, 3600, "h"), (120, 60, "min"), (0, 1, "s")
    _, unit, word = next(each for each in units if seconds >= each[0])
    return f"{seconds / unit:.1f} {word}"


def head(*columns: str) -> None:
    """Print the head of a table."""
    say(f"\n| {' | '.join(columns)} |\n{'|---' * len(columns)}|")


def say(line: str) -> None:
    """Print a line at once."""
    print(line, flush=True)  # noqa: T201 - what this script is for


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))

"""What a batch costs on a Dask cluster, beside a plain loop, and how much several workers gain.

    python benches/cluster.py LEFT RIGHT [PRESET [PAIRS [ROUNDS]]]

Prints the figures of docs/large.md for one pair of image files, best of 2 megapixels, which is
matched PAIRS times in each round. A round has every way once, in turn: the loop in this process, a
cluster of one worker, of two and so on up to the number of processors, each worker of one thread.
Clusters are up before the first round. The rest of a batch is timed: connecting, reading, writing,
the manifest. Figures are medians over the rounds.
"""

from __future__ import annotations

import sys
import tempfile
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import TYPE_CHECKING, Any

import dask.array as da
from dask.system import CPU_COUNT
from distributed import Client

import phasestereo as ps
from phasestereo.io import read_image
from phasestereo_large import dask as lazily
from phasestereo_large.batch import PairFiles, Record, run
from phasestereo_large.batch.work import Order, match_files

if TYPE_CHECKING:
    from collections.abc import Callable

COUNT = 256
"""Disparities."""


def main(left: Path, right: Path, preset: str = "fast", pairs: int = 8, rounds: int = 5) -> None:
    """Print both tables."""
    files = [
        PairFiles(name=f"{n}", left=left, right=right, num_disparities=COUNT) for n in range(pairs)
    ]
    with ExitStack() as stack:
        clients = {n: stack.enter_context(started(n)) for n in range(1, CPU_COUNT + 1)}
        ways: dict[str, Callable[[Path], Any]] = {"plain loop": partial(loop, files, preset)}
        for workers, client in clients.items():
            address = client.scheduler.address
            ways[f"{workers} workers"] = partial(distributed, files, preset, address)
        show(f"{pairs} pairs, {preset}", timed(ways, rounds), pairs)
    if preset == "fast":
        show("one pair in bands", timed(banded(left, right, preset), rounds), 1)


def started(workers: int) -> Client:
    """Start a cluster on this machine, which listens to all who are on it."""
    return Client(n_workers=workers, threads_per_worker=1, dashboard_address="127.0.0.1:0")


def loop(files: list[PairFiles], preset: str, folder: Path) -> None:
    """Match all pairs one after another in this process."""
    order = Order(settings=ps.PRESETS[preset], folder=folder, suffix=".tif", layers=(), threads=1)
    for pair in files:
        check(match_files(pair, order, order.recipe(pair)))


def distributed(files: list[PairFiles], preset: str, address: str, folder: Path) -> None:
    """Match all pairs on a cluster."""
    for record in run(files, folder, scheduler=address, preset=preset).failed:
        check(record)


def check(record: Record) -> None:
    """End the benchmark if a pair could not be matched."""
    if record.state != "done":
        raise RuntimeError(record.reason)


def banded(left: Path, right: Path, preset: str) -> dict[str, Callable[[Path], Any]]:
    """Return the ways to match one pair: as a whole, and as a Dask array of bands."""
    images = read_image(left), read_image(right)
    arrays = [da.from_array(image, chunks=(256, -1, -1)[: image.ndim]) for image in images]
    options: dict[str, Any] = {"preset": preset, "num_disparities": COUNT, "threads": 1}
    lazy = lazily.match(*arrays, **options)
    return {
        "plain loop": lambda _: ps.match(*images, **options),
        "dask.match, one thread": lambda _: lazy.compute(scheduler="sync"),
        f"dask.match, {CPU_COUNT} threads": lambda _: lazy.compute(scheduler="threads"),
    }


def timed(ways: dict[str, Callable[[Path], Any]], rounds: int) -> dict[str, float]:
    """Return the median of the seconds that each way takes; a first round is not counted."""
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    for number in range(rounds + 1):
        for name, way in ways.items():
            with tempfile.TemporaryDirectory() as folder:
                started = perf_counter()
                way(Path(folder))
                if number:
                    seconds[name].append(perf_counter() - started)
    return {name: median(each) for name, each in seconds.items()}


def show(title: str, seconds: dict[str, float], pairs: int) -> None:
    """Print a table."""
    print(f"\n| {title} | s | pairs/s | to the loop |\n|---|---|---|---|")  # noqa: T201 -- its purpose
    for name, each in seconds.items():
        share = each / seconds["plain loop"]
        print(f"| {name} | {each:.2f} | {pairs / each:.2f} | {share:.3f} |")  # noqa: T201 -- as above


if __name__ == "__main__":
    given = sys.argv[1:]
    numbers = [int(word) for word in given[3:]]
    main(Path(given[0]), Path(given[1]), (given[2:] or ["fast"])[0], *numbers)

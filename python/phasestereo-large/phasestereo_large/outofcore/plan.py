"""How to match within a limit on memory: on how many threads, in bands of how many rows."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from phasestereo import _core
from phasestereo.settings import PRESETS
from phasestereo_large.bands import working_memory
from phasestereo_large.outofcore.sizes import format_bytes
from phasestereo_large.statistics import PairStatistics
from phasestereo_large.windows import RasterPair

BAND_ROWS = _core.BAND_ROWS
"""Bands have multiples of this number of rows by default."""

LARGEST = 32 * BAND_ROWS
"""Rows of the largest band: beyond, less of halos is saved than is lost when a run is killed."""

_LEAST_CACHE = 16 * 2**20


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """The plan by which a pair is matched.

    Parameters
    ----------
    size
        Rows and columns of the pair.
    num_disparities
        Number of disparities searched.
    rows
        Rows of a band, but for the last one.
    threads
        Number of threads.
    memory
        Bytes that the process has at most at any time, as expected.
    bands
        Number of bands that are to be matched.
    finished
        Number of bands that an earlier run left finished.
    seconds
        Time that matching these bands takes, as expected.
    by_band
        Whether that is from a band that was matched, and of what is left then; else from a small
        part of the pair.
    """

    size: tuple[int, int]
    num_disparities: int
    rows: int
    threads: int
    memory: int
    bands: int
    finished: int
    seconds: float
    by_band: bool = False


def resident() -> int:
    """Return the process's memory in bytes; where that is unknown, its peak."""
    try:
        pages = int(Path("/proc/self/statm").read_bytes().split()[1])
    except OSError:
        return peak() or 0
    return pages * os.sysconf("SC_PAGE_SIZE")


def peak() -> int | None:
    """Return the most bytes of memory that the process had; None: the system does not say."""
    if find_spec("resource") is None:
        return None
    import resource  # noqa: PLC0415  # Windows has none

    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else most * 1024


def cache(pair: RasterPair) -> int:
    """Return the bytes that GDAL needs to keep, so that no block of a file is decoded twice."""
    return max(_LEAST_CACHE, 2 * sum(raster.block[1] for raster in pair.rasters))


def fit(
    statistics: PairStatistics, pair: RasterPair, limit: int, *, threads: int, rows: int | None
) -> tuple[int, int, int]:
    """Return rows of a band, threads, and the memory they take, of which the limit allows most.

    Parameters
    ----------
    statistics
        That of the pair.
    pair
        The pair.
    limit
        Bytes that the process may have.
    threads
        Number of threads that may be used.
    rows
        Rows of a band; None: the most that the limit allows.

    Raises
    ------
    ValueError
        If the limit is too low whatever the band.
    """
    base = resident() + cache(pair) + _pieces(pair)
    most = min(LARGEST, -(-pair.size[0] // BAND_ROWS) * BAND_ROWS)

    def takes(count: int, workers: int) -> int:
        return base + working_memory(statistics, count, threads=workers, itemsize=pair.itemsize)

    def fits(workers: int, count: int) -> bool:
        return takes(count, workers) <= limit

    for workers in range(threads, 0, -1):
        # Fewer rows than this would leave threads without work.
        low, high = (rows, rows) if rows else (min(BAND_ROWS * workers, most), most)
        if fits(workers, low):
            best = _largest(low, high, partial(fits, workers))
            return best, workers, takes(best, workers)

    least = takes(rows or BAND_ROWS, 1)
    raise ValueError(
        f"max_memory: got {format_bytes(limit)}; accepts {_hint(least, statistics, pair)}"
    )


def _largest(low: int, high: int, fits: Callable[[int], bool]) -> int:
    """Return the largest multiple of `BAND_ROWS` from low, which fits, to high that fits."""
    # Bisection: more rows take more memory.
    while low < high:
        middle = low + -(-(high - low) // (2 * BAND_ROWS)) * BAND_ROWS
        if fits(middle):
            low = middle
        else:
            high = middle - BAND_ROWS
    return low


def _pieces(pair: RasterPair) -> int:
    """Return the bytes that a piece of a file takes on its way into an array."""
    return max(
        max(64, 2 * raster.block[0]) * pair.size[1] * (3 * raster.itemsize + 4)
        for raster in pair.rasters
    )


def _hint(least: int, statistics: PairStatistics, pair: RasterPair) -> str:
    """Return the memory that would suffice, and ways to reduce it, in words."""
    width, count = statistics.size[1], statistics.num_disparities
    remedies = ["with fewer disparities"]
    if statistics.settings != PRESETS["fast"]:
        remedies.append("with the preset fast")
    text = (
        f"{format_bytes(least)} or more for {width} columns and {count} disparities; less would do "
        f"{' or '.join(remedies)}"
    )

    # Blocks of many rows may be what takes most.
    blocks = max(pair.rasters, key=lambda raster: raster.block[1])
    kept = cache(pair)
    if kept > _LEAST_CACHE and 2 * (kept + _pieces(pair)) > least - resident():
        text += (
            f"; {blocks.path} is stored in blocks of {blocks.block[0]} rows, which are read as a "
            "whole: store it in tiles"
        )

    return text

"""Plan a match within a limit on memory: the number of threads, and the rows of a band."""

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
"""Rows of the largest band: more rows save less on halos than a killed run loses."""

_LEAST_CACHE = 16 * 2**20


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """The plan for matching a pair.

    Parameters
    ----------
    size
        Rows and columns of the pair.
    num_disparities
        Number of disparities searched.
    rows
        Rows of a band, except the last one.
    threads
        Number of threads.
    memory
        Expected peak memory of the process, bytes.
    bands
        Number of bands to match.
    finished
        Number of bands that an earlier run finished.
    seconds
        Expected time for matching these bands.
    by_band
        Whether that time comes from a matched band, and covers the remaining bands; else it comes
        from a small part of the pair.
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
    """Return the process's memory in bytes, or its peak if that is unknown."""
    try:
        pages = int(Path("/proc/self/statm").read_bytes().split()[1])
    except OSError:
        return peak() or 0
    return pages * os.sysconf("SC_PAGE_SIZE")


def peak() -> int | None:
    """Return the peak memory of the process, bytes, or None if the system does not report it."""
    if find_spec("resource") is None:
        return None
    import resource  # noqa: PLC0415  # not on Windows

    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else most * 1024


def cache(pair: RasterPair) -> int:
    """Return the bytes that GDAL must keep to decode every block of a file only once."""
    return max(_LEAST_CACHE, 2 * sum(raster.block[1] for raster in pair.rasters))


def fit(
    statistics: PairStatistics, pair: RasterPair, limit: int, *, threads: int, rows: int | None
) -> tuple[int, int, int]:
    """Return the most rows of a band and threads within the limit, and the memory they take.

    Parameters
    ----------
    statistics
        The statistics of the pair.
    pair
        The pair.
    limit
        Bytes that the process may take.
    threads
        Largest number of threads.
    rows
        Rows of a band, at most all of them; None: the most that the limit allows.

    Raises
    ------
    ValueError
        If the limit is too low for any band.
    """
    base = resident() + cache(pair) + _pieces(pair)
    most = min(LARGEST, -(-pair.size[0] // BAND_ROWS) * BAND_ROWS)
    rows = None if rows is None else min(rows, pair.size[0])

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
    """Return the largest multiple of `BAND_ROWS` that fits, between low, which fits, and high."""
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

    # Blocks of many rows may take the most.
    blocks = max(pair.rasters, key=lambda raster: raster.block[1])
    kept = cache(pair)
    if kept > _LEAST_CACHE and 2 * (kept + _pieces(pair)) > least - resident():
        text += (
            f"; {blocks.path} is stored in blocks of {blocks.block[0]} rows, which are read as a "
            "whole: store it in tiles"
        )

    return text

"""The bands of a run: choose them, match them, and assemble the map."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo import _core
from phasestereo._opening import Progress
from phasestereo.known import Known
from phasestereo.matching import match
from phasestereo.result import MAPS, Flag, Result, count_flags
from phasestereo_large.bands import halo, match_rows
from phasestereo_large.outofcore import plan as planning
from phasestereo_large.outofcore.plan import Plan
from phasestereo_large.outofcore.report import MapReport
from phasestereo_large.outofcore.request import Request
from phasestereo_large.outofcore.sinks import WINDOW_ROWS
from phasestereo_large.outofcore.store import Store
from phasestereo_large.statistics import PairStatistics
from phasestereo_large.windows import RasterPair

_SAMPLE = 2048  # columns of the part for measuring the speed of this machine


@dataclass(frozen=True, slots=True, eq=False)
class Work:
    """A run between its preparation and its output.

    Parameters
    ----------
    pair, statistics
        The pair, and the known facts about all of it.
    store
        The finished bands.
    layers
        The layers of the result to keep.
    announce, progress
        As in `phasestereo_large.outofcore.match`.
    """

    pair: RasterPair
    statistics: PairStatistics
    store: Store
    layers: tuple[str, ...]
    announce: Callable[[Plan], object] | None
    progress: Progress | None

    def planned(self, limit: int, threads: int, rows: int | None) -> Plan:
        """Return the plan of the remaining work; see `planning.fit`."""
        size = self.pair.size
        rows, threads, memory = planning.fit(
            self.statistics, self.pair, limit, threads=threads, rows=rows
        )

        gaps = self.store.gaps(size[0])
        pixels = _rows(gaps) * size[1]

        return Plan(
            size=size,
            num_disparities=self.statistics.num_disparities,
            rows=rows,
            threads=threads,
            memory=memory,
            bands=len(list(_bands(gaps, rows))),
            finished=len(self.store.bands()),
            seconds=pixels * self._seconds_a_pixel(rows, threads) if pixels else 0.0,
        )

    def match_bands(self, plan: Plan) -> Plan:
        """Match the remaining bands; return the plan with the time of the first band."""
        self._announce(plan)
        rows = plan.size[0]
        workers = _core.Workers(plan.threads)
        gaps = self.store.gaps(rows)
        done = rows - _rows(gaps)
        self._report_progress(done, rows)

        for band in _bands(gaps, plan.rows):
            started = perf_counter()
            self._match(band, workers, self._within(rows, done, band))
            done += _rows([band])
            self._report_progress(done, rows)

            # The first band predicts the time of the others.
            if not plan.by_band and done < rows:
                pace = (perf_counter() - started) / _rows([band])
                plan = replace(plan, seconds=pace * (rows - done), by_band=True)
                self._announce(plan)

        return plan

    def windows(self, layer: str) -> Iterator[tuple[int, NDArray[Any]]]:
        """Yield a layer of the map by windows of `WINDOW_ROWS` rows: the first row, and values."""
        row = 0
        rest = np.empty((0, self.pair.size[1]), MAPS[layer].dtype)
        for band in self.store.bands():
            rest = np.concatenate([rest, self.store.load(band, layer)])
            while len(rest) >= WINDOW_ROWS:
                yield row, rest[:WINDOW_ROWS]
                row, rest = row + WINDOW_ROWS, rest[WINDOW_ROWS:]

        if len(rest):
            yield row, rest

    def report(self, plan: Plan, request: Request) -> MapReport:
        """Return the report."""
        estimated = 0
        seconds = 0.0
        flags = np.zeros(len(Flag), np.int64)
        for band in self.store.bands():
            estimated += int(self.store.load(band, "estimated"))
            seconds += float(self.store.load(band, "seconds"))
            flags += self.store.load(band, "flag_counts")

        return MapReport(
            plan=plan,
            statistics=self.statistics,
            files=request.outputs,
            estimated=estimated / (plan.size[0] * plan.size[1]),
            flags=dict(zip(Flag, flags.tolist(), strict=True)),
            seconds=seconds,
            peak_memory=planning.peak(),
            again=tuple(self.store.again),
        )

    def _match(
        self, band: tuple[int, int], workers: _core.Workers, within: Progress | None
    ) -> None:
        """Match a band, and keep it."""
        started = perf_counter()
        read = self.pair.reader()
        found = match_rows(read, self.statistics, *band, threads=workers, progress=within)

        block = self._block(found)
        block["seconds"] = np.array(perf_counter() - started)
        self.store.save(band, block)

    def _block(self, result: Result) -> dict[str, NDArray[Any]]:
        """Return the requested layers of a band, and counts."""
        block = {layer: getattr(result, layer) for layer in self.layers}
        counts = count_flags(result.flags)
        block["flag_counts"] = np.array([counts[flag] for flag in Flag])
        block["estimated"] = np.isfinite(result.disparity).sum()
        return block

    def _seconds_a_pixel(self, band: int, threads: int) -> float:
        """Match a small part of the pair, to time a pixel of a band of this number of rows.

        It comes from the middle, since the margins of strips often have no data. The choice of
        searched disparities makes no difference, so it searches ones that fit the part.
        """
        height, width = self.pair.size
        rows, across = min(height, planning.BAND_ROWS * threads), min(width, _SAMPLE)
        first, start = (height - rows) // 2, (width - across) // 2
        left, right, *masks = self.pair.reader((start, start + across))(first, first + rows)
        settings = replace(
            self.statistics.settings, compensate_blur=False, despike=False, denoise=False
        )

        started = perf_counter()

        match(
            left,
            right,
            num_disparities=min(self.statistics.num_disparities, across),
            settings=settings,
            threads=threads,
            left_mask=masks[0],
            right_mask=masks[1],
            known=Known(noise=1.0 if settings.noise_threshold > 0 else None),
        )

        # Scale to all disparities, and to the rows around a band that are matched with it.
        share = self.statistics.num_disparities / min(self.statistics.num_disparities, across)
        with_halo = 1 + 2 * halo(self.statistics.settings, self.statistics.blur_compensation) / band
        return (perf_counter() - started) / (rows * across) * share * with_halo

    def _within(self, every: int, done: int, band: tuple[int, int]) -> Progress | None:
        """Return the overall progress from the progress of a band and the rows done before."""
        if self.progress is None:
            return None

        rows = _rows([band])

        def progress(part: int, parts: int) -> None:
            self._report_progress(done + min(rows - 1, rows * part // max(parts, 1)), every)

        return progress

    def _announce(self, plan: Plan) -> None:
        if self.announce is not None:
            self.announce(plan)

    def _report_progress(self, done: int, rows: int) -> None:
        if self.progress is not None:
            self.progress(done, rows)


def _rows(between: list[tuple[int, int]]) -> int:
    return sum(last - first for first, last in between)


def _bands(between: list[tuple[int, int]], rows: int) -> Iterator[tuple[int, int]]:
    """Cut rows into bands that end at multiples of a number of rows, if possible."""
    for first, last in between:
        ends = [*range(first - first % rows + rows, last, rows), last]
        yield from zip([first, *ends], ends, strict=False)

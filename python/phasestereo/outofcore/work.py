"""The bands of a run: which are to be matched, matching them, and the map that they make up."""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from phasestereo import _core
from phasestereo.banding import halo, match_rows
from phasestereo.matcher import match
from phasestereo.outofcore import plan as planning
from phasestereo.outofcore.plan import Plan, Tile
from phasestereo.outofcore.report import Report
from phasestereo.outofcore.sinks import DTYPES, ROWS
from phasestereo.result import Flag, count_flags

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from typing import Any

    from numpy.typing import NDArray

    from phasestereo.io.windows import RasterPair
    from phasestereo.matcher import Progress
    from phasestereo.outofcore.request import Request
    from phasestereo.outofcore.store import Store
    from phasestereo.result import Result
    from phasestereo.surveying import Survey

_SAMPLE = 2048  # columns that tell, with a few rows, how fast this machine is


@dataclass(frozen=True, slots=True, eq=False)
class Work:
    """A run between its preparation and its output.

    Parameters
    ----------
    pair, survey
        What is matched, and what is known of the whole of it.
    store
        What of it is finished.
    layers
        The layers of the result that are kept.
    announce, progress
        As `phasestereo.outofcore.match` has it.
    """

    pair: RasterPair
    survey: Survey
    store: Store
    layers: tuple[str, ...]
    announce: Callable[[Plan], object] | None
    progress: Progress | None

    def planned(self, tiles: tuple[Tile, ...], limit: int, threads: int, rows: int | None) -> Plan:
        """Return how to match what is left to do of these tiles; see `planning.fit`."""
        size = self.pair.size
        surveys = [self._survey(tile) for tile in tiles]
        rows, threads, memory = planning.fit(surveys, self.pair, limit, threads=threads, rows=rows)
        gaps = [self.store.gaps(tile.number, size[0]) for tile in tiles]
        widths = [each.size[1] for each in surveys]
        pixels = sum(_rows(each) * width for each, width in zip(gaps, widths, strict=True))
        return Plan(
            size=size,
            num_disparities=self.survey.num_disparities,
            tiles=tiles,
            rows=rows,
            threads=threads,
            memory=memory,
            bands=sum(len(list(_bands(each, rows))) for each in gaps),
            finished=sum(len(self.store.bands(tile.number)) for tile in tiles),
            seconds=pixels * self._seconds_a_pixel(max(widths), rows, threads) if pixels else 0.0,
        )

    def run(self, plan: Plan) -> Plan:
        """Match all that is not finished; return the plan with what the first band tells."""
        self._announce(plan)
        height, workers = plan.size[0], _core.Workers(plan.threads)
        rows = height * len(plan.tiles)
        gaps = {tile: self.store.gaps(tile.number, height) for tile in plan.tiles}
        done = rows - sum(map(_rows, gaps.values()))
        self._tell(done, rows)
        for tile, between in gaps.items():
            for band in _bands(between, plan.rows):
                started = perf_counter()
                self._match(tile, band, workers, self._within(plan, done, band))
                done += _rows([band])
                self._tell(done, rows)
                if not plan.by_band and done < rows:
                    pace = (perf_counter() - started) / _rows([band])
                    plan = replace(plan, seconds=pace * (rows - done), by_band=True)
                    self._announce(plan)
        return plan

    def windows(self, plan: Plan, layer: str) -> Iterator[tuple[int, int, NDArray[Any]]]:
        """Yield a layer of the map by windows of `ROWS` rows: row, column, values."""
        for tile in plan.tiles:
            row, rest = 0, np.empty((0, tile.columns[1] - tile.columns[0]), DTYPES[layer])
            for band in self.store.bands(tile.number):
                rest = np.concatenate([rest, self.store.load(tile.number, band, layer)])
                while len(rest) >= ROWS:
                    yield row, tile.columns[0], rest[:ROWS]
                    row, rest = row + ROWS, rest[ROWS:]
            if len(rest):
                yield row, tile.columns[0], rest

    def report(self, plan: Plan, request: Request) -> Report:
        """Return what there is to say."""
        estimated, seconds, flags = 0, 0.0, np.zeros(len(Flag), np.int64)
        for tile in plan.tiles:
            for band in self.store.bands(tile.number):
                estimated += int(self.store.load(tile.number, band, "estimated"))
                seconds += float(self.store.load(tile.number, band, "seconds"))
                flags += self.store.load(tile.number, band, "flag_counts")
        return Report(
            plan=plan,
            survey=self.survey,
            files=request.outputs,
            estimated=estimated / (plan.size[0] * plan.size[1]),
            flags=dict(zip(Flag, flags.tolist(), strict=True)),
            seconds=seconds,
            peak_memory=planning.peak(),
            approximate=request.approximation(plan.size[1]),
            again=tuple(self.store.again),
        )

    def _match(
        self, tile: Tile, band: tuple[int, int], workers: _core.Workers, within: Progress | None
    ) -> None:
        """Match a band of a tile, and keep it."""
        started = perf_counter()
        read, survey = self.pair.reader(tile.reads), self._survey(tile)
        found = match_rows(read, survey, *band, threads=workers, progress=within)
        block = self._block(found, tile)
        block["seconds"] = np.array(perf_counter() - started)
        self.store.save(tile.number, band, block)

    def _block(self, result: Result, tile: Tile) -> dict[str, NDArray[Any]]:
        """Return what is kept of a band: the layers that are asked for, and counts."""
        shift = tile.reads[0]
        part = slice(tile.columns[0] - shift, tile.columns[1] - shift)
        flags = result.flags[:, part]
        block = {layer: getattr(result, layer)[:, part] for layer in self.layers}
        counts = count_flags(flags)
        block["flag_counts"] = np.array([counts[flag] for flag in Flag])
        block["estimated"] = np.isfinite(result.disparity[:, part]).sum()
        return block

    def _survey(self, tile: Tile) -> Survey:
        whole = tile.reads == (0, self.survey.size[1])
        return self.survey if whole else self.survey.columns(*tile.reads)

    def _seconds_a_pixel(self, columns: int, band: int, threads: int) -> float:
        """Match a small part of the pair, to see how long a pixel of a band of so many rows takes.

        It is of the middle, since the margins of strips often have no data. Which disparities are
        searched there makes no difference, so they are such as the part has.
        """
        height, width = self.pair.size
        rows, across = min(height, planning.ROWS * threads), min(width, columns, _SAMPLE)
        first, start = (height - rows) // 2, (width - across) // 2
        left, right, *masks = self.pair.reader((start, start + across))(first, first + rows)
        settings = replace(self.survey.settings, equalise=False, despike=False, denoise=False)
        started = perf_counter()
        match(
            left,
            right,
            num_disparities=min(self.survey.num_disparities, across),
            settings=settings,
            threads=threads,
            left_mask=masks[0],
            right_mask=masks[1],
            noise=1.0 if settings.weak > 0 else None,
        )
        share = self.survey.num_disparities / min(self.survey.num_disparities, across)
        with_halo = 1 + 2 * halo(self.survey.settings, self.survey.equalisation) / band
        return (perf_counter() - started) / (rows * across) * share * with_halo

    def _within(self, plan: Plan, done: int, band: tuple[int, int]) -> Progress | None:
        """Return what tells how far a band is, after so many rows of others."""
        if self.progress is None:
            return None
        every, rows = plan.size[0] * len(plan.tiles), _rows([band])

        def progress(part: int, parts: int) -> None:
            self._tell(done + min(rows - 1, rows * part // max(parts, 1)), every)

        return progress

    def _announce(self, plan: Plan) -> None:
        if self.announce is not None:
            self.announce(plan)

    def _tell(self, done: int, rows: int) -> None:
        if self.progress is not None:
            self.progress(done, rows)


def _rows(between: list[tuple[int, int]]) -> int:
    return sum(last - first for first, last in between)


def _bands(between: list[tuple[int, int]], rows: int) -> Iterator[tuple[int, int]]:
    """Cut rows into bands that end at multiples of so many rows, as far as they can."""
    for first, last in between:
        ends = [*range(first - first % rows + rows, last, rows), last]
        yield from zip([first, *ends], ends, strict=False)

"""The bands of a run: which are to be matched, matching them, and the map that they make up."""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from phasestereo.banding import Sweep
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

_SAMPLE = (64, 2048)  # rows and columns that tell how fast this machine is


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
        left = [sum(last - first for first, last in each) for each in gaps]
        widths = [each.size[1] for each in surveys]
        pixels = sum(rest * width for rest, width in zip(left, widths, strict=True))
        return Plan(
            size=size,
            num_disparities=self.survey.num_disparities,
            tiles=tiles,
            rows=rows,
            threads=threads,
            memory=memory,
            bands=sum(-(-(last - first) // rows) for each in gaps for first, last in each),
            finished=sum(len(self.store.bands(tile.number)) for tile in tiles),
            seconds=pixels * self._seconds_a_pixel(max(widths), threads) if pixels else 0.0,
        )

    def run(self, plan: Plan) -> Plan:
        """Match all that is not finished; return the plan with what the second band tells."""
        self._announce(plan)
        rows = plan.size[0] * len(plan.tiles)
        gaps = [gap for tile in plan.tiles for gap in self.store.gaps(tile.number, plan.size[0])]
        done = rows - sum(last - first for first, last in gaps)
        self._tell(done, rows)
        bands = 0
        for tile in plan.tiles:
            for matched, seconds in self._bands(tile, plan, done):
                done, bands = done + matched, bands + 1
                self._tell(done, rows)
                if bands == 2 and done < rows:  # the first one of a sweep looks ahead
                    plan = replace(plan, seconds=seconds / matched * (rows - done), by_band=True)
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

    def _bands(self, tile: Tile, plan: Plan, done: int) -> Iterator[tuple[int, float]]:
        """Match the bands of a tile that are not finished; yield rows and seconds of each.

        Before, `done` rows of all tiles were finished.
        """
        sweep: Sweep | None = None
        for above, below in self.store.gaps(tile.number, plan.size[0]):
            sweep = self._at(above, tile, plan, sweep)
            while (first := sweep.done) < below:
                started = perf_counter()
                last = min(below, first + plan.rows)
                within = self._within(plan, done, last - first)
                block = self._block(sweep.advance(last, progress=within), tile)
                block["seconds"] = np.array(perf_counter() - started)
                self.store.save(tile.number, (first, last), block, sweep.state())
                done += last - first
                yield last - first, perf_counter() - started

    def _at(self, row: int, tile: Tile, plan: Plan, sweep: Sweep | None) -> Sweep:
        """Return a sweep of a tile that has come to a row, from the nearest one that is known."""
        state = self.store.state(tile.number, row)
        if sweep is None or state is not None:
            reader, survey = self.pair.reader(tile.reads), self._survey(tile)
            sweep = Sweep(reader, survey, threads=plan.threads, state=state)
        while sweep.done < row:  # over bands that are finished, to one among them that is missing
            sweep.advance(min(row, sweep.done + plan.rows))
        return sweep

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

    def _seconds_a_pixel(self, columns: int, threads: int) -> float:
        """Match a small part of the pair, to see how long a pixel takes.

        It is of the middle, since the margins of strips often have no data. Which disparities are
        searched there makes no difference, so they are such as the part has.
        """
        height, width = self.pair.size
        rows, across = min(height, _SAMPLE[0]), min(width, columns, _SAMPLE[1])
        first, start = (height - rows) // 2, (width - across) // 2
        left, right, *masks = self.pair.reader((start, start + across))(first, first + rows)
        settings = replace(self.survey.settings, equalise=False)
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
        return (perf_counter() - started) / (rows * across) * share

    def _within(self, plan: Plan, done: int, rows: int) -> Progress | None:
        """Return what tells how far a band is, of so many rows after so many others."""
        if self.progress is None:
            return None
        every = plan.size[0] * len(plan.tiles)

        def progress(part: int, parts: int) -> None:
            self._tell(done + min(rows - 1, rows * part // max(parts, 1)), every)

        return progress

    def _announce(self, plan: Plan) -> None:
        if self.announce is not None:
            self.announce(plan)

    def _tell(self, done: int, rows: int) -> None:
        if self.progress is not None:
            self.progress(done, rows)

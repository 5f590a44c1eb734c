"""A pair larger than memory, from two files to another: in what order, and what comes out."""

from __future__ import annotations

import os
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from functools import partial
from numbers import Integral
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

import phasestereo
from phasestereo._extras import require
from phasestereo.banding import Sweep
from phasestereo.io.files import suffix
from phasestereo.io.windows import open_pair
from phasestereo.matcher import PRESET, Matcher
from phasestereo.matcher import match as match_whole
from phasestereo.outofcore import plan as planning
from phasestereo.outofcore.plan import COLUMNS, Plan, Tile
from phasestereo.outofcore.report import Report
from phasestereo.outofcore.sinks import DTYPES, ROWS, Sink, check_suffix
from phasestereo.outofcore.sizes import as_bytes
from phasestereo.outofcore.store import opened
from phasestereo.result import Flag, count_flags
from phasestereo.settings import Settings, resolve
from phasestereo.surveying import survey as survey_pair

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from phasestereo.equalisation import Noise
    from phasestereo.io.files import StrPath
    from phasestereo.io.windows import RasterPair
    from phasestereo.matcher import Progress
    from phasestereo.outofcore.store import Store
    from phasestereo.result import Result
    from phasestereo.surveying import Survey

_SAMPLE = (64, 2048)  # rows and columns that tell how fast this machine is


def match(
    left: StrPath,
    right: StrPath,
    output: StrPath,
    *,
    num_disparities: int,
    max_memory: int | str,
    min_disparity: int = 0,
    preset: str = PRESET,
    settings: Settings | None = None,
    threads: int | None = None,
    left_mask: StrPath | None = None,
    right_mask: StrPath | None = None,
    bands: Sequence[int] | None = None,
    noise: Noise | None = None,
    flags: StrPath | None = None,
    confidence: StrPath | None = None,
    band_rows: int | None = None,
    tile_columns: int | None = None,
    column_overlap: int = 256,
    restart: bool = False,
    announce: Callable[[Plan], object] | None = None,
    progress: Progress | None = None,
    **overrides: Any,
) -> Report:
    """Match a rectified stereo pair that need not fit into memory, from file to file.

    What comes out is what `phasestereo.match` returns for the whole pair, to the bit, unless
    ``tile_columns`` is given. The pair is matched band after band; finished bands are kept in a
    folder beside the output (``out.tif.part``), and the same call goes on from there after whatever
    ended it. The folder is removed in the end.

    Parameters
    ----------
    left, right
        Files that are read by windows: TIFF (GeoTIFF, COG, BigTIFF), Zarr arrays, ``.npy``, see
        `phasestereo.io.windows.open_raster`. Pixels without data are masked.
    output
        File for the disparities: ``.tif`` (which keeps the georeference of the left image),
        ``.npy`` or ``.zarr``; float32, NaN where there is no estimate.
    num_disparities, min_disparity, preset, settings, threads, noise, **overrides
        As `phasestereo.match` takes them.
    max_memory
        Memory that the process may have resident, all in all: bytes, or in words: "2GB", "800MiB".
    left_mask, right_mask
        Files of the images' size, read like them, not 0 where pixels are valid.
    bands
        The number of one band of TIFF files, or three for red, green and blue.
    flags, confidence
        Files for the flags (uint16) and the confidences (float32), of the same formats.
    band_rows
        Rows of a band, a multiple of 32; None: as many as the memory allows, 1024 at most.
    tile_columns
        Match tiles of so many columns, a multiple of 256, by themselves, where bands alone take too
        much memory. Then the map is approximate near the edges of tiles; the report and the tags of
        the output say so.
    column_overlap
        Columns on either side of a tile that are matched with it and left out, beyond those in
        which its candidates lie. Read with `tile_columns` alone.
    restart
        Whether to drop what an earlier run left finished. Otherwise it is gone on from, if it is of
        the same inputs, settings and version; memory, threads and rows may differ.
    announce
        Called with the `Plan` before the first band, and again with what that tells of the time.
    progress
        Called as ``progress(rows_done, rows)`` after each band, rows being those of all tiles.

    Returns
    -------
    Report
        What there is to say about the map; not the map.

    Raises
    ------
    TypeError, ValueError
        As `phasestereo.match`; for a format that is not read or written by windows; if `max_memory`
        is too little, with the amount that would do; if an earlier run of other inputs or settings
        left finished bands, and `restart` is False.
    OSError
        If a part of a file cannot be read, an output cannot be written (finished bands are kept),
        or another run with this output is at work.
    ImportError
        If filelock is not installed, or rasterio or zarr where they are needed.
    KeyboardInterrupt
        After Ctrl-C; finished bands are kept.

    Examples
    --------
    >>> ps.outofcore.match("left.tif", "right.tif", "out.tif", num_disparities=256,
    ...                    max_memory="2GB")
    """
    chosen = resolve(preset, settings, overrides)
    limit = as_bytes(max_memory, "max_memory")
    _check_whole("band_rows", band_rows, planning.ROWS)
    _check_whole("tile_columns", tile_columns, COLUMNS)
    _check_whole("column_overlap", column_overlap, 1)
    sources = [left, right, left_mask, right_mask]
    outputs = _as_outputs({"disparity": output, "flags": flags, "confidence": confidence}, sources)
    if confidence is not None and not chosen.confidence:
        raise ValueError("confidence: got a file with settings that work none out; accepts None")
    if tile_columns is None:
        column_overlap = 0
    identity = {
        "version": phasestereo.__version__,
        **{name: _identity(path) for name, path in zip(_SOURCES, sources, strict=True)},
        "bands": None if bands is None else list(bands),
        "num_disparities": num_disparities,
        "min_disparity": min_disparity,
        "settings": asdict(chosen),
        "noise": noise,
        "layers": list(outputs),
        "tile_columns": tile_columns,
        "column_overlap": column_overlap,
    }
    with ExitStack() as stack:
        pair = stack.enter_context(
            open_pair(left, right, bands=bands, left_mask=left_mask, right_mask=right_mask)
        )
        _limit_gdal(stack, pair, outputs)
        count = Matcher(settings=chosen, threads=threads).threads
        approximate = _approximation(pair, tile_columns, column_overlap)
        sinks = [
            Sink(path=path, layer=layer, size=pair.size, place=pair.left.georeference,
                 tags={} if approximate is None else {"APPROXIMATE": approximate})
            for layer, path in outputs.items()
        ]  # fmt: skip
        store = stack.enter_context(opened(outputs["disparity"], identity, restart=restart))
        for sink in sinks:
            sink.rehearse()
        survey = store.survey(
            lambda: survey_pair(
                pair.reader(),
                pair.size,
                num_disparities=num_disparities,
                min_disparity=min_disparity,
                settings=chosen,
                threads=threads,
                noise=noise,
            )
        )
        work = _Work(pair, survey, store, tuple(outputs), announce, progress)
        plan = work.planned(limit, count, band_rows, tile_columns, column_overlap)
        plan = work.run(plan)
        for sink in sinks:
            sink.write(partial(work.windows, plan, sink.layer))
        for sink in sinks:
            sink.publish()
        report = work.report(plan, outputs, approximate)
        store.discard()
    return report


_SOURCES = ("left", "right", "left_mask", "right_mask")


@dataclass(frozen=True, slots=True, eq=False)
class _Work:
    """A run between its preparation and its output."""

    pair: RasterPair
    survey: Survey
    store: Store
    layers: tuple[str, ...]
    announce: Callable[[Plan], object] | None
    progress: Progress | None

    def planned(
        self, limit: int, threads: int, rows: int | None, columns: int | None, overlap: int
    ) -> Plan:
        """Return how to match what is left to do."""
        size, search = self.pair.size, (self.survey.min_disparity, self.survey.num_disparities)
        step = 1 if columns is None else self.survey.column_step
        tiles = planning.tiles(size, search, step, columns, overlap)
        surveys = [self._survey(tile) for tile in tiles]
        rows, threads, memory = planning.fit(surveys, self.pair, limit, threads=threads, rows=rows)
        left = [size[0] - self.store.done(tile.number) for tile in tiles]
        pixels = sum(
            rest * (tile.reads[1] - tile.reads[0]) for rest, tile in zip(left, tiles, strict=True)
        )
        return Plan(
            size=size,
            num_disparities=search[1],
            tiles=tiles,
            rows=rows,
            threads=threads,
            memory=memory,
            bands=sum(-(-rest // rows) for rest in left),
            finished=sum(len(self.store.bands(tile.number)) for tile in tiles),
            seconds=pixels * self._seconds_a_pixel(threads) if pixels else 0.0,
        )

    def run(self, plan: Plan) -> Plan:
        """Match all that is not finished; return the plan with what the first band tells."""
        self._announce(plan)
        done = sum(self.store.done(tile.number) for tile in plan.tiles)
        rows = plan.size[0] * len(plan.tiles)
        self._tell(done, rows)
        for tile in plan.tiles:
            for matched, seconds in self._bands(tile, plan):
                done += matched
                self._tell(done, rows)
                if not plan.by_band and done < rows:
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

    def report(self, plan: Plan, files: dict[str, Path], approximate: str | None) -> Report:
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
            files=files,
            estimated=estimated / (plan.size[0] * plan.size[1]),
            flags=dict(zip(Flag, flags.tolist(), strict=True)),
            seconds=seconds,
            peak_memory=planning.peak(),
            approximate=approximate,
        )

    def _bands(self, tile: Tile, plan: Plan) -> Iterator[tuple[int, float]]:
        """Match the bands of a tile that are not finished; yield rows and seconds of each."""
        height = plan.size[0]
        if self.store.done(tile.number) == height:
            return
        sweep = Sweep(
            self.pair.reader(tile.reads),
            self._survey(tile),
            threads=plan.threads,
            state=self.store.state(tile.number),
        )
        while (first := sweep.done) < height:
            started = perf_counter()
            last = min(height, first + plan.rows)
            block = self._block(sweep.advance(last), tile)
            block["seconds"] = np.array(perf_counter() - started)
            self.store.save(tile.number, (first, last), block, sweep.state())
            yield last - first, perf_counter() - started

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

    def _seconds_a_pixel(self, threads: int) -> float:
        """Match a small part of the pair, to see how long a pixel takes."""
        height, width = self.pair.size
        rows = min(height, _SAMPLE[0])
        first, across = (height - rows) // 2, min(width, _SAMPLE[1])
        left, right, *masks = self.pair.reader((0, across))(first, first + rows)
        settings = replace(self.survey.settings, equalise=False)
        started = perf_counter()
        match_whole(
            left,
            right,
            num_disparities=min(self.survey.num_disparities, across),
            min_disparity=self.survey.min_disparity,
            settings=settings,
            threads=threads,
            left_mask=masks[0],
            right_mask=masks[1],
            noise=1.0 if settings.weak > 0 else None,
        )
        share = self.survey.num_disparities / min(self.survey.num_disparities, across)
        return (perf_counter() - started) / (rows * across) * share

    def _announce(self, plan: Plan) -> None:
        if self.announce is not None:
            self.announce(plan)

    def _tell(self, done: int, rows: int) -> None:
        if self.progress is not None:
            self.progress(done, rows)


def _check_whole(name: str, value: int | None, step: int) -> None:
    if value is None:
        return
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"{name}: got {type(value).__name__}; accepts an integer or None")
    if value < 1 or value % step:
        raise ValueError(f"{name}: got {value}; accepts multiples of {step}")


def _as_outputs(
    paths: dict[str, StrPath | None], sources: Sequence[StrPath | None]
) -> dict[str, Path]:
    """Return the outputs that are asked for by their layer, if they can all be written."""
    taken = {os.path.realpath(path) for path in sources if path is not None}
    outputs = {layer: Path(path) for layer, path in paths.items() if path is not None}
    for layer, path in outputs.items():
        name = "output" if layer == "disparity" else layer
        check_suffix(path, name)
        if os.path.realpath(path) in taken:
            raise ValueError(f"{name}: {path} is in use already; accepts another file")
        taken.add(os.path.realpath(path))
    return outputs


def _identity(path: StrPath | None) -> dict[str, Any] | None:
    """Return what tells whether a file is the same as before: its name, size and time."""
    if path is None:
        return None
    place = Path(os.path.realpath(path))
    files = [place] if place.is_file() else [file for file in place.rglob("*") if file.is_file()]
    found = [file.stat() for file in files] or [place.stat()]
    return {
        "path": str(place),
        "size": sum(each.st_size for each in found),
        "time": max(each.st_mtime_ns for each in found),
    }


def _limit_gdal(stack: ExitStack, pair: RasterPair, outputs: dict[str, Path]) -> None:
    """Have GDAL keep no more blocks than it takes; by itself it keeps a share of all memory."""
    names: list[StrPath] = [*(raster.path for raster in pair.rasters), *outputs.values()]
    if any(suffix(name) in (".tif", ".tiff") for name in names):
        rasterio = require("rasterio", extra="geo")
        stack.enter_context(rasterio.Env(GDAL_CACHEMAX=planning.cache(pair)))


def _approximation(pair: RasterPair, columns: int | None, overlap: int) -> str | None:
    if columns is None or columns >= pair.size[1]:
        return None
    return f"matched in tiles of {columns} columns that overlap by {overlap}"

"""Match a pair larger than memory from two files to another: the steps, and their result."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Unpack

from phasestereo._extras import require
from phasestereo._numbers import as_integer
from phasestereo._opening import Progress
from phasestereo.io.files import StrPath, suffix
from phasestereo.known import Known, as_known
from phasestereo.matching import Matcher
from phasestereo.result import LAYERS
from phasestereo.settings import PresetName, Settings, SettingsOverrides, resolve
from phasestereo_large.bands import pair_statistics
from phasestereo_large.outofcore import plan as planning
from phasestereo_large.outofcore.plan import Plan
from phasestereo_large.outofcore.report import MapReport
from phasestereo_large.outofcore.request import Request, as_outputs
from phasestereo_large.outofcore.sinks import Sink
from phasestereo_large.outofcore.sizes import as_bytes
from phasestereo_large.outofcore.store import Store, opened
from phasestereo_large.outofcore.work import Work
from phasestereo_large.statistics import PairStatistics
from phasestereo_large.windows import RasterPair, open_pair


def match(
    left: StrPath,
    right: StrPath,
    output: StrPath,
    *,
    num_disparities: int,
    max_memory: int | str,
    min_disparity: int = 0,
    preset: PresetName | None = None,
    settings: Settings | None = None,
    threads: int | None = None,
    left_mask: StrPath | None = None,
    right_mask: StrPath | None = None,
    bands: Sequence[int] | None = None,
    known: Known | None = None,
    flags_output: StrPath | None = None,
    confidence_output: StrPath | None = None,
    uncertainty_output: StrPath | None = None,
    band_rows: int | None = None,
    restart: bool = False,
    announce: Callable[[Plan], object] | None = None,
    progress: Progress | None = None,
    stage: Callable[[str], object] | None = None,
    **overrides: Unpack[SettingsOverrides],
) -> MapReport:
    """Match a rectified stereo pair from file to file, even if it does not fit into memory.

    The result equals that of `phasestereo.match` with ``scales=False`` for the whole pair, to the
    bit. The run matches the pair in separate bands, and keeps finished bands in a folder next to
    the output (``out.tif.part``); after an interruption, the same call matches the others. The run
    removes the folder at the end.

    Parameters
    ----------
    left, right
        Files to read by windows: TIFF (GeoTIFF, COG, BigTIFF), Zarr arrays, ``.npy``, see
        `phasestereo_large.windows.open_raster`. Pixels without data are masked.
    output
        File for the disparities: ``.tif`` (which keeps the georeference of the left image),
        ``.npy`` or ``.zarr``; float32, NaN without an estimate.
    num_disparities, min_disparity, preset, settings, threads, known, **overrides
        As in `phasestereo.match`; only the noise of `known` counts.
    max_memory
        Total resident memory that the process may take: bytes, or in words: "2GB", "800MiB".
    left_mask, right_mask
        Files as large as the images, in one of their formats, not 0 at valid pixels.
    bands
        The number of one band of TIFF files, or three for red, green and blue.
    flags_output, confidence_output, uncertainty_output
        Files for the flags (uint16), the confidences and the error bars (float32), in the same
        formats.
    band_rows
        Rows of a band; None: the most that the memory allows, up to 2048. A band's match includes
        rows around it (`phasestereo_large.halo`), so small bands take longer in total.
    restart
        Whether to drop the finished bands of an earlier run. Otherwise this run continues it, if
        inputs, settings and version are the same; memory, threads and rows may differ.
    announce
        Called with the `Plan` before the first band, and again after it, with an estimate that
        includes the time it took.
    progress
        Called as ``progress(rows_done, rows)`` every now and then and after each band; its
        exceptions end the run.
    stage
        Called with a description of each stage other than matching bands: the statistics of the
        whole pair, the assembly of the outputs, and finished work of an earlier run that is missing
        or damaged, so that this run does it again.

    Returns
    -------
    MapReport
        A report about the map; not the map.

    Raises
    ------
    TypeError, ValueError
        As in `phasestereo.match`; for a format without reading or writing by windows; if
        `max_memory` is too little (the message names a sufficient amount); if an earlier run with
        other inputs or settings left finished bands, and `restart` is False.
    OSError
        If a part of a file cannot be read, an output cannot be written (finished bands stay), or
        another run with this output is at work.
    ImportError
        If filelock is not installed, or if rasterio or zarr is needed and not installed.
    KeyboardInterrupt
        After Ctrl-C; finished bands stay.

    Examples
    --------
    >>> outofcore.match("left.tif", "right.tif", "out.tif", num_disparities=256,
    ...                 max_memory="2GB")
    """
    limit = as_bytes(max_memory, "max_memory")
    if band_rows is not None:
        as_integer("band_rows", band_rows, least=1)

    sources = left, right, left_mask, right_mask
    layers = flags_output, confidence_output, uncertainty_output
    outputs: dict[str, StrPath | None] = {"disparity": output}
    outputs |= zip(LAYERS, layers, strict=True)
    request = Request(
        sources=sources,
        outputs=as_outputs(outputs, sources),
        settings=resolve(preset, settings, overrides),
        min_disparity=min_disparity,
        num_disparities=num_disparities,
        known=as_known(known, unused=("blur_compensation",)),
        bands=bands,
    )

    # A matcher refuses wrong settings and threads before this opens any file.
    count = Matcher(settings=request.settings, threads=threads).threads
    begin = stage or (lambda _: None)
    with _prepared(request, limit, count, begin, restart=restart) as (
        pair,
        statistics,
        store,
        sinks,
    ):
        work = Work(pair, statistics, store, tuple(request.outputs), announce, progress)
        plan = work.match_bands(work.planned(limit, count, band_rows))

        # Write all outputs and read them back before the first one gets its name.
        begin("putting the output together")
        for sink in sinks:
            sink.write(partial(work.windows, sink.layer))
        for sink in sinks:
            sink.publish()

        report = work.report(plan, request)
        store.discard()
    return report


@contextmanager
def _prepared(
    request: Request, limit: int, threads: int, begin: Callable[[str], object], *, restart: bool
) -> Iterator[tuple[RasterPair, PairStatistics, Store, list[Sink]]]:
    """Open the pair and its finished bands, try the outputs, and make the statistics."""
    left, right, left_mask, right_mask = request.sources
    with ExitStack() as stack:
        pair = stack.enter_context(
            open_pair(
                left,
                right,
                bands=request.bands,
                left_mask=left_mask,
                right_mask=right_mask,
                max_bytes=limit,
            )
        )

        _limit_gdal(stack, pair, request.outputs)
        output = request.outputs["disparity"]
        store = stack.enter_context(opened(output, request.identity(), restart=restart))
        for reason in store.again:
            begin(reason)

        # Refuse an output that cannot be written before hours of matching, not after.
        sinks = _sinks(request, pair)
        for sink in sinks:
            sink.rehearse()

        found = store.pair_statistics(partial(_gathered, request, pair, threads, begin))
        yield pair, found, store, sinks


def _gathered(
    request: Request, pair: RasterPair, threads: int, begin: Callable[[str], object]
) -> PairStatistics:
    begin("looking at the whole pair")
    return pair_statistics(
        pair.reader(),
        pair.size,
        num_disparities=request.num_disparities,
        min_disparity=request.min_disparity,
        settings=request.settings,
        threads=threads,
        known=request.known,
    )


def _sinks(request: Request, pair: RasterPair) -> list[Sink]:
    # Runs may share some outputs; the first output has the lock, so its name makes drafts unique.
    first = os.path.realpath(request.outputs["disparity"])
    run = hashlib.sha256(os.fsencode(first)).hexdigest()[:8]

    return [
        Sink(
            path=path,
            layer=layer,
            size=pair.size,
            place=pair.left.georeference,
            run=run,
        )
        for layer, path in request.outputs.items()
    ]


def _limit_gdal(stack: ExitStack, pair: RasterPair, outputs: Mapping[str, Path]) -> None:
    """Limit GDAL's cache to the blocks that it needs: by default it is a share of memory."""
    writes = any(suffix(path) in (".tif", ".tiff") for path in outputs.values())
    if writes or any(raster.by_gdal for raster in pair.rasters):
        rasterio = require("rasterio", extra="geo")
        stack.enter_context(rasterio.Env(GDAL_CACHEMAX=planning.cache(pair)))

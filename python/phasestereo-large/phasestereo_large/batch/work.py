"""Do the work for one pair: read, match, write, and record the outcome."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
import socket
import traceback
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from phasestereo import _core
from phasestereo._images import join_masks
from phasestereo.io.files import describe_error
from phasestereo.io.image import read_mask
from phasestereo.io.results import write_map
from phasestereo.io.views import read_views
from phasestereo.matching import match_silently
from phasestereo.result import Result
from phasestereo.rig.findings import untrusted
from phasestereo.settings import Settings
from phasestereo_large.batch.manifest import DONE, FAILED, Record
from phasestereo_large.batch.pairs import PairFiles
from phasestereo_large.geotiff import Georeference

_FULL = (errno.ENOSPC, errno.EDQUOT)
_EXPECTED = (OSError, ValueError, TypeError, MemoryError, RuntimeError, ImportError)
"""Errors that one line describes well enough; any other error also needs its origin."""


class FullDiskError(OSError):
    """The disk is full, so all following pairs would fail, too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """The settings and outputs that all pairs of a run share.

    Parameters
    ----------
    settings
        The settings of the matches.
    folder
        The folder for results.
    suffix
        The format of disparities, by its suffix.
    layers
        The layers to write beside them, from `phasestereo.result.LAYERS`.
    threads
        Number of threads per match.
    seconds
        Time limit for a pair; None: no limit.
    version
        Version of this package in the process that started the run; workers must have the same.
    """

    settings: Settings
    folder: Path
    suffix: str
    layers: tuple[str, ...]
    threads: int
    seconds: float | None = None
    version: str = _core.__version__

    def recipe(self, pair: PairFiles) -> str:
        """Return a digest of everything that a result depends on, even if a file is missing."""
        parts = {
            "version": self.version,
            "settings": asdict(self.settings),
            "outputs": [self.suffix, *self.layers],
            "disparities": [pair.min_disparity, pair.num_disparities],
            "masks": [pair.left_mask is not None, pair.right_mask is not None],
            "files": [_identity(path) for path in pair.files],
        }
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:32]


def version() -> str:
    """Return the version of this package in a worker."""
    return _core.__version__


def blank(pair: PairFiles, recipe: str, reason: str) -> Record:
    """Return the record for a pair that failed."""
    return Record(
        name=pair.name,
        state=FAILED,
        left=str(pair.left),
        right=str(pair.right),
        num_disparities=pair.num_disparities,
        min_disparity=pair.min_disparity,
        recipe=recipe,
        reason=" ".join(reason.split()),
    )


def match_files(pair: PairFiles, order: Order, recipe: str) -> Record:
    """Match a pair and write its result; the record holds any error.

    Raises
    ------
    FullDiskError
        If there is no space for the result.
    """
    started = perf_counter()
    try:
        record = _matched(pair, order, recipe)
    except FullDiskError:
        raise
    except _EXPECTED as error:
        record = blank(pair, recipe, describe_error(error))
    except Exception as error:  # noqa: BLE001 -- one pair must not end the whole run
        place = traceback.extract_tb(error.__traceback__)[-1]
        record = blank(pair, recipe, f"{error!r} in {place.filename}, line {place.lineno}")

    here = f"{socket.gethostname()}:{os.getpid()}"
    return replace(record, seconds=round(perf_counter() - started, 4), worker=here)


def _matched(pair: PairFiles, order: Order, recipe: str) -> Record:
    if order.version != _core.__version__:  # a worker that joined after the run began
        raise RuntimeError(
            f"the worker has phasestereo {_core.__version__}; accepts {order.version}"
        )

    in_time = _clock(order.seconds)

    left, right = read_views(pair.left, pair.right)
    masks = read_mask(pair.left_mask), read_mask(pair.right_mask)

    result = match_silently(
        (left.image, right.image),
        (join_masks(masks[0], left.mask), join_masks(masks[1], right.mask)),
        (pair.min_disparity, pair.num_disparities),
        settings=order.settings,
        threads=order.threads,
        progress=in_time,
    )

    # Writing also takes time, and a match that ended late has no time left.
    in_time()

    rows, cols = result.disparity.shape
    searched = result.search

    return replace(
        blank(pair, recipe, ""),
        num_disparities=searched.num_disparities if searched else pair.num_disparities,
        min_disparity=searched.min_disparity if searched else pair.min_disparity,
        state=DONE,
        reason=None,
        width=cols,
        height=rows,
        estimated=round(float(np.isfinite(result.disparity).mean()), 6),
        blur=None if result.blur is None else str(result.blur),
        doubt="; ".join(found.sentence for found in untrusted(result.findings)) or None,
        files=_write(pair.name, order, result, left.place),
    )


def _clock(seconds: float | None) -> Callable[..., None]:
    """Return the progress callback that ends a match after its time limit."""
    end = float("inf") if seconds is None else perf_counter() + seconds

    def in_time(*_: int) -> None:
        if perf_counter() > end:
            raise TimeoutError(f"took longer than {seconds:g} s")

    return in_time


def _write(name: str, order: Order, result: Result, place: Georeference | None) -> dict[str, int]:
    """Write the layers, the disparities last; return the lengths of the files."""
    files = {f"{name}.{layer}.tif": layer for layer in order.layers}
    files[f"{name}{order.suffix}"] = "disparity"

    for file, layer in files.items():
        values = getattr(result, layer)
        try:
            write_map(order.folder / file, layer, values, place)
        except OSError as error:
            message = f"{order.folder / file} cannot be written: {error.strerror or error}"
            if error.errno in _FULL:
                raise FullDiskError(message) from error
            # Some libraries raise their own error for a full disk.
            if shutil.disk_usage(order.folder).free < values.nbytes:
                raise FullDiskError(f"{message}: {os.strerror(errno.ENOSPC)}") from error
            raise OSError(message) from error

    return {file: (order.folder / file).stat().st_size for file in files}


def _identity(path: Path) -> list[Any]:
    try:
        state = path.stat()
    except (OSError, ValueError):  # such as for a path with a null byte
        return [str(path)]  # the worker will report what is wrong with it
    return [str(path), state.st_size, state.st_mtime_ns]

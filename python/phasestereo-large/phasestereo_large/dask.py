"""Match Dask arrays lazily: bands of rows, one task each, on any of Dask's schedulers.

Together, the bands equal the result of `phasestereo.match` with ``scales=False`` for the whole
pair, bit for bit. Dask (extra ``dask``) is imported on first use.
"""

from __future__ import annotations

from dataclasses import fields, replace
from functools import partial
from typing import Any, NamedTuple, TypeAlias, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo import _core
from phasestereo._core import MOST_DISPARITIES
from phasestereo._extras import require
from phasestereo._images import as_pair
from phasestereo._numbers import as_integer, check_type
from phasestereo.known import Known
from phasestereo.result import MAPS, maps_with
from phasestereo.settings import PresetName, Settings, SettingsOverrides, resolve
from phasestereo_large.bands import match_rows, pair_statistics
from phasestereo_large.statistics import PairStatistics

Array: TypeAlias = Any  # dask.array.Array, whose package has no types

__all__ = ["Maps", "maps", "match"]

_BAND_ROWS = 512
"""Rows of a band: enough that the start of a task hardly counts."""
_HALOS = 4
"""Smallest ratio of a band's rows to those of its halo, which are matched twice."""


class Maps(NamedTuple):
    """The lazy maps of a pair, all computed by the same tasks.

    Attributes
    ----------
    disparity
        Dask array, float32 (H, W), like `phasestereo.Result.disparity`.
    flags
        Dask array, uint16 (H, W), bits of `phasestereo.Flag`.
    confidence
        Dask array, float32 (H, W); None if the settings have ``confidence=False``.
    uncertainty
        Dask array, float32 (H, W), pixels, like `phasestereo.Result.uncertainty`; or None.
    """

    disparity: Array
    flags: Array
    confidence: Array | None = None
    uncertainty: Array | None = None


def match(left: Array, right: Array, **arguments: Any) -> Array:
    """Match a rectified stereo pair lazily; return only the disparities of `maps`.

    Parameters
    ----------
    left, right, **arguments
        As in `maps`.

    Returns
    -------
    dask.array.Array
        The disparities, float32 (H, W), pixels; NaN without an estimate. Its chunks are bands of
        rows.

    Raises
    ------
    TypeError, ValueError, ImportError
        As `maps`.

    Examples
    --------
    >>> left, right = da.from_zarr("left.zarr"), da.from_zarr("right.zarr")
    >>> found = dask.match(left, right, num_disparities=256)
    >>> found.to_zarr("disparity.zarr")
    """
    return maps(left, right, **arguments).disparity


def maps(
    left: Array,
    right: Array,
    *,
    num_disparities: int | None = None,
    min_disparity: int = 0,
    preset: PresetName | None = None,
    settings: Settings | None = None,
    threads: int = 1,
    left_mask: Array | ArrayLike | None = None,
    right_mask: Array | ArrayLike | None = None,
    known: Known | None = None,
    statistics: PairStatistics | None = None,
    band_rows: int | None = None,
    **overrides: Unpack[SettingsOverrides],
) -> Maps:
    """Match a rectified stereo pair lazily; the chunks of the result are bands of rows.

    Each band is one task. For any chunks of the images, it gets its own rows and the rows above and
    below that its disparities depend on; nothing holds a whole image. Together, the bands equal the
    result of `phasestereo.match` with ``scales=False``, bit for bit.

    Matching needs facts about the whole pair (its blur and noise, the range of float images). The
    function finds them **at the call**, window by window, unless ``statistics`` has them: it then
    computes every pixel up to four times now, and the tasks compute it once. With ``preset="fast"``
    and integer images it computes those of the left one once more; it computes all rows twice, for
    black borders and overlays.

    Parameters
    ----------
    left, right
        Dask arrays of the shapes that `phasestereo.match` takes: (H, W) or (H, W, 1, 3 or 4), with
        equal size and dtype, with any chunks; chunks of a few hundred whole rows cost least.
    num_disparities, min_disparity, preset, settings, known, **overrides
        As in `phasestereo.match`, `known` without ``before``.
    threads
        Threads per task. Default 1, since Dask runs one task on each of its threads.
    left_mask, right_mask
        Dask arrays, or arrays, bool (H, W), True = valid.
    statistics
        The result of `pair_statistics` for this pair, with these settings.
    band_rows
        Rows of a band, which is always at least as high as its halo. None: 512, or four halos.

    Returns
    -------
    Maps
        Disparities, flags, confidences and error bars. If you compute them together
        (``dask.compute(*found)``), each band is matched once.

    Raises
    ------
    TypeError
        If an image is not a Dask array, or as `phasestereo.match`.
    ValueError
        As `phasestereo.match`; for chunks of unknown size or statistics of another pair, search or
        settings.
    ImportError
        If Dask is not installed.
    """
    da = require("dask.array", extra="dask")
    _check_images(left, right, da)

    size = left.shape[:2]
    masks = _as_mask(left_mask, size, "left_mask"), _as_mask(right_mask, size, "right_mask")
    sides = _Sides(left, right, *masks)
    asked = resolve(preset, settings, overrides)
    as_integer("threads", threads, least=1)
    if band_rows is not None:
        as_integer("band_rows", band_rows, least=1)
    if num_disparities is not None:
        as_integer("num_disparities", num_disparities, least=1, most=min(size[1], MOST_DISPARITIES))

    if statistics is None:
        statistics = pair_statistics(
            _LazyRows(sides),
            size,
            num_disparities=num_disparities,
            min_disparity=min_disparity,
            settings=asked,
            known=known,
        )
    else:
        _check_statistics(statistics, size, (min_disparity, num_disparities))
        _check_settings(statistics, asked, (left.dtype.name, right.dtype.name))

    # One task matches a band and returns a record for each pixel; layers are fields of it.
    halo = _halo(statistics, masked=any(mask is not None for mask in masks))
    bands = _bands(size[0], band_rows, halo)
    table = _table(sides, statistics, bands, halo, threads)
    return Maps(**{name: _layer(table, name) for name in table.dtype.names})


class _Sides(NamedTuple):
    """Both images and both masks: lazy ones, or the rows that a task gets."""

    left: Any
    right: Any
    left_mask: Any = None
    right_mask: Any = None


class _LazyRows:
    """Rows of a lazy pair, computed on request."""

    def __init__(self, sides: _Sides) -> None:
        self._sides = sides

    def __call__(self, first: int, last: int, /) -> Any:
        """Compute and return the rows [first, last) of the images and masks."""
        rows = [None if side is None else side[first:last] for side in self._sides]
        return require("dask", extra="dask").compute(*rows)


class _Excerpt:
    """The rows of a pair that a task received."""

    def __init__(self, sides: _Sides, start: int) -> None:
        self._sides, self._start = sides, start

    def __call__(self, first: int, last: int, /) -> Any:
        """Return views of the rows [first, last) of the images and masks."""
        rows = slice(first - self._start, last - self._start)
        if rows.start < 0 or rows.stop > len(self._sides.left):
            raise IndexError(f"rows {first} to {last} of an excerpt that begins at {self._start}")

        return tuple(None if side is None else side[rows] for side in self._sides)


def _check_images(left: Array, right: Array, da: Any) -> None:
    for name, image in (("left", left), ("right", right)):
        check_type(name, image, da.Array, "a Dask array, as da.from_array makes it")
        _check_chunks(image, name)
        if image.ndim not in (2, 3) or image.shape[2:] not in ((), (1,), (3,), (4,)):
            raise ValueError(
                f"{name}: got shape {image.shape}; accepts (H, W), (H, W, 1), (H, W, 3), (H, W, 4)"
            )

    sizes = left.shape[:2], right.shape[:2]
    if sizes[0] != sizes[1]:
        raise ValueError(f"right: got {sizes[1]} pixels; accepts the size of left, {sizes[0]}")

    # Matching one row of each raises all other errors in the arguments.
    rows = [np.zeros((min(1, len(side)), *side.shape[1:]), side.dtype) for side in (left, right)]
    as_pair(*rows)


def _check_chunks(array: Array, name: str) -> None:
    if any(np.isnan(length) for length in array.shape):
        raise ValueError(
            f"{name}: got chunks of unknown sizes; accepts known ones, as its method "
            "compute_chunk_sizes finds them"
        )


def _as_mask(mask: Array | ArrayLike | None, size: tuple[int, int], name: str) -> Array | None:
    if mask is None:
        return None
    lazy = require("dask.array", extra="dask").asarray(mask)
    _check_chunks(lazy, name)
    if lazy.dtype != np.bool_:
        raise TypeError(f"{name}: got dtype {lazy.dtype}; accepts bool (True = valid)")
    if lazy.shape != size:
        raise ValueError(f"{name}: got shape {lazy.shape}; accepts the image's {size}")

    return lazy


def _check_statistics(
    statistics: PairStatistics, size: tuple[int, int], search: tuple[int, int | None]
) -> None:
    if statistics.size != size:
        raise ValueError(
            f"statistics: got that of {statistics.size} pixels; accepts that of {size}"
        )

    known = statistics.min_disparity, statistics.num_disparities
    if search[1] is not None and known != search:
        raise ValueError(
            f"statistics: got that of {known[1]} disparities from {known[0]}; accepts that of "
            f"{search[1]} from {search[0]}"
        )


def _check_settings(statistics: PairStatistics, asked: Settings, types: tuple[str, str]) -> None:
    """Refuse statistics whose settings differ from the requested ones."""
    if statistics.dtype not in types:
        raise TypeError(f"statistics: got that of {statistics.dtype}; accepts that of {types[0]}")

    if statistics.is_compensated:  # then the blur found changed these of the requested settings
        sides = "neighborhood", "window"
        asked = replace(asked, **{name: getattr(statistics.settings, name) for name in sides})

    if statistics.settings != asked:
        names = [field.name for field in fields(asked)]
        others = [n for n in names if getattr(statistics.settings, n) != getattr(asked, n)]
        raise ValueError(
            f"statistics: got that with another {', '.join(others)}; accepts that with the "
            "settings of this match"
        )


def _halo(statistics: PairStatistics, *, masked: bool) -> int:
    """Return the largest number of rows above and below a band that `match_rows` reads."""
    around, copied = _core.halo(
        statistics.settings, statistics.blur_compensation, statistics.alignment
    )
    return around + (copied if masked else 0)


def _bands(height: int, band_rows: int | None, halo: int) -> tuple[int, ...]:
    """Return the rows of each band: no fewer than its neighbors need from it."""
    step = _core.BAND_ROWS
    wanted = band_rows or step * -(-max(_BAND_ROWS, _HALOS * halo) // step)
    rows = min(max(wanted, halo), height)

    count, rest = divmod(height, rows)
    if not rest:
        return (rows,) * count
    if rest >= halo:
        return (rows,) * count + (rest,)
    return (rows,) * (count - 1) + (rows + rest,)  # the rest has fewer rows than its neighbor needs


def _table(
    sides: _Sides,
    statistics: PairStatistics,
    bands: tuple[int, ...],
    halo: int,
    threads: int,
) -> Array:
    """Return an array (H, W) of records, which hold all maps of a pixel, one task per band."""
    da = require("dask.array", extra="dask")
    delayed = require("dask", extra="dask").delayed
    # Send the first and the last row of each band with its pixels, as a separate block.
    ends = np.cumsum(bands)
    rows = da.from_array(np.column_stack([ends - bands, ends]), chunks=(1, 2))
    arguments: list[Any] = [rows, "yb"]

    for side, axes in zip(sides, ("yxc", "yxc", "yx", "yx"), strict=True):
        if side is None:
            arguments += [None, None]
        else:
            arguments += [_with_halo(side, bands, halo), axes[: side.ndim]]

    dtype = _record(statistics.settings)
    return da.blockwise(
        _match_band,
        "yx",
        *arguments,
        statistics=delayed(statistics, pure=True),  # sent to each worker only once
        threads=threads,
        halo=halo,
        adjust_chunks={"y": bands},
        align_arrays=False,
        concatenate=True,
        dtype=dtype,
        meta=np.empty((0, 0), dtype),
        token="phasestereo-band",  # noqa: S106 -- a name for tasks
    )


def _with_halo(side: Array, bands: tuple[int, ...], halo: int) -> Array:
    """Return an array whose chunks are bands of whole rows with the halo above and below them."""
    banded = side.rechunk({0: bands, **dict.fromkeys(range(1, side.ndim), -1)})
    if len(bands) == 1:
        return banded
    overlapping = require("dask.array.overlap", extra="dask").overlap
    return overlapping(banded, depth={0: halo}, boundary="none", allow_rechunk=False)


def _record(settings: Settings) -> np.dtype[np.void]:
    return np.dtype([(name, MAPS[name].dtype) for name in maps_with(settings)])


def _match_band(
    rows: NDArray[np.int64],
    *sides: NDArray[Any] | None,
    statistics: PairStatistics,
    threads: int,
    halo: int,
) -> NDArray[np.void]:
    """Match one band: the work of a task."""
    first, last = rows[0].tolist()
    read = _Excerpt(_Sides(*sides), max(0, first - halo))
    result = match_rows(read, statistics, first, last, threads=threads)

    found = np.empty(result.disparity.shape, _record(statistics.settings))
    for name in found.dtype.names or ():
        found[name] = getattr(result, name)
    return found


def _layer(table: Array, name: str) -> Array:
    dtype = table.dtype[name]
    return table.map_blocks(
        partial(_field, name=name), dtype=dtype, meta=np.empty((0, 0), dtype), name=None
    )


def _field(block: NDArray[np.void], *, name: str) -> NDArray[Any]:
    return np.ascontiguousarray(block[name])  # a view would keep all fields in memory

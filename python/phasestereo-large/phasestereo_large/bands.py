"""Match bands of rows of a pair separately, in any order; together they equal the whole.

All parts must share some facts, or they would not fit together: the relative blur and its map, the
noise, the type that holds all values and their range, the differences of neighboring gray values,
the confidence of the match in some rows. `pair_statistics` gathers them, a few rows at a time.

Every other step from images to disparities depends on only a limited number of rows up and down
(`halo`). So a band matched together with its halo equals that part of the whole pair, to the bit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo import _core
from phasestereo._images import Mask, Pixels, as_pair, as_seen, join_masks
from phasestereo._numbers import as_integer, check_callable, check_type
from phasestereo.known import Known, as_known
from phasestereo.result import Result
from phasestereo.rig.alignment import Alignment
from phasestereo.rig.compensation import BlurCompensation
from phasestereo.settings import PresetName, Settings, SettingsOverrides, resolve
from phasestereo_large.statistics import Borders, PairStatistics, Rectangle, as_size, load

Rows: TypeAlias = tuple[ArrayLike, ArrayLike, ArrayLike | None, ArrayLike | None]
Reader: TypeAlias = Callable[[int, int], Rows]
Progress: TypeAlias = Callable[[int, int], object]

__all__ = ["PairStatistics", "halo", "load", "match_rows", "pair_statistics", "working_memory"]


def pair_statistics(
    read: Reader,
    size: tuple[int, int],
    *,
    num_disparities: int | None = None,
    min_disparity: int = 0,
    preset: PresetName | None = None,
    settings: Settings | None = None,
    threads: int | None = None,
    known: Known | None = None,
    **overrides: Unpack[SettingsOverrides],
) -> PairStatistics:
    """Gather the statistics of a whole pair; memory does not grow with its height.

    Parts are matched at one scale: they equal the result of `phasestereo.match` with
    ``scales=False``, to the bit.

    Parameters
    ----------
    read
        Called as ``read(first, last)``, several times, for a few hundred rows at a time; returns
        the rows [first, last) of both images and of their masks, ``(left, right, left_mask,
        right_mask)``, as in `phasestereo.match`; a mask may be None. Other threads than the
        caller's call it, one call at a time. Its exceptions pass unchanged.
    size
        Rows and columns of either image.
    num_disparities, min_disparity, preset, settings, threads, known, **overrides
        As in `phasestereo.match`, `known` without ``before``.

    Returns
    -------
    PairStatistics
        Only what the settings need. The function always reads a few rows. It reads the pair two or
        three times, with 16 bits once more, for the blur and the noise (``compensate_blur``,
        ``despike``, ``denoise`` or ``noise_threshold > 0``), a few times for the rows
        (``align_rows``), once for the range (``num_disparities=None``), once for findings, once for
        overlays, once for black borders, three times if there may be some, once for
        ``adaptive_p2``, ``synthesis``, ``guided_median`` or confidences, once for float images,
        once if all values may fit a narrower type or all channels may be equal. For confidences it
        matches some rows: all up to 768, otherwise three bands of 96 and their halos.

    Raises
    ------
    TypeError, ValueError, MemoryError, KeyboardInterrupt
        As `phasestereo.match`.
    """
    told = as_known(known)

    # Parts are matched at one scale: they do not know the smaller copies of the whole pair.
    asked = replace(resolve(preset, settings, overrides), scales=False)
    rows = Checked(read, as_size(size))

    (left, right), masks = rows(0, 1)
    dtype = left.dtype
    search = min_disparity, num_disparities
    # It has its own workers: a shared one would wait for a reader that matches.
    workers = _core.Workers(threads)
    # The core owns the ranges of arguments: it refuses one row for the same reasons as all rows.
    plain = replace(asked, align_rows=False)
    _core.estimate_pair((left, right), masks, search, plain, workers, self_rectify=False)

    borders = _core.find_borders(rows, rows.size, search)
    rows.borders = borders[0][1], borders[1][1]
    if any(border is not None for border in rows.borders):
        (left, right), masks = rows(0, 1)

    scale = _core.find_scale((left, right), masks, rows, rows.size, search)

    rows.overlays = tuple(_core.find_overlays(rows, rows.size, search, scale))

    shares = borders[0][0], borders[1][0]
    found = _core.estimate_pair_by_rows(
        rows, rows.size, search, asked, scale, workers, told, shares, rows.overlays
    )

    roughness = None
    looks = asked.guided_median or asked.synthesis or asked.confidence
    if looks or asked.adaptive_p2 > 0 or asked.min_confidence > 0:
        impulses = found.blur_compensation.impulses[0] if found.blur_compensation else 0.0
        roughness = _core.find_roughness(rows, rows.size, search, scale, impulses)

    statistics = PairStatistics(
        size=rows.size,
        dtype=dtype.name,
        min_disparity=found.search.min_disparity,
        num_disparities=found.search.num_disparities,
        settings=found.settings,
        blur_compensation=found.blur_compensation or told.compensation,
        blur=found.blur,
        alignment=found.alignment,
        search=found.search,
        packing=scale.packing,
        ranges=scale.ranges,
        borders=rows.borders,
        overlays=rows.overlays,
        roughness=roughness,
        findings=found.findings,
    )
    if asked.confidence or asked.min_confidence > 0:
        return replace(statistics, tally=_tally(rows, statistics, workers))
    return statistics


def _tally(
    rows: Checked, statistics: PairStatistics, workers: _core.Workers
) -> tuple[int, int, int, int, int]:
    """Return the sums that all confidences depend on, from the rows that the core chooses."""
    tallies = []
    for first, last in _core.rows_to_tally(statistics.size[0]):
        images, masks, top = _with_halo(rows, statistics, first, last)
        _, tally = _core.match_raw(images, masks, statistics, top, (first, last), workers)
        tallies.append(tally)

    confidence, own, failed, ends, pixels = (sum(counts) for counts in zip(*tallies, strict=True))
    return confidence, own, failed, ends, pixels


def halo(
    settings: Settings,
    blur_compensation: BlurCompensation | None = None,
    alignment: Alignment | None = None,
) -> int:
    """Return the largest number of rows above and below a band that its match depends on.

    Parameters
    ----------
    settings
        The settings.
    blur_compensation
        The kernels for the images that the match compares; None: unchanged images. Those of a
        `PairStatistics` belong to its settings.
    alignment
        The alignment of the rows; if the match applies it, the halo includes its largest offset and
        a margin. None: rows correspond.

    Returns
    -------
    int
        Rows of the images: those that the window, the neighborhood and the kernels cover, and those
        that speckles, filling, smoothing and confidences use; with ``optimizer="sgm"`` also those
        where the paths from above and below start. A row without any valid pixel copies another
        one, up to 95 rows away; if there are such rows, `match_rows` reads that many more.

    Raises
    ------
    TypeError
        If an argument has the wrong type.
    """
    check_type("settings", settings, Settings, "Settings")

    around, _ = _core.halo(settings, blur_compensation, alignment)
    return around


def match_rows(
    read: Reader,
    statistics: PairStatistics,
    first: int,
    last: int,
    *,
    threads: int | _core.Workers | None = None,
    progress: Progress | None = None,
) -> Result:
    """Match the rows [first, last) of a pair separately, with any settings.

    Parameters
    ----------
    read
        As in `pair_statistics`; called for these rows and those around them.
    statistics
        The statistics of the whole pair.
    first, last
        The rows, half-open. Memory grows with the number of rows.
    threads
        As in `phasestereo.match`.
    progress
        As in `phasestereo.match`; counts the rows to match, including those around the band.

    Returns
    -------
    Result
        For these rows only, without the pair: the same bits as in these rows of the whole.

    Raises
    ------
    TypeError, ValueError, MemoryError, KeyboardInterrupt
        As in `phasestereo.match`; ValueError also if the pair does not have these rows.
    """
    check_type("statistics", statistics, PairStatistics, "a PairStatistics")
    check_callable("progress", progress)

    rows = Checked(read, statistics.size, statistics.dtype, statistics.borders, statistics.overlays)
    as_integer("first", first, least=0, most=statistics.size[0] - 1)
    as_integer("last", last, least=first + 1, most=statistics.size[0])

    images, masks, top = _with_halo(rows, statistics, first, last)
    return _core.match_rows(images, masks, statistics, top, (first, last), threads, progress)


def _with_halo(
    rows: Checked, statistics: PairStatistics, first: int, last: int
) -> tuple[tuple[Pixels, Pixels], tuple[Mask | None, Mask | None], int]:
    """Return rows of images and masks with all rows that they depend on, and the first row."""
    around, masked = _core.halo(
        statistics.settings, statistics.blur_compensation, statistics.alignment
    )
    top, bottom = _widened(first, last, around, statistics)
    images, masks = rows(top, bottom)

    # Rows without a valid pixel copy rows from farther away, so the halo must be wider.
    if any(mask is not None and not mask.any(axis=1).all() for mask in masks):
        del images, masks  # before reading again, or memory would hold both
        top, bottom = _widened(top, bottom, masked, statistics)
        images, masks = rows(top, bottom)

    return images, masks, top


def _widened(first: int, last: int, by: int, statistics: PairStatistics) -> tuple[int, int]:
    return max(0, first - by), min(statistics.size[0], last + by)


def working_memory(statistics: PairStatistics, rows: int, *, threads: int, itemsize: int) -> int:
    """Return the largest memory of `match_rows` in bytes, on top of the process's memory before.

    Parameters
    ----------
    statistics
        The statistics of the whole pair.
    rows
        Rows to match at a time.
    threads
        Threads.
    itemsize
        Bytes per pixel of one image, all channels together, as the reader returns it.

    Returns
    -------
    int
        An upper bound: for the buffers of the search, which do not depend on `rows`, and for
        images, codes and maps of a band and its halo, which do.
    """
    return _core.working_memory(statistics, rows, threads, itemsize)


class Checked:
    """A reader that checks its rows and returns them in the core's form."""

    def __init__(
        self,
        read: Reader,
        size: tuple[int, int],
        dtype: str | None = None,
        borders: Borders = (None, None),
        overlays: tuple[Rectangle, ...] = (),
    ) -> None:
        check_type("read", read, Callable, "a callable")
        self.size, self.borders, self.overlays = size, borders, overlays
        self._read, self._dtype = read, dtype

    def __call__(
        self, first: int, last: int
    ) -> tuple[tuple[Pixels, Pixels], tuple[Mask | None, Mask | None]]:
        """Read rows, in the same type as the rows read before."""
        found = self._read(first, last)
        if not isinstance(found, (tuple, list)) or len(found) != 4:
            many = f" of {len(found)}" if isinstance(found, (tuple, list)) else ""
            raise TypeError(
                f"read: got {type(found).__name__}{many}; accepts a tuple of four, (left, right, "
                "left_mask, right_mask)"
            )

        left, right, left_mask, right_mask = found
        views = as_seen(left, left_mask, "left"), as_seen(right, right_mask, "right")
        pair = as_pair(views[0].pixels, views[1].pixels)
        size = last - first, self.size[1]
        if pair[0].shape[:2] != size:
            raise ValueError(
                f"read: got {pair[0].shape[:2]} pixels for the rows {first} to {last}; "
                f"accepts {size}"
            )

        name = pair[0].dtype.name
        if self._dtype not in (None, name):
            raise TypeError(
                f"read: got {name} for the rows {first} to {last}; accepts that of "
                f"others, {self._dtype}"
            )
        self._dtype = name

        masks = [
            join_masks(
                join_masks(view.valid, self._without_border(border, first, last)),
                self._without_overlays(first, last),
            )
            for view, border in zip(views, self.borders, strict=True)
        ]
        return pair, (masks[0], masks[1])

    def _without_border(
        self, border: NDArray[np.uint32] | None, first: int, last: int
    ) -> Mask | None:
        """Return a mask of the pixels in some rows that lie inside the border of their image."""
        if border is None:
            return None
        rows, cols = self.size
        top, bottom, left, right = np.split(
            border.astype(np.intp), [cols, 2 * cols, 2 * cols + rows]
        )
        y, x = np.ogrid[first:last, :cols]
        inside: Mask = (y >= top) & (y < rows - bottom)
        return inside & (x >= left[first:last, None]) & (x < cols - right[first:last, None])

    def _without_overlays(self, first: int, last: int) -> Mask | None:
        """Return a mask of the pixels in some rows that no overlay covers."""
        if not self.overlays:
            return None
        mask = np.ones((last - first, self.size[1]), bool)
        for top, bottom, left, right in self.overlays:
            mask[max(top - first, 0) : max(bottom - first, 0), left:right] = False
        return mask

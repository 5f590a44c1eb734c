"""Two images in, one disparity map out: once, or repeatedly."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo import _core
from phasestereo._devices import opened
from phasestereo._images import ImageOrPath
from phasestereo._numbers import check_callable
from phasestereo._opening import Progress, opened_valid
from phasestereo.known import Known, as_known
from phasestereo.result import Result
from phasestereo.rig.findings import warn
from phasestereo.settings import PresetName, Settings, SettingsOverrides, resolve
from phasestereo.temporal import TemporalFilter, as_core_filter

if TYPE_CHECKING:
    from phasestereo.second import SecondMatcher

Search = tuple[int, int | None]

Second: TypeAlias = ArrayLike | Callable[..., ArrayLike]
"""A map of the left image, or its source: a function, or a name such as ``"onnx:net.onnx"``."""


def match(
    left: ImageOrPath,
    right: ImageOrPath,
    *,
    num_disparities: int | None = None,
    min_disparity: int = 0,
    preset: PresetName | None = None,
    settings: Settings | None = None,
    threads: int | None = None,
    device: str = "cpu",
    left_mask: ArrayLike | None = None,
    right_mask: ArrayLike | None = None,
    progress: Progress | None = None,
    known: Known | None = None,
    vertical: bool | None = None,
    right_map: bool = False,
    second: Second | None = None,
    timeout: float | None = None,
    **overrides: Unpack[SettingsOverrides],
) -> Result:
    """Match a rectified stereo pair.

    Parameters
    ----------
    left, right
        Images: (H, W) or (H, W, 1) gray, (H, W, 3) RGB or (H, W, 4) RGBA;
        uint8, uint16, float32 or float64, with any strides and byte order. Or paths of images,
        which are read as `phasestereo.io.read_image` does. They may differ in number of channels,
        dtype and size, by a factor of up to 8: the right image is resampled to the left one's size,
        and disparities are in pixels of the left image.
    num_disparities
        Number of disparities to search, from 1 to the images' width, at most 16384. None: the range
        is found from small copies of the images, up to 45 % of the width either way and, if these
        match badly there, up to 75 %. `min_disparity` must then be 0. If nothing is found, a third
        of the width is searched. ``result.search`` reports the range and its origin.
    min_disparity
        Smallest disparity; those in [min_disparity, min_disparity + num_disparities) are searched.
    preset
        Name of the settings to start from, one of `PRESETS`. None: ``"robust"``, unless `settings`
        is given.
    settings
        Settings to start from instead of a preset; give only one of them.
    threads
        Number of threads, 1 to 1024; None: the environment variable ``RAYON_NUM_THREADS``, or else
        all processors, shared by all concurrent matches of this process. The result does not depend
        on it.
    device
        The device that searches for the best candidates: ``"cpu"``, the processor; ``"gpu"``, the
        first GPU that Vulkan or Metal offers; ``"auto"``, the same, or the processor without one;
        or an adapter by part of its name, the only way to select a software driver. All but
        ``"cpu"`` open a device on every call; a `Matcher` opens it once. The result is the same to
        the bit: the processor searches what the device does not support, such as masks, and
        everything after the device has failed, which ``result.findings`` reports.
    left_mask, right_mask
        bool (H, W) of the image's own size, True = valid. A masked pixel gets no estimate and has
        no effect on others. None: all are valid. These are always masked: NaN in float images,
        pixels with alpha 0, the masked pixels of a NumPy masked array, the "no data" of a GeoTIFF
        file, black borders, and overlays such as clocks and logos; findings report these.
    progress
        Called as ``progress(rows_done, rows)`` from time to time in the calling thread; an
        exception that it raises ends the match.
    known
        Known facts of the pair. None: all are estimated, as far as the settings ask for it.
    vertical
        Whether the right camera is below the left one: pixel (x, y) of `left`, the upper image,
        then corresponds to (x, y - d) of `right`. Both are turned by 90 degrees for the match, and
        the maps are turned back; everything else in the result, such as `Result.alignment`, refers
        to the turned images. None: True if the images clearly show it, which ``result.findings``
        reports: things move along columns by their distance, and columns match at least as well as
        rows.
    right_map
        Whether to match the right image, too: ``result.right`` is its map, as seen from it. It
        comes from a match of the exchanged, mirrored pair, mirrored back, and takes as long as
        another match.
    second
        A second map, or its source: the result combines both. A function ``(left, right) ->
        disparity``, or anything else that `phasestereo.matchers.load_matcher` takes, such as
        ``"onnx:net.onnx"``: it is called with the pair as `prepare` makes it, from this match's own
        estimates. Or a map of the left image, (H, W) integers or floats, pixels, NaN where missing.
        Where both agree within 1 px, the result is their mean; elsewhere the one that is more
        likely right, with the flag `Flag.SECOND` if that is the second one. If the matcher raises
        an error, or does not return a map, the match stays as it is, and ``result.findings``
        reports it. There are confidences regardless of the settings. Only the left map uses it. See
        the page "Use your network".
    timeout
        Time limit of the second matcher, in seconds; None: no limit. After it, the matcher counts
        as failed; its thread runs on, and its answer is dropped.
    **overrides
        Fields of `Settings` by name, which take precedence over ``preset`` and ``settings``.

    Returns
    -------
    Result
        Disparities, flags and, if the settings ask for them, confidences, each (H, W). It also
        refers to the images, and so keeps them in memory.

    Raises
    ------
    TypeError
        For a wrong type or dtype, an unknown setting, or `preset` beside `settings`.
    ValueError
        For a wrong value or shape, infinite pixels that no mask covers, an unknown preset.
    OSError, ImportError
        If a file cannot be read, or phasestereo-gpu is needed and not installed.
    MemoryError
        If the working memory cannot be allocated.
    KeyboardInterrupt
        Soon after Ctrl-C.

    Warns
    -----
    MatchWarning
        If the match as a whole is not to be trusted: much of it is probably wrong, the images seem
        swapped or seem to show different scenes, or the range is too short. ``result.findings``
        reports this, too, and other useful facts.

    Notes
    -----
    The method is that of Pedone & Heikkilä, *Blur and Contrast Invariant Fast Stereo Matching*,
    ACIVS 2008.

    The working memory of each thread does not grow with the height of the images: by default about
    19 000 bytes per disparity searched and 900 per column, 7 MB for 256 disparities and 1920
    columns; with ``optimizer="dp"`` up to ``100 * W * num_disparities`` bytes. The whole pair needs
    copies of the images, codes (a byte per eight bits and pixel, for the right image once per
    version), gray values and the result: 6 bytes per pixel, 10 with confidences; with ``scales``,
    about 11 more where pixels are in doubt. For pairs that do not fit into memory, see
    `phasestereo_large.outofcore`, `match_rows`. The threads and at most 64 MB of the working memory
    stay for the next call, until `release_memory`.

    Examples
    --------
    >>> result = ps.match("left.png", "right.png")
    >>> result.disparity  # float32 (H, W), pixels: left (x, y) is right (x - d, y)
    >>> result.findings  # faults of the pair, worst first
    >>> ps.match(left, right, num_disparities=64, preset="fast", fill=False)
    """
    chosen, searching = resolve(preset, settings, overrides), opened(device)
    result = match_silently(
        (left, right),
        (left_mask, right_mask),
        (min_disparity, num_disparities),
        settings=chosen,
        threads=threads if searching is None else _core.Workers(threads, searching),
        progress=progress,
        known=known,
        vertical=vertical,
        right_map=right_map,
        second=second,
        timeout=timeout,
    )

    warn(result.findings)
    return result


def release_memory() -> None:
    """Free the threads and the working memory, at most 64 MB, that `match` keeps for later calls.

    Running calls keep theirs. A fork does the same, in both processes; a `Matcher` is not affected.

    Examples
    --------
    >>> disparity = ps.match("left.png", "right.png").disparity
    >>> ps.release_memory()
    """
    _core.release_memory()


if hasattr(os, "register_at_fork"):
    # Threads do not survive a fork, and Python warns when a process with threads forks.
    os.register_at_fork(before=_core.release_memory)


class Matcher:
    """Matches one pair after another, such as video frames, reusing its threads and memory.

    It returns the same results as `match`. Several threads may use one matcher at the same time;
    they share its threads, while each matcher has threads of its own. It can be pickled, and a
    process may fork: the copy has its own threads and memory. It keeps its threads, and the working
    memory of its largest match, as long as it exists.

    Parameters
    ----------
    preset, settings, threads, device, **overrides
        As `match` takes them.

    Raises
    ------
    TypeError, ValueError, ImportError
        As `match` does.
    RuntimeError
        If the system refuses to start the threads.

    Warns
    -----
    MatchWarning
        As `match` does, for each match.

    Examples
    --------
    >>> matcher = ps.Matcher(preset="fast", threads=2)
    >>> for left, right in frames:
    ...     disparity = matcher.match(left, right, num_disparities=64).disparity
    """

    def __init__(
        self,
        *,
        preset: PresetName | None = None,
        settings: Settings | None = None,
        threads: int | None = None,
        device: str = "cpu",
        **overrides: Unpack[SettingsOverrides],
    ) -> None:
        self._settings = resolve(preset, settings, overrides)
        self._asked = threads, device
        searching = opened(device)
        self._device = "cpu" if searching is None else searching.name
        self._workers = _core.Workers(threads, searching)

    @property
    def settings(self) -> Settings:
        """The settings of every match."""
        return self._settings

    @property
    def threads(self) -> int:
        """The number of threads."""
        return self._workers.count

    @property
    def device(self) -> str:
        """The device that searches: "cpu", or the name of the opened adapter."""
        return self._device

    def match(
        self,
        left: ImageOrPath,
        right: ImageOrPath,
        *,
        num_disparities: int | None = None,
        min_disparity: int = 0,
        left_mask: ArrayLike | None = None,
        right_mask: ArrayLike | None = None,
        progress: Progress | None = None,
        known: Known | None = None,
        temporal_filter: TemporalFilter | None = None,
        vertical: bool | None = None,
        second: Second | None = None,
        timeout: float | None = None,
    ) -> Result:
        """Match a rectified stereo pair; parameters, result and errors are those of `match`.

        Parameters
        ----------
        temporal_filter
            Steadies the disparities of a video whose next frame this is;
            ``result.temporal_support`` shows where it did. None: no filter.

        Raises
        ------
        TypeError
            Also for a filter of the wrong type.
        ValueError
            Also for a filter that another match is using at the same time.
        """
        result = match_silently(
            (left, right),
            (left_mask, right_mask),
            (min_disparity, num_disparities),
            settings=self._settings,
            threads=self._workers,
            progress=progress,
            known=known,
            temporal_filter=temporal_filter,
            vertical=vertical,
            second=second,
            timeout=timeout,
        )

        warn(result.findings)
        return result

    def __reduce__(self) -> tuple[partial[Matcher], tuple[()]]:
        """Return the constructor and arguments of a copy; threads are not copied."""
        threads, device = self._asked
        return partial(type(self), settings=self._settings, threads=threads, device=device), ()

    def __repr__(self) -> str:
        return f"Matcher(settings={self._settings}, threads={self.threads})"


def match_silently(
    images: tuple[ImageOrPath, ImageOrPath],
    masks: tuple[ArrayLike | None, ArrayLike | None],
    search: Search,
    *,
    settings: Settings,
    threads: int | _core.Workers | None,
    progress: Progress | None,
    known: Known | None = None,
    temporal_filter: TemporalFilter | None = None,
    rig: _core.Rig | None = None,
    reestimate: int = 1,
    vertical: bool | None = None,
    right_map: bool = False,
    second: Second | None = None,
    timeout: float | None = None,
) -> Result:
    """Match as `match` and `Matcher.match` do, without a warning; with a rig, as its next frame."""
    check_callable("progress", progress)

    arrays, pair, valid = opened_valid(images, masks)

    if vertical is not None and not isinstance(vertical, bool):
        raise TypeError(f"vertical: got {vertical!r:.80}; accepts True, False or None")

    other = _other(second, timeout, pair[0].shape[:2])
    if other is not None:  # confidences decide between both maps
        settings = replace(settings, confidence=True)

    def matched(*, vertical: bool | None, backward: bool) -> Result:
        # Exchanged and mirrored along the disparities, the right image matches like a left one.
        axis = int(not vertical)
        mirror: Callable[[NDArray[Any]], NDArray[Any]] = partial(np.flip, axis=axis)
        change = mirror if backward else np.asarray
        step = -1 if backward else 1
        views: list[Any] = [change(view) for view in pair[::step]]
        masks = [None if mask is None else change(mask) for mask in valid[::step]]
        found = _core.match_pair(
            (views[0], views[1]),
            (masks[0], masks[1]),
            search,
            settings,
            threads,
            _part_of(progress, is_second=backward) if right_map else progress,
            as_known(known).exchanged() if backward else as_known(known),
            as_core_filter(temporal_filter),
            rig,
            reestimate,
            vertical,
            None if backward else other,
        )
        if backward:
            found = _with_maps(found, change)
        return replace(found, pair=(arrays[1], arrays[0]) if backward else arrays)

    result = matched(vertical=vertical, backward=False)
    if not right_map:
        return result
    return replace(result, right=matched(vertical=result.vertical, backward=True))


def _other(
    second: Second | None, timeout: float | None, size: tuple[int, ...]
) -> NDArray[np.float32] | SecondMatcher | None:
    if second is None and timeout is None:
        return None
    from phasestereo.second import as_second  # noqa: PLC0415 - it doubles the time of import

    return as_second(second, timeout, size)


def _part_of(progress: Progress | None, *, is_second: bool) -> Progress | None:
    """Return a progress callback for one of two matches; it counts the rows of both."""
    if progress is None:
        return None
    return lambda done, rows: progress(done + is_second * rows, 2 * rows)


def _with_maps(result: Result, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Result:
    """Return a result with every map changed in the same way."""
    support = {"temporal_support": result.temporal_support}
    maps: dict[str, Any] = {
        name: None if values is None else np.ascontiguousarray(change(values))
        for name, values in (result.maps | support).items()
    }
    return replace(result, **maps)

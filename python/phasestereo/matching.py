"""Two images in, one disparity map out: once, or again and again."""

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
"""A map of the left image, or what makes one: a function, or a name such as ``"onnx:net.onnx"``."""


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
        uint8, uint16, float32 or float64, of any strides and byte order. Or paths of such, which
        are read as `phasestereo.io.read_image` does. They may differ in the number of channels, in
        dtype and in size, by a factor of up to 8: the right image is resampled to the left one's
        size, and disparities are in pixels of the left image.
    num_disparities
        Number of disparities to search, 1 to the images' width and at most 16384. None: the range
        is found from small copies of the images, up to 45 % of the width either way, and
        `min_disparity` must be 0; where nothing is found it is a third of the width.
        ``result.search`` says which range, and why.
    min_disparity
        Smallest disparity; those in [min_disparity, min_disparity + num_disparities) are searched.
    preset
        Name of the settings to start from, one of `PRESETS`. None: ``"robust"``, unless `settings`
        says otherwise.
    settings
        Settings to start from in place of a preset, which must not be given beside it.
    threads
        Number of threads, 1 to 1024; None: what the environment variable ``RAYON_NUM_THREADS``
        says, or else all processors, shared by all matches of this process that
        run at the same time. The result does not depend on it.
    device
        What searches for the best candidates: ``"cpu"``, the processor; ``"gpu"``, the first GPU
        that Vulkan or Metal offers; ``"auto"``, the same, or the processor without one; or an
        adapter by a part of its name, as a software driver has to be. All but ``"cpu"`` open a
        device, which a `Matcher` does once. The result is the same to the bit: what a device does
        not take, as masks, and everything once it has failed, which ``result.findings`` reports,
        the processor searches.
    left_mask, right_mask
        bool (H, W) of the image's own size, True = valid. A masked pixel neither supports others
        nor is estimated, and what it holds has no effect. None: all are valid. Masked in any case
        are: NaN in an image of floats, an alpha of 0, what a masked array of NumPy masks, the "no
        data" of a GeoTIFF file, black borders, and overlays such as clocks and logos, on which
        findings report.
    progress
        Called as ``progress(rows_done, rows)`` every now and then from the calling thread; what it
        raises ends the match.
    known
        What is known of the pair beforehand. None: all is estimated, as far as the settings ask for
        it.
    vertical
        Whether the right camera is below the left one: pixel (x, y) of `left`, the upper image,
        then corresponds to (x, y - d) of `right`. Both are turned by 90 degrees for the match and
        the maps turned back; all else that the result has, as `Result.alignment`, is of the turned
        images. None: it is, where the images show it clearly, which ``result.findings`` says:
        things move along columns by their distance, and columns match at least as well as rows.
    right_map
        Whether the right image is matched, too: ``result.right`` is its map, as seen from it. It
        is that of the exchanged, mirrored pair, mirrored back, and takes the time of a match.
    second
        What makes a second map, or the map: the result is that of both. A function
        ``(left, right) -> disparity``, or what else `phasestereo.matchers.load_matcher` takes, as
        ``"onnx:net.onnx"``: it is called with the pair as `prepare` makes it, by what this match
        has found out. Or a map of the left image, (H, W) integers or floats, pixels, NaN where it
        has none. Where both agree within 1 px the result is the mean; elsewhere the one that is
        more likely right, with the flag `Flag.SECOND` if that is the second one. A matcher that
        raises an error, or whose answer is not a map, leaves the match as it is, which
        ``result.findings`` reports. There are confidences whatever the settings say. It takes part
        in the left map alone. See the page "Use your network".
    timeout
        Seconds that the second matcher may take; None: any time. One that takes longer has failed;
        its thread runs on, and its answer is dropped.
    **overrides
        Fields of `Settings` by name, which take precedence over ``preset`` and ``settings``.

    Returns
    -------
    Result
        Disparities, flags and, if the settings ask for them, confidences, each (H, W). It refers
        to the images, too, and so keeps them in memory.

    Raises
    ------
    TypeError
        For a wrong type or dtype, an unknown setting, or `preset` beside `settings`.
    ValueError
        For a wrong value or shape, infinite pixels that no mask covers, an unknown preset.
    OSError, ImportError
        If a file cannot be read, or phasestereo-gpu is needed and not installed.
    MemoryError
        If the working memory cannot be had.
    KeyboardInterrupt
        Soon after Ctrl-C.

    Warns
    -----
    MatchWarning
        If the match as a whole is not to be trusted: much of it is probably wrong, the images seem
        to be swapped, or to have nothing in common, or the range is too short.
        ``result.findings`` says so, too, and what is worth knowing besides.

    Notes
    -----
    The method is that of Pedone & Heikkilä, *Blur and Contrast Invariant Fast Stereo Matching*,
    ACIVS 2008.

    Working memory of each thread does not grow with the height of the images: by default it is
    about 19 000 bytes for each disparity searched and 900 for each column, 7 MB for 256 disparities
    and 1920 columns; with ``optimizer="dp"`` up to ``100 * W * num_disparities`` bytes. For the
    whole pair there are copies of the images, codes (a byte for each eight bits and pixel, of the
    right image once for each version), gray values and the result: 6 bytes a pixel, 10 with
    confidences; with ``scales``, where pixels are in doubt, about 11 more. Pairs that do not fit
    into memory: `phasestereo_large.outofcore`, `match_rows`. The threads and at most 64 MB of the
    working memory stay for the next call, until `release_memory`.

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
    """Give back the threads and the working memory, at most 64 MB, that `match` keeps for later.

    Calls that run keep theirs. A fork does the same, in both processes; what a `Matcher` keeps is
    its own.

    Examples
    --------
    >>> disparity = ps.match("left.png", "right.png").disparity
    >>> ps.release_memory()
    """
    _core.release_memory()


if hasattr(os, "register_at_fork"):
    # Threads do not survive a fork, and a process with threads is warned of it.
    os.register_at_fork(before=_core.release_memory)


class Matcher:
    """Matches one pair after another, as of a video, and reuses its threads and its memory.

    It gives what `match` gives. Several threads may use one at the same time; they share its
    threads, whereas several of it have threads of their own each. It can be pickled, and a process
    may fork: the copy has threads and memory of its own. What it keeps are the threads and as much
    working memory as its largest match took, as long as it exists.

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
        As `match` does, of each match.

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
        """What searches: "cpu", or the name of the adapter that was opened."""
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
        """Match a rectified stereo pair: parameters, result and errors are those of `match`.

        Parameters
        ----------
        temporal_filter
            What steadies the disparities of a video, of which this is the next frame;
            ``result.temporal_support`` says where it did. None: nothing does.

        Raises
        ------
        TypeError
            Also for a filter of another type.
        ValueError
            Also for a filter that another match is using at this moment.
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
        """Return the constructor and arguments of a copy: threads are not copied."""
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
    """Match as `match` and `Matcher.match` do, without a warning; with a rig, its next frame."""
    check_callable("progress", progress)

    arrays, pair, valid = opened_valid(images, masks)

    if vertical is not None and not isinstance(vertical, bool):
        raise TypeError(f"vertical: got {vertical!r:.80}; accepts True, False or None")

    other = _other(second, timeout, pair[0].shape[:2])
    if other is not None:  # confidences decide between both maps
        settings = replace(settings, confidence=True)

    def matched(*, vertical: bool | None, backward: bool) -> Result:
        # Exchanged and mirrored along the disparities, the right image is matched as a left one.
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
    """Return a progress callback for one of two matches, in rows of both."""
    if progress is None:
        return None
    return lambda done, rows: progress(done + is_second * rows, 2 * rows)


def _with_maps(result: Result, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Result:
    """Return a result whose maps are changed in the same way."""
    support = {"temporal_support": result.temporal_support}
    maps: dict[str, Any] = {
        name: None if values is None else np.ascontiguousarray(change(values))
        for name, values in (result.maps | support).items()
    }
    return replace(result, **maps)

"""Two images in, one disparity map out: once, or again and again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, replace
from functools import partial
from typing import Any

from numpy.typing import ArrayLike, NDArray

from phasestereo import _core
from phasestereo._images import ImageOrPath, Mask, Pixels, as_array, as_mask, as_pair
from phasestereo._opening import opened
from phasestereo.result import Result, Summary
from phasestereo.rig.alignment import applied_field
from phasestereo.rig.compensation import BlurCompensation, Noise, as_noise
from phasestereo.rig.estimates import Estimates, Known, Matched, Summarized, Supported, as_estimates
from phasestereo.rig.findings import Said, as_findings, warn
from phasestereo.rig.rectified import as_rectified
from phasestereo.settings import Settings, resolve
from phasestereo.temporal import TemporalFilter, as_core_filter

Progress = Callable[[int, int], object]
Search = tuple[int, int | None]


def match(
    left: ImageOrPath,
    right: ImageOrPath,
    *,
    num_disparities: int | None = None,
    min_disparity: int = 0,
    preset: str | None = None,
    settings: Settings | None = None,
    threads: int | None = None,
    left_mask: ArrayLike | None = None,
    right_mask: ArrayLike | None = None,
    progress: Progress | None = None,
    noise: Noise | None = None,
    blur_compensation: BlurCompensation | None = None,
    **overrides: Any,
) -> Result:
    """Match a rectified stereo pair.

    Parameters
    ----------
    left, right
        Images of equal size and dtype: (H, W) or (H, W, 1) gray, (H, W, 3) RGB or (H, W, 4) RGBA
        (alpha is left out); uint8, uint16, float32 or float64, of any strides and byte order. They
        may differ in the number of channels. Or paths of such, which are read as
        `phasestereo.io.read_image` does.
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
        says, or else as many as the process may use, shared by all matches of this process that
        run at the same time. The result does not depend on it.
    left_mask, right_mask
        bool (H, W), True = valid. A masked pixel neither supports others nor is estimated, and
        what it holds (it may be NaN) has no effect. None: all are valid.
    progress
        Called as ``progress(rows_done, rows)`` every now and then from the calling thread; what it
        raises ends the match.
    noise
        Standard deviation of the noise of both images, or a pair of them (left, right), in units
        of their pixels; of gray values where they have color. It matters with ``noise_threshold >
        0``; None: it is estimated then.
    blur_compensation
        How the blur of the images is evened out before pixels are compared, see
        `phasestereo.BlurCompensation`; it holds the noise, too. For ``cost="phase"``. None: with
        ``compensate_blur=True`` what suits the blur that is found, else not at all.
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
        For a wrong value or shape, NaN or infinite pixels that no mask covers, an unknown preset.
    OSError, ImportError
        If a file cannot be read.
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
    into memory: `phasestereo_large.outofcore`, `match_rows`. Nothing but that is kept, nor are any
    threads: to match one pair after another, `Matcher` keeps them.
    """
    result = match_silently(
        (left, right),
        (left_mask, right_mask),
        (min_disparity, num_disparities),
        settings=resolve(preset, settings, overrides),
        threads=threads,
        progress=progress,
        given=(noise, blur_compensation),
    )

    warn(result.findings)
    return result


class Matcher:
    """Matches one pair after another, as of a video, and reuses its threads and its memory.

    It gives what `match` gives. Several threads may use one at the same time; they share its
    threads, whereas several of it have threads of their own each. It can be pickled, and a process
    may fork: the copy has threads and memory of its own. What it keeps are the threads and as much
    working memory as its largest match took, as long as it exists.

    Parameters
    ----------
    preset, settings, threads, **overrides
        As `match` takes them.

    Raises
    ------
    TypeError, ValueError
        As `match` does.
    RuntimeError
        If the system refuses to start the threads.

    Warns
    -----
    MatchWarning
        As `match` does, of each match.
    """

    def __init__(
        self,
        *,
        preset: str | None = None,
        settings: Settings | None = None,
        threads: int | None = None,
        **overrides: Any,
    ) -> None:
        self._settings = resolve(preset, settings, overrides)
        self._asked = threads
        self._workers = _core.Workers(threads)

    @property
    def settings(self) -> Settings:
        """The settings of every match."""
        return self._settings

    @property
    def threads(self) -> int:
        """The number of threads."""
        return self._workers.count

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
        noise: Noise | None = None,
        blur_compensation: BlurCompensation | None = None,
        before: Result | None = None,
        temporal_filter: TemporalFilter | None = None,
    ) -> Result:
        """Match a rectified stereo pair: parameters, result and errors are those of `match`.

        Parameters
        ----------
        before
            The result of an earlier pair of the same cameras. If this one's blur is as it was,
            which is seen at a glance, all that was estimated then is taken over: blur, noise and
            contrast, the field of the rows, and the range of disparities unless it is given; and
            ``result.blur.reused`` is True. What a glance does not see is in the notes of
            `phasestereo_live.stream`. None: all is estimated anew, if need be.
        temporal_filter
            What steadies the disparities of a video, of which this is the next frame;
            ``result.temporal_support`` says where it did. None: nothing does.

        Raises
        ------
        TypeError
            Also for a filter that is none.
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
            given=(noise, blur_compensation),
            before=before,
            temporal_filter=temporal_filter,
        )

        warn(result.findings)
        return result

    def __reduce__(self) -> tuple[partial[Matcher], tuple[()]]:
        """Return what makes another one: threads do not travel."""
        return partial(type(self), settings=self._settings, threads=self._asked), ()

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
    given: tuple[Noise | None, BlurCompensation | None],
    before: Result | None = None,
    temporal_filter: TemporalFilter | None = None,
) -> Result:
    """Match as `match` and `Matcher.match` do, without a warning."""
    if progress is not None and not callable(progress):
        raise TypeError(f"progress: got {type(progress).__name__}; accepts a callable or None")

    arrays = as_array(opened(images[0]), "left"), as_array(opened(images[1]), "right")
    pair = as_pair(*arrays)
    size = pair[0].shape
    valid = as_mask(masks[0], size, "left_mask"), as_mask(masks[1], size, "right_mask")

    known: Known = as_noise(*given), given[1], None, False, []

    temporal = as_core_filter(temporal_filter)

    rectified = None
    # What was estimated for an earlier pair is taken over where a glance finds the same blur.
    if before is not None and _is_as_before(before, pair, valid, threads):
        how = threads, progress
        matched, summary, found, supported, said = _match_again(
            before, pair, valid, search, how, temporal=temporal
        )
    else:
        matched, summary, estimated, supported, said, rectified = _core.match_pair(
            pair, valid, search, settings, threads, progress, known, temporal
        )
        found = as_estimates(estimated, settings, search, given[1])

    result = result_of(matched, summary, found, arrays, said, supported=supported)
    if rectified is None:
        return result
    # The field that is left is one of the rectified pair.
    return replace(result, alignment=None, rectified=as_rectified(rectified))


def result_of(
    matched: Matched,
    summary: Summarized,
    found: Estimates,
    pair: tuple[NDArray[Any], NDArray[Any]],
    said: list[Said],
    *,
    supported: Supported | None = None,
) -> Result:
    """Return what the core has matched and estimated as a result, beside the pair as given."""
    disparity, flags, confidence, uncertainty, stages = matched
    timings = {"estimation": found.seconds} if found.seconds else {}
    support, seconds = supported or (None, 0.0)
    if support is not None:
        stages = stages | {"temporal filter": seconds}

    return Result(
        disparity,
        flags,
        confidence,
        found.settings,
        timings | stages,
        uncertainty=uncertainty,
        search=found.search,
        blur=found.blur,
        alignment=found.alignment,
        blur_compensation=found.blur_compensation,
        summary=Summary(*summary),
        findings=as_findings(said),
        pair=pair,
        temporal_support=support,
    )


def _is_as_before(
    before: Result,
    pair: tuple[Pixels, Pixels],
    masks: tuple[Mask | None, Mask | None],
    threads: int | _core.Workers | None,
) -> bool:
    """Return whether what was estimated for an earlier pair holds for this one, at a glance."""
    if before.blur is None or before.blur.glance is None or before.rectified is not None:
        return False

    return _core.blur_is_as_before(pair, masks, before.blur.glance, before.blur.impulses, threads)


def _match_again(
    before: Result,
    pair: tuple[Pixels, Pixels],
    masks: tuple[Mask | None, Mask | None],
    search: Search,
    how: tuple[int | _core.Workers | None, Progress | None],
    *,
    temporal: _core.TemporalFilter | None,
) -> tuple[Matched, Summarized, Estimates, Supported | None, list[Said]]:
    """Match with what was estimated for an earlier pair."""
    if search[1] is None and before.search is not None:
        search = before.search.min_disparity, before.search.num_disparities

    alignment, compensation = before.alignment, before.blur_compensation
    # The field of the earlier pair is given, so the core must not estimate another one.
    asked = replace(before.settings, align_rows=False)
    inverted = before.search is not None and before.search.inverted and asked.compensate_blur
    said = [astuple(one) for one in before.findings]
    known: Known = None, compensation, applied_field(alignment), inverted, said
    matched, summary, estimated, supported, found, _ = _core.match_pair(
        pair, masks, search, asked, *how, known, temporal
    )

    same = as_estimates(estimated, before.settings, search, compensation)
    blur = None if before.blur is None else replace(before.blur, reused=True)
    kept = before.search or same.search
    same = replace(same, search=kept, blur=blur, alignment=alignment)
    return matched, summary, same, supported, found

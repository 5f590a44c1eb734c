"""Match the pairs of videos, folders of images or cameras, one after another.

The stream reports and skips a pair that it cannot read or match; the others keep their numbers.
`phasestereo_live.video` supplies the pairs.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import chain, islice
from typing import Any, TypeVar, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._core import MOST_DISPARITIES
from phasestereo._images import ImageOrPath, as_mask, as_pair, as_views
from phasestereo._numbers import as_integer, check_callable, check_type
from phasestereo._opening import opened
from phasestereo.io.files import describe_error
from phasestereo.io.pair import Layout, LayoutError
from phasestereo.io.rigs.cameras import Cameras
from phasestereo.io.rigs.reading import CalibrationSource
from phasestereo.known import Known, as_known
from phasestereo.matching import match
from phasestereo.rectification import Rectification
from phasestereo.result import Result
from phasestereo.rigs import REESTIMATE, Rig
from phasestereo.second import SecondMatcher, as_second_matcher
from phasestereo.settings import PresetName, Settings, SettingsOverrides
from phasestereo.temporal import TemporalFilter
from phasestereo_live._closing import Closing
from phasestereo_live.video.cameras import PATIENCE
from phasestereo_live.video.capture import Capture, CaptureSource, Image, Pair
from phasestereo_live.video.rectifying import Rectifier
from phasestereo_live.video.sources import Place, open_source

_Taken = tuple[Capture[Pair], Pair | Exception]

T = TypeVar("T")

_LOG = logging.getLogger("phasestereo")
_FAULTS = (OSError, ValueError, TypeError)
"""Errors that one frame may have and the next may not."""
_END: Any = object()  # follows the last frame


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One pair of a stream, matched.

    Parameters
    ----------
    index
        Its number in the source, from 0. Failed frames also have a number.
    time
        Capture time in seconds from the beginning of the video, or from the opening of the cameras.
        None if the source does not give it.
    left, right
        The images, gray (H, W) or RGB (H, W, 3).
    result
        The result of `phasestereo.match` for them.
    apart
        Seconds between both views: for two cameras, the time from the first one's delivery to the
        second one's. None if the source does not give it.
    """

    index: int
    time: float | None
    left: Image
    right: Image
    result: Result
    apart: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Failure:
    """A frame that could not be read or matched.

    Parameters
    ----------
    index, time
        As in a `Frame`.
    error
        The error: an OSError, ValueError or TypeError.
    """

    index: int
    time: float | None
    error: Exception

    def __str__(self) -> str:
        return f"frame {self.index}: {describe_error(self.error)}"


def stream(
    source: Place
    | Iterable[tuple[ImageOrPath, ImageOrPath]]
    | Iterable[ArrayLike]
    | CaptureSource[Pair],
    right: Place | None = None,
    *,
    num_disparities: int | None = None,
    min_disparity: int = 0,
    layout: Layout | None = None,
    rectify: CalibrationSource | Rectification | Cameras | None = None,
    start: int = 0,
    stop: int | None = None,
    every: int = 1,
    reestimate: int = REESTIMATE,
    temporal_filter: bool = True,
    patience: int | None = PATIENCE,
    on_error: Callable[[Failure], object] | None = None,
    preset: PresetName | None = None,
    settings: Settings | None = None,
    threads: int | None = None,
    left_mask: ArrayLike | None = None,
    right_mask: ArrayLike | None = None,
    known: Known | None = None,
    vertical: bool | None = None,
    second: Callable[..., ArrayLike] | str | None = None,
    timeout: float | None = None,
    **overrides: Unpack[SettingsOverrides],
) -> Stream:
    """Match every frame of a video, a folder of images, or a pair of cameras.

    One `phasestereo.Rig` matches them all, and learns the geometry of the cameras. The stream
    reports and skips frames that fail: damaged or missing ones, and those whose two images differ
    in size or type although those of the first frame agree. It raises errors in the arguments at
    once.

    Parameters
    ----------
    source
        - A video file, or an address such as ``rtsp://...``: each picture holds both views.
        - A folder of images: with both views in subfolders (``left`` and ``right``, or as in KITTI
          and EuRoC) or in names with ``left`` and ``right``; with ``layout``, images that hold both
          views.
        - The number of a camera that delivers both views in each picture.
        - An iterable of pairs of images, or of their paths, as in `match`, or with ``layout``, of
          images that hold both views. Its exceptions end the stream.
        - A recording of a robot, from `phasestereo_live.ros.open_recording`.

        With ``right``, the left view.
    right
        The right view of a source of the same kind: a second video file, folder or camera. The
        stream pairs video frames by number, images by name if some names agree, else in order.
    layout
        The layout of a picture with both views: ``"side-by-side"``, left and right halves, or
        ``"top-bottom"``, the left view above. None: side by side.
    rectify
        Rectify the frames first: with a calibration or a saved file, as in `phasestereo.rectify`,
        with a `Rectification`, or with ``"auto"``, from the first frame with enough detail. Input
        frames and masks are then raw, and output frames are rectified. None: they are rectified
        already.
    start, stop, every
        Frames to match, by number: from ``start`` up to but without ``stop``, each ``every``-th.
    reestimate
        The stream estimates blur again when a quick check shows a change, and at the latest this
        number of frames after the last estimate; 1: it matches each frame by itself. See the notes.
    temporal_filter
        Whether to steady disparities where neither image changed, as `phasestereo.TemporalFilter`
        does; ``frame.result.temporal_support`` shows where. False: each frame on its own.
    patience
        Frames in a row that cameras may miss before they count as gone; None: wait for them.
    on_error
        Called with a `Failure` for every frame that fails; its exceptions end the stream. None:
        a failure becomes a warning of the logger ``phasestereo``.
    num_disparities, min_disparity, preset, settings, threads, left_mask, right_mask, **overrides
        As in `match`; masks hold for every frame.
    known
        Known facts of every frame.
    vertical
        Whether the right camera is below the left one, as in `match`. None: it is if the first
        frames show it clearly, or the calibration says so.
    second, timeout
        A callable that makes a second map of every frame, and its time limit in seconds, as in
        `match`; not a map. If it fails, the frame keeps our own map, with a finding. While a call
        that took too long still runs, the stream does not start another. The rig and the temporal
        filter see only our own maps.

    Returns
    -------
    Stream
        An iterator of `Frame`; also a context manager, which frees the source at its end.

    Raises
    ------
    TypeError, ValueError
        For a wrong argument, a file that is not a video, a folder without images, a picture that
        cannot be cut in two, or arguments that `match` refuses for any images.
    OSError
        If a file, a folder or a camera cannot be opened.
    ImportError
        If the extra is missing: ``live`` for videos and cameras, ``io`` for images, ``rectify`` to
        rectify them.

    Notes
    -----
    A decoder finds only some kinds of damage. In a video with frames that build upon each other,
    those after a damaged one may be wrong up to the next key frame; intra-coded video (MJPEG, H.264
    with key frames only) does not spread damage.

    ``preset="robust"`` estimates blur; ``"fast"`` does not. If a quick check shows no change, a
    frame reuses the blur estimate of an earlier one: ``frame.result.blur.reused``. The check
    compares the powers of both images, by direction, in each ninth of the image with those at the
    estimate. It misses blur that appears in less than a sixteenth of the image, sizes that change
    by less than about a fifth, and changes of noise or contrast that both images share: the stream
    finds these at most ``reestimate`` frames later. It also estimates blur anew if the scene moves
    by many pixels. The stream's `phasestereo.Rig` follows rows and the range of disparities, and
    its events describe the changes. The result of a frame thus depends on earlier frames, unless
    ``reestimate`` is 1 and ``temporal_filter`` False. A failed frame does not change the state that
    later frames use.

    Examples
    --------
    >>> with live.stream("video.mp4", num_disparities=64, preset="fast") as frames:
    ...     for frame in frames:
    ...         print(frame.index, np.nanmedian(frame.result.disparity))
    """
    check_callable("on_error", on_error)
    wanted = _wanted(start, stop, every)
    if patience is not None:
        as_integer("patience", patience, least=1)

    check_type("temporal_filter", temporal_filter, bool, "True or False")
    rig = Rig(
        num_disparities=num_disparities,
        min_disparity=min_disparity,
        preset=preset,
        settings=settings,
        threads=threads,
        reestimate=reestimate,
        **overrides,
    )
    if vertical is not None and not isinstance(vertical, bool):
        raise TypeError(f"vertical: got {vertical!r:.80}; accepts True, False or None")
    masks = {"left_mask": left_mask, "right_mask": right_mask}
    if timeout is not None and second is None:
        raise ValueError("timeout: got one without a second matcher; accepts None then")
    other = None if second is None else as_second_matcher(second, timeout)
    given = _Given(
        rig.settings, min_disparity, num_disparities, masks, as_known(known), vertical, other
    )

    # Refuse wrong arguments before opening any source.
    _try(given, width=None)
    rectifier = None if rectify is None else Rectifier(rectify, (left_mask, right_mask))
    opened = open_source(source, right, layout=layout, patience=patience)
    try:
        return Stream(
            opened,
            rig,
            given,
            wanted,
            on_error,
            rectifier=rectifier,
            temporal_filter=TemporalFilter() if temporal_filter else None,
        )
    except BaseException:
        opened.close()
        raise


@dataclass(frozen=True, slots=True)
class _Given:
    """The caller's options for every frame."""

    settings: Settings
    min_disparity: int
    num_disparities: int | None
    masks: Mapping[str, ArrayLike | None]
    known: Known
    vertical: bool | None
    second: SecondMatcher | None


class Stream(Iterator[Frame], Closing):
    """The matched frames of a source, one after another; see `stream`, which makes it.

    While it matches a frame of a file, it reads and decodes the next one. It frees the source at
    its end, by `close`, at the end of a ``with`` block, or with the stream itself.
    """

    def __init__(
        self,
        source: CaptureSource[Pair],
        rig: Rig,
        given: _Given,
        wanted: slice,
        on_error: Callable[[Failure], object] | None,
        *,
        rectifier: Rectifier | None = None,
        temporal_filter: TemporalFilter | None = None,
    ) -> None:
        self._source = source
        self._wanted = wanted
        self._work = _Work(
            source,
            rig,
            given,
            on_error or _warn,
            rectifier=rectifier,
            temporal_filter=temporal_filter,
        )
        self._frames = self._work.frames(wanted)

    @property
    def failed(self) -> int:
        """Number of frames that failed so far."""
        return self._work.failed

    @property
    def source_length(self) -> int | None:
        """Number of frames of the source, if known; files may hold fewer than they declare."""
        return self._source.length

    @property
    def length(self) -> int | None:
        """Number of frames to match, if known."""
        known, stop = self.source_length, self._wanted.stop
        if known is None and stop is None:
            return None

        end = min(bound for bound in (known, stop) if bound is not None)
        return len(range(self._wanted.start, end, self._wanted.step))

    @property
    def rate(self) -> float | None:
        """Frames per second of the source, if known."""
        return self._source.rate

    @property
    def q(self) -> NDArray[np.float64] | None:
        """OpenCV's matrix Q of the frames so far, if the stream rectifies them and knows it."""
        return None if self._work.rectifier is None else self._work.rectifier.q

    @property
    def rig(self) -> Rig:
        """The rig that matches the frames, with the geometry it has learned of the cameras."""
        return self._work.rig

    @property
    def rectification(self) -> Rectification | None:
        """The rectifier of the frames; None before the first, or if the stream does not rectify."""
        return None if self._work.rectifier is None else self._work.rectifier.found

    def change(self, settings: Settings, num_disparities: int | None) -> None:
        """Change the settings from the next frame on; any thread may call it.

        Parameters
        ----------
        settings
            The new settings.
        num_disparities
            Number of disparities to search; None: found from the images.

        Raises
        ------
        TypeError, ValueError
            If `match` refuses these for such images.
        """
        self._work.change(settings, num_disparities)

    def close(self) -> None:
        """End the stream and free the source."""
        self._frames.close()
        self._source.close()

    def __next__(self) -> Frame:
        return next(self._frames)


class _Work:
    """The work of a stream. It does not refer to the stream, so Python can free the stream."""

    def __init__(
        self,
        source: CaptureSource[Pair],
        rig: Rig,
        given: _Given,
        report: Callable[[Failure], object],
        *,
        rectifier: Rectifier | None,
        temporal_filter: TemporalFilter | None,
    ) -> None:
        self.rig = rig
        self.failed = 0
        self.rectifier = rectifier

        self._source = source
        self._given = given
        self._report = report
        self._temporal_filter = temporal_filter

        self._is_alike: bool | None = None
        self._checked = False
        self._width: int | None = None
        self._coming: _Given | None = None

    def change(self, settings: Settings, num_disparities: int | None) -> None:
        """Match from the next frame on with other settings."""
        given = replace(self._given, settings=settings, num_disparities=num_disparities)
        _try(given, width=self._width)
        self._coming = given

    def _take_change(self) -> None:
        coming, self._coming = self._coming, None
        if coming is not None:
            self._given = coming
            self.rig.change(coming.settings, coming.num_disparities)

    def frames(self, wanted: slice) -> Generator[Frame]:
        """Return the iterator of frames; raise errors common to all at once."""
        taken = self._taken(wanted)
        return self._matched(_ahead(self._peeked(taken)) if self._source.ahead else taken)

    def _taken(self, wanted: slice) -> Generator[_Taken]:
        """Yield the wanted captures, each with its images or the error that prevents them."""
        for capture in islice(self._source.captures, wanted.start, wanted.stop, wanted.step):
            try:
                yield capture, self._straight(*capture.take())
            except _FAULTS as error:
                yield capture, error

    def _straight(self, left: ImageOrPath, right: ImageOrPath) -> Pair:
        """Return a pair ready to match."""
        if self.rectifier is not None:
            left, right = self.rectifier.pair(left, right)
        views = as_views(opened(left), opened(right))
        if self._is_alike is None:
            kinds = {(view.shape[:2], view.dtype) for view in views}
            self._is_alike = len(kinds) == 1
        return as_pair(*views) if self._is_alike else views

    def _peeked(self, taken: Iterator[_Taken]) -> Iterator[_Taken]:
        """Check the arguments against the first frame."""
        first = list(islice(taken, 1))
        for _, images in first:
            if isinstance(images, LayoutError):
                raise images
            self._check(images)
        return chain(first, taken)

    def _check(self, images: Pair | Exception) -> None:
        """Raise errors in the arguments, once the type and size of the images are known."""
        if self._checked or isinstance(images, Exception):
            return

        self._width = images[0].shape[0 if self._vertical else 1]
        _try(self._given, width=self._width)

        for name, image in zip(("left_mask", "right_mask"), images, strict=True):
            if self.rectifier is None:  # with a rectifier, they belong to raw images
                as_mask(self._given.masks[name], image.shape, name)
        self._checked = True

    @property
    def _vertical(self) -> bool | None:
        """Whether the right camera is below the left one; None: unknown."""
        if self._given.vertical is None and self.rectifier is not None:
            return self.rectifier.vertical
        return self._given.vertical

    def _matched(self, taken: Generator[_Taken]) -> Generator[Frame]:
        with closing(self._source), closing(taken):
            for capture, images in taken:
                self._take_change()
                self._check(images)
                try:
                    frame = self._frame(capture, images)
                except _FAULTS as error:
                    self.failed += 1
                    self._report(Failure(capture.index, capture.time, error))
                else:
                    yield frame

    def _frame(self, capture: Capture[Pair], images: Pair | Exception) -> Frame:
        if isinstance(images, Exception):
            raise images

        left, right = images
        masks = self._given.masks if self.rectifier is None else self.rectifier.masks
        result = self.rig.match(
            left,
            right,
            left_mask=masks["left_mask"],
            right_mask=masks["right_mask"],
            known=self._given.known,
            temporal_filter=self._temporal_filter,
            vertical=self._vertical,
            second=self._given.second,
        )

        images = _squeezed(left), _squeezed(right)
        return Frame(capture.index, capture.time, *images, result, capture.apart)


def _ahead(items: Iterator[T]) -> Generator[T]:
    """Yield items; another thread fetches each while the one before is in use."""
    with ThreadPoolExecutor(1, thread_name_prefix="phasestereo-ahead") as thread:
        coming = thread.submit(next, items, _END)
        while (item := coming.result()) is not _END:
            coming = thread.submit(next, items, _END)
            yield item


def _try(given: _Given, *, width: int | None) -> None:
    """Match a black row: arguments that fail now would fail for any images.

    Without a width, leave out the checks that depend on it.
    """
    count = given.num_disparities
    if width is None:
        width = MOST_DISPARITIES
        count = 1 if type(count) is int and 1 <= count <= MOST_DISPARITIES else count

    black = np.zeros((1, width), np.uint8)
    match(
        black,
        black,
        num_disparities=count,
        min_disparity=given.min_disparity,
        settings=given.settings,
        known=given.known,
    )


def _wanted(start: int, stop: int | None, every: int) -> slice:
    for name, value, least in (("start", start, 0), ("stop", stop, 0), ("every", every, 1)):
        if value is not None or name != "stop":
            as_integer(name, value, least=least)
    return slice(start, stop, every)


def _squeezed(image: Image) -> Image:
    return image[:, :, 0] if image.shape[2] == 1 else image


def _warn(failure: Failure) -> None:
    _LOG.warning("%s", failure)

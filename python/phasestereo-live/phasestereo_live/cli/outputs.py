"""The outputs of ``phasestereo live``: checked before a run, complete however it ends."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

import os
import secrets
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from cyclopts import Parameter, validators

from phasestereo._extras import require
from phasestereo._interrupts import interrupts_postponed
from phasestereo.cli.errors import (
    WRONG_USAGE,
    CommandError,
    claim,
    option,
    refusals,
    refuse_picture,
    wrong,
)
from phasestereo.cli.options import AT_LEAST_ONE, POSITIVE
from phasestereo.io import Calibration, LengthUnit, write_disparity
from phasestereo.io.drafts import draft_of
from phasestereo.result import Keep
from phasestereo.views.depths import Selection
from phasestereo_live.cli.tally import Tally
from phasestereo_live.rerun import log_failure, log_frame, saving
from phasestereo_live.rgbd import LAYOUTS, RgbdLayout, RgbdWriter
from phasestereo_live.ros.bags import RecordingWriter
from phasestereo_live.ros.reading import SUFFIXES as RECORDINGS
from phasestereo_live.video import FramePicture, VideoWriter
from phasestereo_live.video.streaming import Frame

FrameSink = Callable[[Frame], object]
Geometry = Callable[[Frame], Calibration | None]

_NO_GEOMETRY = "needs a geometry, as --calib, camera_info or --rectify FILE"
_RATE = 25.0  # for sources whose own rate is unknown


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveOutputs:
    """What to do with the disparities.

    Parameters
    ----------
    output
        Video file, .mp4, .mov or .mkv: the left images beside the disparities in color; colors run
        from the smallest to the largest disparity searched, the same in all frames. From a
        recording also a recording, .mcap, .db3 or .bag: disparities, depths and points as messages.
    frames
        Files for the disparities in pixels, such as maps/%06d.pfm: the frame's number replaces
        %06d. .pfm, .npy, .tif, or .png in KITTI's format (16 bits, 256 d).
    rerun
        Recording for the viewer rerun, .rrd: images and disparities; needs the extra ``rerun``.
    rgbd
        Folder for images and depths, which must be empty. Needs --calib, a recording with
        camera_info, or --rectify with a calibration.
    rgbd_layout
        Layout of the folder: tum (the default), nerfstudio, or colmap, with normals.
    calib
        Calibration of the rectified views, as in ``phasestereo match``, for the camera, depths and
        points in --rerun and on the page.
    unit
        The unit of the baseline. Default: m, or mm for Middlebury's calib.txt.
    keep
        The pixels that get depths and points: trusted (the default), checked (fewer and more
        accurate ones), or all.
    min_depth
        Leave out everything nearer, in the unit of the baseline.
    max_depth
        Leave out everything further away, in the unit of the baseline.
    decimate
        One point or depth for each block of N by N pixels, in --rerun and recordings. Default 1.
    rate
        Frames per second of the video, if the source has no times; without it, 25.
    json
        Print one JSON object on standard output: settings, frames, failures, files.
    """

    output: Annotated[Path | None, Parameter(alias="-o")] = None
    frames: str | None = None
    rerun: Path | None = None
    rgbd: Path | None = None
    rgbd_layout: RgbdLayout | None = None
    calib: Path | None = None
    unit: LengthUnit | None = None
    keep: Keep = "trusted"
    min_depth: Annotated[float | None, Parameter(validator=POSITIVE)] = None
    max_depth: Annotated[float | None, Parameter(validator=POSITIVE)] = None
    decimate: Annotated[int, Parameter(validator=AT_LEAST_ONE)] = 1
    rate: Annotated[float | None, Parameter(validator=validators.Number(gt=0, lte=1000))] = None
    json: Annotated[bool, Parameter(negative=(), show_default=False)] = False

    def asked_for(self) -> bool:
        """Return whether the user asked for any output."""
        return bool(self.output or self.frames or self.rerun or self.rgbd or self.json)

    @property
    def selection(self) -> Selection:
        """The pixels that get depths and points.

        Raises
        ------
        ValueError
            If the range of depths is empty.
        """
        return Selection(
            keep=self.keep,
            min_depth=self.min_depth,
            max_depth=self.max_depth,
            decimate=self.decimate,
        )

    @property
    def recording(self) -> Path | None:
        """The recording to write, or None."""
        is_one = self.output is not None and self.output.suffix.lower() in RECORDINGS
        return self.output if is_one else None

    def check(self, sources: Iterable[Path], disparities: tuple[int, int], *, shown: bool) -> None:
        """Refuse outputs that cannot or must not be written, and make the folder of the frames.

        Raises
        ------
        CommandError
            If an option has no effect, a file is a source, a folder, or cannot be written, or a
            format cannot hold all of the disparities.
        """
        needs = (
            ("calib", self.rerun or self.rgbd or shown, "--rerun, --rgbd or --show"),
            ("rgbd_layout", self.rgbd, "--rgbd"),
            ("rate", self.output, "--output"),
        )
        for name, used, by in needs:
            if getattr(self, name) is not None and not used:
                raise wrong(name, f"has no effect without {by}")
        if self.calib is not None:
            refuse_picture("calib", self.calib)

        sources = list(sources)
        claim([("output", self.output), ("rerun", self.rerun)], sources)
        self._try(sources, disparities)

    def check_geometry(self, *, known: bool) -> None:
        """Refuse a folder of depths without a geometry, here or known from elsewhere.

        Raises
        ------
        CommandError
            If depths are wanted without a geometry.
        """
        if self.rgbd is not None and self.calib is None and not known:
            raise wrong("rgbd", _NO_GEOMETRY)

    def _try(self, sources: list[Path], disparities: tuple[int, int]) -> None:
        """Try every output before the first match."""
        with refusals(options={"min_depth"}):
            _ = self.selection
        with refusals():
            if self.recording is not None:
                _checked("output", partial(RecordingWriter, self.recording))
            elif self.output is not None:
                require("matplotlib", extra="plot")
                _checked("output", partial(VideoWriter, self.output))
            if self.rerun is not None:
                require("rerun", extra="rerun")
                _checked("rerun", partial(draft_of, self.rerun, (".rrd",), "recording"))
            if self.rgbd is not None:
                _checked("rgbd", partial(RgbdWriter, self.rgbd))
            if self.frames is not None:
                _check_frames(self.frames, sources, disparities)


class Writers:
    """Writes a frame to every output; the end of the ``with`` block completes the files.

    Parameters
    ----------
    outputs
        The outputs that the user asked for.
    tally
        The count of frames. It receives each file once that is complete, and its failures go to the
        recording, too.
    rate
        Frames per second of the source, if known.
    messages
        Makes the sink of a recording; None if the run writes no recording.
    known
        Returns the geometry of a frame, if known.
    """

    def __init__(
        self,
        outputs: LiveOutputs,
        tally: Tally,
        *,
        rate: float | None,
        messages: Callable[[RecordingWriter], FrameSink] | None,
        known: Geometry,
    ) -> None:
        self._outputs = outputs
        self._tally = tally
        self._messages = messages
        self._known = known
        self._rate = outputs.rate or rate or _RATE
        self._open = ExitStack()
        self.sinks: list[FrameSink] = []

    def __enter__(self) -> Self:
        # If one of them fails to open, this closes the ones that are already open.
        with ExitStack() as opened:
            recording = self._outputs.recording
            if recording is not None and self._messages is not None:
                messages = self._enter(opened, "output", recording, RecordingWriter(recording))
                self.sinks.append(_naming(recording)(self._messages(messages)))
            elif self._outputs.output is not None:
                self._add_video(opened, self._outputs.output)

            if self._outputs.frames is not None:
                self.sinks.append(partial(_write_frame, self._outputs.frames))
                self._tally.files["frames"] = self._outputs.frames

            if self._outputs.rerun is not None:
                self._add_recording(opened, self._outputs.rerun)
            if self._outputs.rgbd is not None:
                self._add_folder(opened, self._outputs.rgbd)

            self._open = opened.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        with interrupts_postponed():
            self._open.close()

    def _enter(
        self, opened: ExitStack, name: str, path: Path, writer: AbstractContextManager[Any]
    ) -> Any:
        """Return the writer of a file; the tally lists the file once it is complete."""

        def close(*error: Any) -> None:
            with _naming(path):
                writer.__exit__(*error)
            self._tally.files[name] = str(path)

        entered = writer.__enter__()
        opened.push(close)
        return entered

    def _add_video(self, opened: ExitStack, path: Path) -> None:
        video = self._enter(opened, "output", path, VideoWriter(path, rate=self._rate))
        pictures: list[FramePicture] = []

        @_naming(path)
        def write(frame: Frame) -> None:
            if not pictures:  # all frames take the colors of the first one's range
                pictures.append(FramePicture(*self._tally.searched(frame)))
            video.write(pictures[0](frame), frame.time)

        self.sinks.append(write)

    def _add_recording(self, opened: ExitStack, path: Path) -> None:
        selection = self._outputs.selection
        recording = self._enter(opened, "rerun", path, saving(path))

        def log(frame: Frame) -> None:
            low, high = self._tally.searched(frame)
            log_frame(
                frame,
                low=low,
                high=high,
                calibration=self._known(frame),
                selection=selection,
                recording=recording,
            )

        self.sinks.append(log)
        self._tally.listeners.append(partial(log_failure, recording=recording))

    def _add_folder(self, opened: ExitStack, path: Path) -> None:
        layout = self._outputs.rgbd_layout or LAYOUTS[0]
        folder = self._enter(opened, "rgbd", path, RgbdWriter(path, layout))
        selection = self._outputs.selection

        @_naming(path)
        def write(frame: Frame) -> None:
            calibration = self._known(frame)
            if calibration is None:
                raise ValueError(f"--rgbd: {_NO_GEOMETRY}")
            folder.write(frame, calibration, selection=selection)

        self.sinks.append(write)


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Name the file, not its draft, in errors of the system such as a full disk."""
    try:
        yield
    except OSError as error:
        if error.errno is None:  # NumPy's
            raise OSError(f"{path}: {error}") from error
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from error


def _write_frame(pattern: str, frame: Frame) -> None:
    path = Path(pattern % frame.index)
    with _naming(path):
        write_disparity(path, frame.result.disparity)


def _check_frames(pattern: str, sources: list[Path], disparities: tuple[int, int]) -> None:
    try:
        # A pattern that ignores the number, or a digit of it, would overwrite frames.
        distinct = len({pattern % 0, pattern % 1, pattern % 11}) == 3
    except (TypeError, ValueError):
        distinct = False
    if not distinct:
        raise wrong(
            "frames", f"got {pattern}; accepts a name with one number, such as maps/%06d.pfm"
        )

    folder = Path(pattern % 0).parent
    if os.path.realpath(folder) in {os.path.realpath(source) for source in sources}:
        raise wrong("frames", f"{folder} holds the images")

    folder.mkdir(parents=True, exist_ok=True)

    # If the format holds the extremes, it holds all disparities.
    low, count = disparities
    extremes = np.array([[low, low + count - 1]], dtype=np.float32)
    draft = folder / f".{secrets.token_hex(8)}{Path(pattern % 0).suffix}"
    try:
        _checked("frames", partial(write_disparity, draft, extremes))
    finally:
        draft.unlink(missing_ok=True)


def _checked(name: str, attempt: Callable[[], object]) -> None:
    """Try something; if it refuses a value, blame the option."""
    try:
        attempt()
    except ValueError as error:
        raise CommandError(f"{option(name)}: {error}", WRONG_USAGE) from error

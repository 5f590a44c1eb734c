"""``phasestereo live``: makes a disparity map for each frame of videos, folders or cameras."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

from contextlib import ExitStack, closing, suppress
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Group, Parameter

from phasestereo._interrupts import interrupts_postponed
from phasestereo.cli.errors import WRONG_USAGE, CommandError, refusals, wrong
from phasestereo.cli.options import (
    AT_LEAST_ONE,
    NOT_NEGATIVE,
    REASONABLE,
    SETTINGS_HELP,
    Count,
    Overrides,
    Threads,
)
from phasestereo.cli.pairing import AUTO, as_calibration, read_masks
from phasestereo.cli.terminal import say
from phasestereo.io import Calibration, LengthUnit
from phasestereo.io.folders import folders_of
from phasestereo.io.pair import Layout
from phasestereo.io.rigs.reading import read_cameras
from phasestereo.known import Known
from phasestereo.rig.findings import unwarned
from phasestereo.rigs import REESTIMATE
from phasestereo.settings import PRESET, PRESETS, Settings, resolve
from phasestereo_live.cli.outputs import FrameSink, Geometry, LiveOutputs, Writers
from phasestereo_live.cli.recordings import Messages, Topics
from phasestereo_live.cli.show import ClosedError, Screen, ViewOptions, serve
from phasestereo_live.cli.tally import Tally
from phasestereo_live.ros.recordings import Recording
from phasestereo_live.video.cameras import PATIENCE
from phasestereo_live.video.decoding import is_address
from phasestereo_live.video.streaming import Failure, Frame, Stream, stream

_MASKS = {"left_mask", "right_mask"}
_VALUES = {"preset", "num_disparities", "min_disparity", "threads", "noise", "layout", "rectify"}
_OPTIONS = (
    _VALUES
    | _MASKS
    | {"second", "timeout"}
    | {"start", "stop", "every", "reestimate"}
    | {field.name for field in fields(Settings)}
)

_TOPIC_OPTIONS = {field.name for field in fields(Topics)}

_SOURCE = Group.create_ordered("Source")
_SEARCH = Group.create_ordered("Search")
_RECORDING = Group.create_ordered("Recordings of robots")
_OUTPUT = Group.create_ordered("Output")
_SETTINGS = Group.create_ordered("Settings", help=SETTINGS_HELP)
_OUTPUTS, _TOPICS, _MESSAGES, _VIEW = LiveOutputs(), Topics(), Messages(), ViewOptions()
_PRESET_HELP = f"Settings to start from: {', '.join(PRESETS)}; fast for frame rates."
_NO_FRAME = "the source has no frame to match"
_MORE = Parameter(group=_SOURCE, consume_multiple=True, show_default=False)


def live(
    source: Annotated[str | None, Parameter(group=_SOURCE)] = None,
    right: Annotated[str | None, Parameter(group=_SOURCE)] = None,
    /,
    *,
    cameras: Annotated[tuple[int, ...], _MORE] = (),
    layout: Annotated[Layout | None, Parameter(group=_SOURCE)] = None,
    rectify: Annotated[tuple[str, ...], Parameter(group=_SOURCE, show_default=False)] = (),
    vertical: Annotated[bool | None, Parameter(group=_SOURCE, show_default=False)] = None,
    start: Annotated[int, Parameter(group=_SOURCE, validator=NOT_NEGATIVE)] = 0,
    stop: Annotated[int | None, Parameter(group=_SOURCE, validator=NOT_NEGATIVE)] = None,
    every: Annotated[int, Parameter(group=_SOURCE, validator=AT_LEAST_ONE)] = 1,
    reestimate: Annotated[int, Parameter(group=_SOURCE, validator=AT_LEAST_ONE)] = REESTIMATE,
    temporal_filter: Annotated[bool, Parameter(group=_SOURCE)] = True,
    num_disparities: Annotated[Count, Parameter(group=_SEARCH, validator=AT_LEAST_ONE)] = None,
    min_disparity: Annotated[int, Parameter(group=_SEARCH, validator=REASONABLE)] = 0,
    threads: Annotated[Threads, Parameter(group=_SEARCH)] = None,
    left_mask: Annotated[Path | None, Parameter(group=_SEARCH)] = None,
    right_mask: Annotated[Path | None, Parameter(group=_SEARCH)] = None,
    noise: Annotated[float | None, Parameter(group=_SEARCH)] = None,
    second: Annotated[str | None, Parameter(group=_SEARCH)] = None,
    timeout: Annotated[float | None, Parameter(group=_SEARCH)] = None,
    showing: Annotated[ViewOptions, Parameter(name="*", group=_OUTPUT)] = _VIEW,
    outputs: Annotated[LiveOutputs, Parameter(name="*", group=_OUTPUT)] = _OUTPUTS,
    topics: Annotated[Topics, Parameter(name="*", group=_RECORDING)] = _TOPICS,
    messages: Annotated[Messages, Parameter(name="*", group=_RECORDING)] = _MESSAGES,
    preset: Annotated[str, Parameter(group=_SETTINGS, help=_PRESET_HELP)] = PRESET,
    overrides: Annotated[Overrides | None, Parameter(name="*", group=_SETTINGS)] = None,
) -> None:
    """Match every frame of a video, a folder of images, a recording, or a pair of cameras.

    ``--output``, ``--frames``, ``--rerun`` and ``--json`` say what to do with the disparities;
    without any of them a page in the browser shows them. The run reports and skips a frame that
    fails; all frames keep their numbers. Ctrl-C ends the run and keeps the frames matched so far.
    For example:

    ```
    phasestereo live --cameras 0 1 --show
    phasestereo live video.mp4 --num-disparities 64 --preset fast -o disparities.mp4
    phasestereo live --cameras 0 1 --num-disparities 64 --preset fast -o disparities.mp4
    phasestereo live left/ right/ --num-disparities 64 --frames maps/%06d.pfm
    phasestereo live drive.mcap --left /left/image_raw --right /right/image_raw -o depth.mcap
    ```

    Parameters
    ----------
    source
        A video file or address (rtsp://...) whose pictures hold both views, or a folder with both
        views, told apart by subfolders left and right or by names; with RIGHT, only the left view.
        Or a robot's recording, with --left and --right.
    right
        The right view: a second video or folder of images.
    cameras
        Numbers of the left and the right camera, or of one camera that delivers both views in each
        picture; use it instead of SOURCE.
    layout
        How a picture holds both views: side-by-side (the default), or top-bottom with the left view
        above. With a folder: its images hold both views.
    rectify
        Rectify the frames first: with a calibration or a saved rectification (twice for the files
        of both cameras), or auto, from the first frame. Needs the extra ``rectify``.
    vertical
        The right camera is below the left one. A calibration already says so, and so do frames that
        show it clearly, unless --no-vertical.
    start
        Number of the first frame to match.
    stop
        Number of the frame to stop before.
    every
        Match every N-th frame.
    reestimate
        Estimate blur again when a quick check shows a change, and at the latest after this number
        of frames; 1: for every frame.
    temporal_filter
        Make disparities steadier where neither image changed.
    num_disparities
        Number of disparities to search, 1 to the images' width; auto: find the range.
    min_disparity
        Smallest disparity to search.
    threads
        Number of threads; without it, one per processor.
    left_mask
        Image of the same size as the left images before they are rectified, non-zero where they are
        valid.
    right_mask
        The same for the right images.
    noise
        Standard deviation of the images' noise, in units of their pixels; needed with
        --noise-threshold.
    second
        A second matcher for every frame: sgbm, bm, or onnx:net.onnx, as in `match`.
    timeout
        Seconds that the second matcher may take for a frame.
    """
    places = _places(source, right, cameras)
    calibration = as_calibration(rectify) if rectify else ()
    shown = showing.is_wanted(alone=not outputs.asked_for())
    recorded = topics.check(places)
    if outputs.recording is not None and recorded is None:
        raise wrong("output", "a recording is written of a recording")

    with refusals(options=_OPTIONS):
        masks = read_masks(left_mask, right_mask)
        settings = resolve(preset, None, overrides or {})
        known = Known(noise=noise)
    disparities = min_disparity, num_disparities
    outputs.check(_files(places), (min_disparity, num_disparities or 1), shown=shown)

    tally = Tally(disparities, settings)
    given: dict[str, Any] = {
        "layout": layout,
        "start": start,
        "stop": stop,
        "every": every,
        "reestimate": reestimate,
        "temporal_filter": temporal_filter,
        "num_disparities": num_disparities,
        "min_disparity": min_disparity,
        "settings": settings,
        "threads": threads,
        "left_mask": masks[0],
        "right_mask": masks[1],
        "known": known,
        "vertical": vertical,
        "second": second,
        "timeout": timeout,
        "on_error": tally.fail,
        "patience": None if shown else PATIENCE,  # a user who watches plugs it in again
    }

    by: Any = AUTO if calibration is None else calibration or None

    with ExitStack() as opened:
        recording = None if recorded is None else _opened(opened, topics, recorded)
        if recording is not None:
            places, by = (recording,), by or recording.cameras
            if vertical is None and by is recording.cameras:
                given["vertical"] = recording.vertical

        is_known = bool(calibration) or (recording is not None and recording.q is not None)
        messages.check(wanted=outputs.recording is not None, known=is_known)
        outputs.check_geometry(known=is_known)

        with refusals(options=_OPTIONS):
            frames = opened.enter_context(closing(stream(*places, rectify=by, **given)))
            _check_start(start, frames.source_length)
            known_of = _knowing(outputs, recording, frames)
            screen = None
            if shown:
                show = serve(opened, settings, num_disparities, showing.save_to or Path())
                paced = not (outputs.asked_for() or cameras)
                screen = Screen(show, known_of, paced=paced)

        sink = None
        if recording is not None:
            sink = partial(messages.sink, recording, outputs.selection, known_of)
        try:
            with unwarned(), refusals(options=_OPTIONS):
                writers = Writers(outputs, tally, rate=frames.rate, messages=sink, known=known_of)
                _run(frames, writers, tally, screen)
        finally:
            tally.show(as_json=outputs.json)

    if tally.interrupted:
        raise KeyboardInterrupt
    if not tally.done and not shown:
        if not tally.failed:
            raise CommandError(_NO_FRAME)
        raise CommandError(f"none of {tally.failed} frames could be matched")


def _opened(opened: ExitStack, topics: Topics, path: Path) -> Recording:
    """Open a recording, and report how the run uses its calibration."""
    with refusals(options=_TOPIC_OPTIONS):
        recording = topics.open(path)
    opened.callback(recording.close)
    say(recording.note)
    return recording


def _check_start(start: int, length: int | None) -> None:
    """Refuse a first frame beyond the last one of a source of this length; None: unknown."""
    if start and length is not None and start >= length:
        raise wrong("start", f"got {start}; accepts less than {length}, the number of frames")


def _run(frames: Stream, writing: Writers, tally: Tally, screen: Screen | None) -> None:
    """Match, write and show all frames, until Ctrl-C or until the user closes the page."""
    if screen is not None:
        screen.follow(frames)
        tally.listeners.append(screen.fail)
        tally.reports_news_alone = True

    try:
        with suppress(ClosedError), writing as writers, tally.shown(frames.length):
            for frame in frames:
                with interrupts_postponed():
                    _write(frame, writers.sinks, tally)
                if screen is not None:
                    screen.add(frame, frames)
                    if screen.closed:
                        return
        if screen is not None:
            if not (tally.done or tally.failed or screen.closed):
                raise CommandError(_NO_FRAME)
            screen.stay()
    except KeyboardInterrupt:
        tally.interrupted = screen is None  # a show ends this way


def _knowing(outputs: LiveOutputs, recording: Recording | None, frames: Stream) -> Geometry:
    """Return a function that gives a frame's geometry, in m unless another unit is known.

    Raises
    ------
    OSError, ValueError, ImportError
        If the calibration cannot be read.
    """
    cameras = None if outputs.calib is None else read_cameras(outputs.calib)
    found: list[Calibration] = []

    def known(frame: Frame) -> Calibration | None:
        if not found:
            calibration = of_frame(frame)
            if calibration is None:
                return None
            unit: LengthUnit | None = outputs.unit or calibration.unit
            found.append(replace(calibration, unit=unit))
        return found[0]

    def of_frame(frame: Frame) -> Calibration | None:
        rows, cols = frame.result.disparity.shape
        if cameras is not None:
            calibration, notes = cameras.geometry((cols, rows))
            for note in notes:
                say(f"note: {note}")
            return calibration
        if frames.rectification is not None:
            return frames.rectification.calibration
        if recording is None or recording.q is None:
            return None
        return Calibration.from_q(recording.q, width=cols, height=rows, unit="m")

    return known


def _write(frame: Frame, sinks: list[FrameSink], tally: Tally) -> None:
    """Write a frame to every sink; an error in one does not stop the others."""
    tally.report_news(frame)
    errors = []
    for write in sinks:
        try:
            write(frame)
        except (ValueError, TypeError) as error:
            errors.append(error)

    if errors:
        tally.fail(Failure(frame.index, frame.time, errors[0]))
    else:
        tally.count(frame)


def _places(source: str | None, right: str | None, cameras: tuple[int, ...]) -> tuple[Any, ...]:
    """Return the source for `stream`, and the right view if it is separate."""
    if cameras:
        if source is not None:
            raise wrong("cameras", "got SOURCE as well; accepts one of both")
        if len(cameras) > 2 or min(cameras) < 0:
            got = " ".join(map(str, cameras))
            raise wrong("cameras", f"got {got}; accepts one or two numbers")
        return cameras

    if source is None:
        raise CommandError("SOURCE is missing: a video, a folder, or --cameras 0 1", WRONG_USAGE)
    return (source,) if right is None else (source, right)


def _files(places: tuple[Any, ...]) -> list[Path]:
    """Return the files and folders that the run reads."""
    paths = [Path(place) for place in places if isinstance(place, str) and not is_address(place)]
    return [read for path in paths for read in (folders_of(path) if path.is_dir() else [path])]

"""What ``phasestereo live`` shows while it runs: a page in the browser, or a window of OpenCV's."""

# No `from __future__ import annotations`: the command line is made of these annotations.

import os
import sys
import webbrowser
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from phasestereo._extras import require
from phasestereo.cli.errors import WRONG_USAGE, CommandError
from phasestereo.cli.terminal import say
from phasestereo.io import Calibration
from phasestereo.settings import Settings
from phasestereo_live.video import FramePicture
from phasestereo_live.video.streaming import Failure, Frame, Stream
from phasestereo_live.viewer import Server, Show
from phasestereo_live.viewer.diagnosing import diagnosing

Way = Literal["page", "window"]

_TITLE = "phasestereo (Esc ends the run)"
_ENDS = {27, ord("q")}  # keys
_GLANCE = 50  # ms
_ROWS_OFF = 1.0  # pixels rms: from here on rows are warned of
_LONGEST_PAUSE = 1.0  # seconds between frames of a file: recordings may have gaps


class ClosedError(Exception):
    """The user has ended the run on the page."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Showing:
    """What is shown.

    Parameters
    ----------
    show
        Show frames, disparities and what is found while the run lasts: on a page in the browser,
        which is served on this machine alone, or with --show=window in a window, where OpenCV has
        them. Without an output this is what is done.
    save_to
        Folder where the page saves pairs. Default: the current one.
    """

    show: Annotated[
        tuple[Way, ...] | None, Parameter(consume_multiple=True, negative=(), show_default=False)
    ] = None
    save_to: Path | None = None

    def way(self, *, alone: bool) -> Way | None:
        """Return what is to be opened; ``alone``: nothing else comes out.

        Raises
        ------
        CommandError
            If options have no effect, or a folder is none.
        """
        if self.show is not None and len(self.show) > 1:
            raise CommandError("--show: accepts page or window", WRONG_USAGE)
        way: Way | None = None if self.show is None and not alone else "page"

        if self.show:
            way = self.show[0]

        if self.save_to is not None and way != "page":
            raise CommandError("--save-to: has no effect without --show", WRONG_USAGE)
        if self.save_to is not None and not self.save_to.is_dir():
            raise CommandError(f"--save-to: {self.save_to} is no folder")
        return way


class Screen:
    """Where frames and failures are seen; what stays to be said is on the terminal, too.

    Parameters
    ----------
    calibration
        The geometry of the pair; None: that of the rectification, if there is one.
    unit
        That of its baseline; "" if it is not known.
    paced
        Whether frames of files wait until it is their time.
    """

    def __init__(self, calibration: Calibration | None, unit: str, *, paced: bool) -> None:
        self._calibration = calibration
        self._unit = unit
        self._paced = paced
        self._start: float | None = None  # when the first frame was due
        self._is_first = True
        self.closed = False

    def follow(self, frames: Stream) -> None:
        """Let what is shown change how the coming frames are matched."""

    def add(self, frame: Frame, frames: Stream) -> None:
        """Show a frame, and with the first one whether the calibration is right."""
        if self._is_first:
            self._is_first = False
            self._judge(frame, frames)

        if self._paced and frame.time is not None:
            self._wait(frame.time)
        self._draw(frame)

    def fail(self, failure: Failure) -> None:
        """Show what failed.

        Raises
        ------
        ClosedError
            If nobody looks any more.
        """
        self._fail(failure)
        if self.closed:
            raise ClosedError

    def stay(self) -> None:
        """Keep what is shown after the last frame, until it is closed."""

    def _draw(self, frame: Frame) -> None:
        raise NotImplementedError

    def _fail(self, failure: Failure) -> None:
        raise NotImplementedError

    def _note(self, text: str) -> None:
        say(f"warning: {text}")

    def _know(self, calibration: Calibration, unit: str) -> None:
        """Take the geometry."""

    def _judge(self, frame: Frame, frames: Stream) -> None:
        """Check the calibration once, against the first frame."""
        found = frames.rectification
        if found is not None and (found.error is None or found.error > _ROWS_OFF):
            self._note("; ".join(found.sentences))

        shape = frame.result.disparity.shape
        known, unit = self._calibration, self._unit
        if known is None and frames.q is not None:
            known = Calibration.from_q(frames.q, width=shape[1], height=shape[0])

        if known is None:
            return
        try:
            known.check_size(shape)
        except ValueError as error:
            self._note(f"{error}: there are no depths")
        else:
            self._know(known, unit)

    def _wait(self, time: float) -> None:
        now = monotonic()
        self._start = now - time if self._start is None else self._start

        early = self._start + time - now
        # Where the source has a gap, or matching is behind, the clock starts anew.
        if early > _LONGEST_PAUSE or early < -_LONGEST_PAUSE:
            self._start = now - time
        elif early > 0:
            sleep(early)


class PageScreen(Screen):
    """The page.

    Parameters
    ----------
    show
        What it shows.
    **more
        As `Screen` takes them.
    """

    def __init__(self, show: Show, **more: Any) -> None:
        super().__init__(**more)
        self._show = show

    def follow(self, frames: Stream) -> None:
        """Let the page change how the coming frames are matched."""
        self._show.follow(frames.change)

    def stay(self) -> None:
        """Keep the page after the last frame, until it is closed or Ctrl-C."""
        self._show.end("no more frames come; what is shown is the last one")
        while not self._show.wait_closed(0.5):
            pass

    def _draw(self, frame: Frame) -> None:
        self._show.add(frame)
        self.closed = self._show.closed

    def _fail(self, failure: Failure) -> None:
        self._show.fail(failure)
        self.closed = self._show.closed

    def _note(self, text: str) -> None:
        super()._note(text)
        self._show.note("calibration", text)

    def _know(self, calibration: Calibration, unit: str) -> None:
        self._show.know(calibration, unit)


class WindowScreen(Screen):
    """A window of OpenCV's: the left image beside the disparities."""

    def stay(self) -> None:
        """Keep the window after the last frame, until it is closed or Ctrl-C."""
        while not self.closed:
            self._listen(_GLANCE)

    def _draw(self, frame: Frame) -> None:
        cv2 = require("cv2", extra="live")
        search = frame.result.search
        low, count = (0, 1) if search is None else (search.min_disparity, search.num_disparities)

        picture = FramePicture(low, low + count)(frame)
        cv2.imshow(_TITLE, picture[:, :, ::-1])
        self._listen()

    def _fail(self, failure: Failure) -> None:  # noqa: ARG002 - the terminal says it
        self._listen()

    def _listen(self, milliseconds: int = 1) -> None:
        cv2 = require("cv2", extra="live")
        pressed = cv2.waitKey(milliseconds) & 0xFF

        is_gone = cv2.getWindowProperty(_TITLE, cv2.WND_PROP_VISIBLE) < 1
        self.closed = self.closed or pressed in _ENDS or is_gone


def opened(
    stack: ExitStack,
    way: Way,
    *,
    settings: Settings,
    num_disparities: int | None,
    folder: Path | None,
    **more: Any,
) -> Screen:
    """Open the window, or the page; where OpenCV has no windows, the page.

    Raises
    ------
    ImportError
        If the extra ``live`` is not installed.
    OSError
        If no port is free.
    """
    if way == "window" and _has_windows():
        stack.callback(require("cv2", extra="live").destroyAllWindows)
        return WindowScreen(**more)

    if way == "window":
        say("note: this OpenCV has no windows: the page is opened instead")
    show = Show(settings, num_disparities, folder or Path())
    _serve(stack, show)
    return PageScreen(show, **more)


def _serve(stack: ExitStack, show: Show) -> None:
    """Serve the page until the stack is left, and open it where somebody sits."""
    server = stack.enter_context(Server(show))
    thread = diagnosing(show)
    stack.callback(thread.join)
    stack.callback(show.close)
    say(f"look at {server.address}")
    if sys.stderr.isatty():
        webbrowser.open(server.address)


def _has_windows() -> bool:
    """Return whether OpenCV can open a window: on Linux without a display Qt ends the process."""
    cv2 = require("cv2", extra="live")
    if sys.platform == "linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        return False

    try:
        cv2.namedWindow(_TITLE, cv2.WINDOW_NORMAL)
    except cv2.error:
        return False
    return True

"""The page in the browser that ``phasestereo live`` shows while it runs."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

import sys
import webbrowser
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, sleep
from typing import Annotated

from cyclopts import Parameter

from phasestereo.cli.errors import refusals, wrong
from phasestereo.cli.terminal import say
from phasestereo.io import Calibration
from phasestereo.settings import Settings
from phasestereo_live.video.streaming import Failure, Frame, Stream
from phasestereo_live.viewer import Display, Server
from phasestereo_live.viewer.diagnosing import diagnosing

_ROWS_OFF = 1.0  # pixels rms: from here on the page warns of rows
_LONGEST_PAUSE = 1.0  # seconds between frames of a file: recordings may have gaps


class ClosedError(Exception):
    """The user ended the run on the page."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewOptions:
    """The options of the page.

    Parameters
    ----------
    show
        Show frames, disparities and findings during the run on a page in the browser, which only
        this machine can open. This is the default without an output.
    save_to
        Folder where the page saves pairs; the command makes it if necessary. Default: the current
        folder.
    """

    show: Annotated[bool, Parameter(negative=(), show_default=False)] = False
    save_to: Path | None = None

    def is_wanted(self, *, alone: bool) -> bool:
        """Return whether to open the page; ``alone``: the run has no other output.

        Raises
        ------
        CommandError
            If options have no effect, or the folder cannot be made.
        """
        shown = self.show or alone
        if self.save_to is not None and not shown:
            raise wrong("save_to", "has no effect without --show")
        if self.save_to is not None:
            with refusals():
                self.save_to.mkdir(parents=True, exist_ok=True)
        return shown


class Screen:
    """The page, which shows frames and failures; lasting messages go to the terminal, too.

    Parameters
    ----------
    show
        The page itself.
    known
        Returns the geometry of a frame, if known.
    paced
        Whether frames of files wait for their time.
    """

    def __init__(
        self, show: Display, known: Callable[[Frame], Calibration | None], *, paced: bool
    ) -> None:
        self._show = show
        self._known = known
        self._paced = paced
        self._start: float | None = None  # when the first frame was due
        self._is_first = True

    @property
    def closed(self) -> bool:
        """Whether the user ended the run."""
        return self._show.closed

    def follow(self, frames: Stream) -> None:
        """Let the page change the settings for the next frames."""
        self._show.follow(frames.change)

    def add(self, frame: Frame, frames: Stream) -> None:
        """Show a frame; with the first one, also show whether the calibration is right."""
        if self._is_first:
            self._is_first = False
            self._judge(frame, frames)

        if self._paced and frame.time is not None:
            self._wait(frame.time)
        self._show.add(frame)

    def fail(self, failure: Failure) -> None:
        """Show a failure.

        Raises
        ------
        ClosedError
            If the user ended the run on the page.
        """
        self._show.fail(failure)
        if self.closed:
            raise ClosedError

    def stay(self) -> None:
        """Keep the page after the last frame, until the user closes it or presses Ctrl-C."""
        self._show.end("no more frames come; what is shown is the last one")
        say("the last frame is shown until you press 'End the run' on the page, or Ctrl-C")
        while not self._show.wait_closed(0.5):
            pass

    def _note(self, text: str) -> None:
        say(f"warning: {text}")
        self._show.note("calibration", text)

    def _judge(self, frame: Frame, frames: Stream) -> None:
        """Check the calibration once, with the first frame."""
        found = frames.rectification
        if found is not None and (found.error is None or found.error > _ROWS_OFF):
            self._note("; ".join(found.sentences))

        try:
            known = self._known(frame)
        except ValueError as error:
            self._note(f"{error}: there are no depths")
            return
        if known is not None:
            self._show.know(known, known.unit or "")

    def _wait(self, time: float) -> None:
        now = monotonic()
        self._start = now - time if self._start is None else self._start

        early = self._start + time - now
        # If the source has a gap, or matching falls behind, the clock restarts.
        if early > _LONGEST_PAUSE or early < -_LONGEST_PAUSE:
            self._start = now - time
        elif early > 0:
            sleep(early)


def serve(
    stack: ExitStack, settings: Settings, num_disparities: int | None, folder: Path
) -> Display:
    """Serve the page until the stack closes, and open it if a user is at the terminal.

    Raises
    ------
    ImportError
        If the extra ``live`` is not installed.
    OSError
        If no port is free.
    """
    show = Display(settings, num_disparities, folder)
    server = stack.enter_context(Server(show))
    thread = diagnosing(show)
    stack.callback(thread.join)
    stack.callback(show.close)

    say(f"look at {server.address}")
    if sys.stderr.isatty():
        # Every user of this machine sees a browser's command line, so it only names a file.
        home = Path(stack.enter_context(TemporaryDirectory(prefix="phasestereo-")))
        webbrowser.open(server.write_link(home / "viewer.html").as_uri())
    return show

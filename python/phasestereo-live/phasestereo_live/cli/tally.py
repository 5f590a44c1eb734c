"""Progress of a run over many frames: on the terminal during the run, with totals at its end."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from time import monotonic
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn

import phasestereo
from phasestereo.cli.errors import spelled
from phasestereo.cli.terminal import print_json, print_lines, say
from phasestereo.settings import Settings
from phasestereo_live.ros.pairing import UnpairedError
from phasestereo_live.video.streaming import Failure, Frame

_KEPT = 1000  # failures to list: a camera may fail for days


class Tally:
    """Counts the frames.

    Parameters
    ----------
    disparities
        The smallest disparity searched and their number; None: found from the images.
    settings
        Settings of the matcher.

    Attributes
    ----------
    listeners
        Functions to call with every failure.
    reports_news_alone
        Whether to print a failure only if it differs from the one before: a camera may fail for
        hours.
    """

    def __init__(self, disparities: tuple[int, int | None], settings: Settings) -> None:
        self.disparities = disparities
        self.settings = settings
        self.done = 0
        self.failed = 0
        self.unpaired = 0
        self.interrupted = False
        self.files: dict[str, str] = {}
        self.listeners: list[Callable[[Failure], object]] = []
        self.reports_news_alone = False

        self._last = ""  # message of the last failure
        self._failures: list[dict[str, Any]] = []
        self._topics: set[str] = set()
        self._size: tuple[int, ...] | None = None
        self._start = monotonic()
        self._seconds = 0.0
        self._changed: Callable[[], object] | None = None

    def report_news(self, frame: Frame) -> None:
        """Print the findings of a frame that have a new topic."""
        for found in frame.result.findings:
            if found.topic not in self._topics:
                self._topics.add(found.topic)
                say(f"frame {frame.index}: {found.severity}: {spelled(found.sentence)}")

    def searched(self, frame: Frame) -> tuple[int, int]:
        """Return the first disparity searched and the one after the last.

        If the run finds the range, this is the range of the first frame.
        """
        low, count = self.disparities
        search = frame.result.search
        if count is None and search is not None:
            low, count = self.disparities = search.min_disparity, search.num_disparities

        return low, low + (count or 1)

    def count(self, frame: Frame) -> None:
        """Count a finished frame."""
        self.done += 1
        self._size = frame.result.disparity.shape
        self.searched(frame)
        self._change()

    def fail(self, failure: Failure) -> None:
        """Count a frame that failed, and report it at once."""
        self.failed += 1
        self.unpaired += isinstance(failure.error, UnpairedError)
        if len(self._failures) < _KEPT:
            said = {"frame": failure.index, "error": " ".join(str(failure.error).split())}
            self._failures.append(said)

        if not self.reports_news_alone or str(failure.error) != self._last:
            say(f"skipped {' '.join(str(failure).split())}")

        self._last = str(failure.error)

        self._change()
        for listener in self.listeners:
            listener(failure)

    @contextmanager
    def shown(self, length: int | None) -> Iterator[None]:
        """Show the count on standard error during the block, if that is a terminal."""
        self._start = monotonic()
        console = Console(stderr=True, highlight=False, soft_wrap=True)
        columns = SpinnerColumn(), TextColumn("{task.description}"), BarColumn()

        try:
            with Progress(
                *columns, console=console, transient=True, disable=not sys.stderr.isatty()
            ) as bar:
                task = bar.add_task(self._line(), total=length)
                # Every counted frame moves the bar.
                self._changed = lambda: bar.update(
                    task, completed=self.done + self.failed, description=self._line()
                )
                yield
        finally:
            self._changed = None
            self._seconds = monotonic() - self._start

    def show(self, *, as_json: bool) -> None:
        """Print the totals on standard output."""
        if as_json:
            print_json(self.as_dict())
            return

        size = "" if self._size is None else f" of {self._size[1]} x {self._size[0]} pixels"
        line = f"{self._line()}{size}, {self.disparities[1] or 'no'} disparities"
        files = self.files.values() if self.done else ()
        print_lines([line, *(f"wrote {path}" for path in files)])

    def as_dict(self) -> dict[str, Any]:
        """Return all counts as a dict for JSON."""
        rows, cols = self._size or (None, None)
        return {
            "version": phasestereo.__version__,
            "width": cols,
            "height": rows,
            "min_disparity": self.disparities[0],
            "num_disparities": self.disparities[1],
            "settings": asdict(self.settings),
            "frames": self.done,
            "failed": self.failed,
            "unpaired": self.unpaired,
            "failures": self._failures,
            "interrupted": self.interrupted,
            "seconds": self._seconds,
            "frames_per_second": self._rate(self._seconds),
            "files": self.files if self.done else {},
        }

    def _change(self) -> None:
        if self._changed is not None:
            self._changed()

    def _line(self) -> str:
        rate = self._rate(self._seconds or monotonic() - self._start)
        alone = f" ({self.unpaired} without a partner)" if self.unpaired else ""
        return f"{self.done} frames, {self.failed} failed{alone}, {rate:.1f} frames/s"

    def _rate(self, seconds: float) -> float:
        return self.done / seconds if seconds else 0.0

"""The state to show: the last frame, failures and findings, for all waiting threads."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Condition, Lock
from time import monotonic
from typing import Any, NamedTuple

import numpy as np

from phasestereo.io import Calibration, write_image
from phasestereo.rig.diagnosis import Diagnosis
from phasestereo.rig.findings import Finding
from phasestereo.settings import Settings
from phasestereo.views.page import write_pair_page
from phasestereo_live.video.streaming import Failure, Frame
from phasestereo_live.viewer.frames import packed

Change = Callable[["Settings", int | None], None]
"""Matches the next frames with other settings and another number of disparities."""

RANGES: Mapping[str, tuple[float, float]] = {
    "p1": (0, 100),
    "p2": (0, 400),
    "uniqueness": (0, 100),
    "speckle_size": (0, 5000),
    "num_disparities": (0, 1024),
    "fill": (0, 1),
}
"""Settings of the page and their ranges; 0 disparities: estimated."""

_ORDER = "ok", "note", "warning"
_APART = 0.004  # seconds: in less, a walking person moves by a few millimeters
_FORGET = 5.0  # seconds until a failure disappears
_SMOOTH = 0.8  # weight of the rate so far


class _Fault(NamedTuple):
    """A failure: its count in a row, and its last time."""

    text: str
    times: int
    at: float


class Display:
    """The state that the page shows, shared by any number of threads.

    Parameters
    ----------
    settings
        The settings for matching frames.
    num_disparities
        Number of disparities to search; None: found from the images.
    folder
        The folder for saved pairs.
    """

    def __init__(self, settings: Settings, num_disparities: int | None, folder: Path) -> None:
        self.settings = settings
        self.num_disparities = num_disparities
        self.folder = folder
        self.frame: Frame | None = None
        self.held: Frame | None = None
        self.closed = False

        self._changed = Condition()
        self._setting = Lock()
        self._version = 0
        self._change: Change | None = None

        self._calibration: Calibration | None = None
        self._unit = ""
        self._rate = 0.0
        self._last = math.nan  # time of the last frame
        self._failed = 0
        self._failure = _Fault("", 0, -math.inf)
        self._notes: dict[str, str] = {}
        self._ended = ""
        self._diagnosis: Diagnosis | None = None

    @contextmanager
    def _news(self) -> Iterator[None]:
        """Change something, and wake up all threads that wait for a change."""
        with self._changed:
            yield
            self._version += 1
            self._changed.notify_all()

    def follow(self, change: Change) -> None:
        """Show the frames of a stream, and change their settings from here."""
        with self._news():
            self._change, self._ended = change, ""

    def add(self, frame: Frame) -> None:
        """Show a frame."""
        with self._news():
            now = monotonic()
            # NaN is unequal to itself: before the first frame there is no rate.
            rate = 1 / max(now - self._last, 1e-3) if self._last == self._last else 0.0
            self._rate = _SMOOTH * self._rate + (1 - _SMOOTH) * rate if self._rate else rate
            self.frame, self._last = frame, now

            if frame.apart is not None and frame.apart > _APART:
                self._notes["apart"] = (
                    f"the cameras are not synchronized: the right one comes "
                    f"{1000 * frame.apart:.0f} ms later; what moves has wrong depths"
                )
            else:
                self._notes.pop("apart", None)

    def fail(self, failure: Failure) -> None:
        """Show a failure, and its count in a row."""
        text = " ".join(str(failure.error).split())
        with self._news():
            before = self._failure.times if text == self._failure.text else 0
            self._failure = _Fault(text, before + 1, monotonic())
            self._failed += 1

    def note(self, topic: str, text: str) -> None:
        """Show a sentence that stays."""
        with self._news():
            self._notes[topic] = text

    def diagnose(self, diagnosis: Diagnosis) -> None:
        """Show the findings about the pair."""
        with self._news():
            self._diagnosis = diagnosis

    def know(self, calibration: Calibration, unit: str) -> None:
        """Show depths from now on; the unit is "" if that of the baseline is unknown."""
        with self._news():
            self._calibration, self._unit = calibration, unit

    def end(self, why: str) -> None:
        """Show that no more frames will come, and the reason."""
        with self._news():
            self._ended = why

    def close(self) -> None:
        """Close the show: all waiting threads give up."""
        with self._news():
            self.closed = True

    def wait(self, version: int, seconds: float) -> dict[str, Any]:
        """Return the whole state once it is newer than a version, or after some time."""
        with self._changed:
            self._changed.wait_for(lambda: self.closed or self._version > version, seconds)
            return self._state()

    def wait_closed(self, seconds: float) -> bool:
        """Wait for the show to close; return whether it did."""
        with self._changed:
            return self._changed.wait_for(lambda: self.closed, seconds)

    def _state(self) -> dict[str, Any]:
        fault = self._failure
        is_news = monotonic() - fault.at < _FORGET
        found = () if self._diagnosis is None else self._diagnosis.findings
        grave = () if self.frame is None else self.frame.result.findings

        return {
            "version": self._version,
            "closed": self.closed,
            "ended": self._ended,
            "frame": self._frame_state(),
            "failed": self._failed,
            "failure": {"text": fault.text, "times": fault.times} if is_news else None,
            "notes": list(self._notes.values()),
            "findings": _worst_first((*grave, *found)),
            "settings": self._settings_state(),
        }

    def _frame_state(self) -> dict[str, Any] | None:
        if self.frame is None:
            return None

        rows, cols = self.frame.result.disparity.shape
        return {
            "index": self.frame.index,
            "time": self.frame.time,
            "width": cols,
            "height": rows,
            "rate": round(self._rate, 1),
            "verdict": self.frame.result.verdict,
            "trusted": round(100 * float(self.frame.result.trusted.mean()), 1),
        }

    def ends(self) -> tuple[int, int]:
        """Return the disparities at the ends of the colors: the ends of the searched range."""
        frame = self.looked_at
        search = None if frame is None else frame.result.search
        if search is None:
            return 0, self.num_disparities or 1
        return search.min_disparity, search.min_disparity + search.num_disparities

    def _settings_state(self) -> dict[str, float]:
        return {
            "p1": self.settings.p1,
            "p2": self.settings.p2,
            "uniqueness": self.settings.uniqueness,
            "speckle_size": self.settings.speckle_size,
            "num_disparities": self.num_disparities or 0,
            "fill": int(self.settings.fill),
        }

    def set(self, wanted: Mapping[str, Any]) -> None:
        """Match the next frames with other settings.

        Parameters
        ----------
        wanted
            Numbers by the names of `RANGES`; others stay.

        Raises
        ------
        TypeError, ValueError
            If a name is unknown, a value is not a number or out of its range, or
            `phasestereo.match` refuses it.
        """
        for name, value in wanted.items():
            if name not in RANGES:
                raise ValueError(f"{name}: is not a setting; accepts {', '.join(RANGES)}")
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise TypeError(f"{name}: got {type(value).__name__}; accepts a number")
            low, high = RANGES[name]
            if not low <= value <= high:
                raise ValueError(f"{name}: got {value:g}; accepts {low:g} to {high:g}")

        with self._setting:  # two browsers may be open
            self._set(wanted)

    def _set(self, wanted: Mapping[str, Any]) -> None:

        values = {**self._settings_state(), **wanted}
        settings = replace(
            self.settings,
            p1=float(values["p1"]),
            p2=float(values["p2"]),
            uniqueness=int(values["uniqueness"]),
            speckle_size=int(values["speckle_size"]),
            fill=bool(values["fill"]),
        )

        count = int(values["num_disparities"]) or None
        # Invalid settings raise here, and the page does not show them.
        if self._change is not None:
            self._change(settings, count)

        with self._news():
            self.settings, self.num_disparities = settings, count

    def hold(self, on: object) -> None:
        """Keep the last frame, to view and save it while others come, or stop keeping one."""
        self.held = self.frame if on is True else None

    @property
    def looked_at(self) -> Frame | None:
        """The kept frame, or the last one."""
        return self.held or self.frame

    def packed(self, frame: Frame) -> bytes:
        """Return a frame in the page's format."""
        return packed(frame, self._calibration, self._unit, self.ends())

    def save(self, *, report: bool = True) -> list[str]:
        """Save the pair on display, and the page of its match; replace no file.

        Parameters
        ----------
        report
            Whether to save the page; pairs for a calibration do not need it.

        Returns
        -------
        list
            Names of the files.

        Raises
        ------
        OSError, ValueError
            If no pair has come yet, or it cannot be written.
        """
        frame = self.looked_at
        if frame is None:
            raise ValueError("there is no pair to save yet")
        stem = _free(self.folder, f"pair-{frame.index:06}")

        paths = []
        for side, image in (("left", frame.left), ("right", frame.right)):
            # PNG holds 8 bits, and 16 bits of gray; TIFF holds all.
            is_plain = image.dtype == np.uint8 or (image.dtype == np.uint16 and image.ndim == 2)
            path = self.folder / f"{stem}-{side}{'.png' if is_plain else '.tif'}"
            write_image(path, image)
            paths.append(path.name)
        if not report:
            return paths

        low, end = self.ends()
        known = self._calibration
        fits = known is not None and (known.height, known.width) == frame.result.disparity.shape

        write_pair_page(
            self.folder / f"{stem}.html",
            frame.left,
            frame.right,
            frame.result,
            calibration=known if fits else None,
            min_disparity=low,
            num_disparities=end - low,
            title=stem,
        )
        return [*paths, f"{stem}.html"]


def _worst_first(found: Iterable[Finding]) -> list[list[str]]:
    """Return topics, severities and sentences, without repeated sentences."""
    asked: dict[str, list[str]] = {}
    for one in sorted(found, key=lambda one: -_ORDER.index(one.severity)):
        asked.setdefault(one.sentence, [one.topic, one.severity, one.sentence])
    return list(asked.values())


def _free(folder: Path, stem: str) -> str:
    """Return a name; no file name in the folder begins with it."""
    names = [stem, *(f"{stem}-{number}" for number in range(2, 10_000))]
    return next(name for name in names if not any(folder.glob(f"{name}[.-]*")))

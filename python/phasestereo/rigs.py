"""Match the frames of two cameras, and learn their geometry and blur from frame to frame."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias, Unpack

import numpy as np
from numpy.typing import ArrayLike

from phasestereo import _core
from phasestereo._devices import opened
from phasestereo._images import ImageOrPath
from phasestereo._numbers import as_integer, as_number, check_type
from phasestereo.io.drafts import replace_text
from phasestereo.io.files import StrPath, named, open_regular, read_bounded
from phasestereo.known import Known
from phasestereo.matching import Second, match_silently
from phasestereo.rectification.writing import Form, written
from phasestereo.result import Result
from phasestereo.rig.alignment import Alignment
from phasestereo.rig.findings import warn
from phasestereo.settings import PresetName, Settings, SettingsOverrides, resolve
from phasestereo.temporal import TemporalFilter

REESTIMATE = 30
"""Frames after which blur is estimated again, even if it looks unchanged."""

Anchor: TypeAlias = tuple[float | ArrayLike, float | ArrayLike]

_MOST_TEXT = 2**20  # bytes: a saved rig has a few thousand
_LEAST_DEVIATION = 0.1  # px: blocks of a plane err alike


@dataclass(frozen=True, slots=True)
class Event:
    """An event in the life of a rig.

    Parameters
    ----------
    subject
        Its topic: "cameras", "rows", "range", "blur" or "health".
    frame
        The number of the frame, from 0.
    sentence
        What happened.

    Examples
    --------
    >>> rig = ps.Rig()
    >>> rig.match(left, right)
    >>> [str(event) for event in rig.events]
    """

    subject: str
    frame: int
    sentence: str

    def __str__(self) -> str:
        return f"frame {self.frame}: {self.sentence}"


class Check(NamedTuple):
    """A quantity of a rig against its limit."""

    name: str
    unit: str
    meaning: str
    value: float
    """NaN: unknown."""
    limit: float
    """The upper limit; for "reserve" and "fill" the lower one."""
    passed: bool | None
    """None: unknown, and not required."""

    def __str__(self) -> str:
        word = {True: "ok", False: "FAILED", None: "unknown"}[self.passed]
        value = "not known" if math.isnan(self.value) else f"{self.value:.3g} {self.unit}".rstrip()
        bound = "at least" if self.name in ("reserve", "fill") else "at most"
        return f"{word}: {self.name} {value}, {bound} {self.limit:.3g} ({self.meaning})"


class Rig:
    r"""Two cameras whose properties each pair refines: rows, range, blur, changes.

    The first pair is matched as `match` does. Later pairs reuse what still holds: the row
    alignment, filtered over the frames; the range of disparities; the cameras that rectify raw
    images; blur and noise, as long as they look unchanged. If the rows of a frame have moved, or
    things are nearer than the search range, the frame is matched again at once. Untrusted or failed
    matches change nothing. Frames are matched one after another, by one thread at a time. A rig can
    be pickled, saved, and loaded.

    Parameters
    ----------
    num_disparities, min_disparity, preset, settings, threads, device, **overrides
        As in `Matcher` and `match`, for every frame.
    anchor
        The one fact that no pair shows: the error of all disparities, since the cameras turn about
        the vertical axis. ``(found, true)``: disparities found at some place, and the ones that
        belong to its distance, in pixels: ``focal * baseline / distance``, 0 at infinity; numbers,
        or arrays of one shape, such as over a plane. See `offset`. None: unknown.
    reestimate
        Frames after which blur is estimated again at the latest; 1: every frame is matched on its
        own.

    Raises
    ------
    TypeError, ValueError
        As `match`, and for an anchor that is not a pixel and a depth.

    Examples
    --------
    >>> rig = ps.Rig(preset="fast")
    >>> for left, right in frames:
    ...     result = rig.match(left, right)
    >>> print(*rig.events, sep="\n")
    >>> rig.save("rig.txt")
    """

    def __init__(
        self,
        *,
        num_disparities: int | None = None,
        min_disparity: int = 0,
        preset: PresetName | None = None,
        settings: Settings | None = None,
        threads: int | None = None,
        device: str = "cpu",
        anchor: Anchor | None = None,
        reestimate: int = REESTIMATE,
        **overrides: Unpack[SettingsOverrides],
    ) -> None:
        self._settings = resolve(preset, settings, overrides)
        self._search = min_disparity, num_disparities
        self._reestimate = as_integer("reestimate", reestimate, least=1)
        self._offset = None if anchor is None else _offset(anchor)
        self._asked = threads, device
        self._workers = _core.Workers(threads, opened(device))
        self._core = _core.Rig(None)

    @property
    def settings(self) -> Settings:
        """The settings of every match."""
        return self._settings

    @property
    def threads(self) -> int:
        """The number of threads."""
        return self._workers.count

    @property
    def frames(self) -> int:
        """The number of frames seen."""
        return self._core.frames

    @property
    def health(self) -> float:
        """Share of the pixels that are probably wrong, over the last frames; NaN: unknown."""
        return self._core.health

    @property
    def events(self) -> tuple[Event, ...]:
        """Past events, the oldest first: the last 256."""
        return tuple(Event(*event) for event in self._core.events)

    @property
    def disparities(self) -> tuple[int, int] | None:
        """The disparities seen, half-open, with a reserve; None: unknown."""
        found = self._core.disparities
        return None if found is None else (found[0], found[0] + found[1])

    @property
    def field(self) -> Alignment | None:
        """The row alignment, with its accuracy; None: unknown."""
        return self._core.field

    @property
    def offset(self) -> tuple[float, float] | None:
        """The offset to add to disparities before they become depths, and its standard deviation.

        In pixels, from the anchor, as `phasestereo.depth_interval` takes it. None without an
        anchor.
        """
        return self._offset

    def match(
        self,
        left: ImageOrPath,
        right: ImageOrPath,
        *,
        left_mask: ArrayLike | None = None,
        right_mask: ArrayLike | None = None,
        known: Known | None = None,
        temporal_filter: TemporalFilter | None = None,
        vertical: bool | None = None,
        second: Second | None = None,
        timeout: float | None = None,
    ) -> Result:
        """Match the next pair.

        Parameters
        ----------
        left, right, left_mask, right_mask, known, vertical
            As in `match`; `vertical` None: as in the frames before.
        temporal_filter
            As in `Matcher.match`.
        second, timeout
            As in `match`. The rig learns only from its own match.

        Returns
        -------
        Result
            As `match`; ``result.blur.reused`` is True if the blur of an earlier frame was reused.

        Raises
        ------
        TypeError, ValueError, OSError, MemoryError, KeyboardInterrupt
            As `match`; ValueError also while another thread matches a pair with this rig. The state
            after the last match can be read meanwhile.

        Warns
        -----
        MatchWarning
            As `match`.
        """
        result = match_silently(
            (left, right),
            (left_mask, right_mask),
            self._search,
            settings=self._settings,
            threads=self._workers,
            progress=None,
            known=known,
            temporal_filter=temporal_filter,
            rig=self._core,
            reestimate=self._reestimate,
            vertical=vertical,
            second=second,
            timeout=timeout,
        )

        warn(result.findings)
        return result

    def change(self, settings: Settings, num_disparities: int | None) -> None:
        """Change the settings from the next frame on; keep the knowledge of the cameras.

        Parameters
        ----------
        settings
            The new settings.
        num_disparities
            Number of disparities to search; None: found from the images.

        Raises
        ------
        TypeError, ValueError
            If these are not settings, or not a number of disparities.
        """
        check_type("settings", settings, Settings, "Settings")
        if num_disparities is not None:
            num_disparities = as_integer("num_disparities", num_disparities, least=1)
        self._settings, self._search = settings, (self._search[0], num_disparities)

    def test(
        self, limits: Mapping[str, float] | None = None, *, focal: float | None = None
    ) -> tuple[Check, ...]:
        """Compare the state of the cameras with limits: go, or no-go.

        Parameters
        ----------
        limits
            Limits that replace the defaults, at which matches warn: of "rows", "error", "drift",
            "rotation", "wrong", "reserve", "noise", "exposure", "blur".
        focal
            Focal length of the rectified images in pixels, which turns rows into a rotation.

        Returns
        -------
        tuple of Check
            All quantities. Unmeasured quantities fail if a limit was given; rows, their error and
            the wrong share always do.

        Raises
        ------
        ValueError
            For another name, a limit that is negative or not finite, or a focal length that is not
            positive.
        """
        given = [(name, as_number(name, limit, least=0)) for name, limit in (limits or {}).items()]
        length = None if focal is None else as_number("focal", focal, positive=True)
        return tuple(Check(*row) for row in self._core.check(given, length))

    def save(self, path: StrPath) -> None:
        """Write the state to a text file, which `load` reads to the bit.

        Kernels that even out blur are left out: the next run estimates them from its first frame.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        replace_text(path, self._core.text)

    @classmethod
    def load(cls, path: StrPath, **options: Any) -> Rig:
        """Read a file from `save`; options are those of the class.

        Raises
        ------
        OSError
            If the file cannot be read.
        TypeError, ValueError
            If it is not a saved rig, or is damaged; also as the class.
        """
        rig = cls(**options)
        with named(str(path)), open_regular(path) as file:
            text = read_bounded(file, _MOST_TEXT).decode(errors="replace")
            rig._core = _core.Rig(text)
        return rig

    def export(self, path: StrPath, form: Form = "opencv") -> None:
        """Write the cameras that rectify raw images, for other programs.

        Parameters
        ----------
        path
            The file; for "camera_info" the folder of ``left.yaml`` and ``right.yaml``.
        form
            "opencv": YAML with K1, D1, K2, D2, R, T; "camera_info": ROS's format; "kalibr": a
            camchain. Images do not show the distance of the cameras: it is set to 1.

        Raises
        ------
        ValueError
            If no raw images were rectified, or the form is unknown.
        OSError
            If a file cannot be written.
        """
        found = self._core.cameras
        if found is None:
            raise ValueError(
                "rig: its images needed no rectification, so that no cameras are known; accepts "
                "one whose raw images were rectified"
            )
        written(path, *found, form)

    def __getstate__(self) -> dict[str, Any]:
        """Return the constructor and arguments of a copy; threads are not copied."""
        state = {key: value for key, value in vars(self).items() if key != "_workers"}
        return state | {"_core": self._core.text}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make a copy."""
        vars(self).update(state)
        threads, device = self._asked
        self._workers = _core.Workers(threads, opened(device))
        self._core = _core.Rig(state["_core"])

    def __repr__(self) -> str:
        health = "" if math.isnan(self.health) else f", {100 * self.health:.0f} % wrong"
        return f"<Rig of {self.frames} frames{health}>"


def _offset(anchor: Anchor) -> tuple[float, float]:
    """Return the mean of true minus found disparities, and its standard deviation."""
    accepts = "(found, true): disparities in pixels, numbers or arrays of one shape"
    try:
        found, true = (np.asarray(one, np.float64) for one in anchor)
        off = np.ravel(true - found)
    except OverflowError as error:
        raise ValueError(f"anchor: got a huge number; accepts {accepts}") from error
    except (TypeError, ValueError) as error:
        raise type(error)(f"anchor: got {anchor!r:.80}; accepts {accepts}") from error

    off = off[np.isfinite(off)]
    if not off.size:
        raise ValueError(f"anchor: got no finite disparity; accepts {accepts}")
    spread = float(off.std()) if off.size > 1 else 0.0
    return float(np.median(off)), max(spread / math.sqrt(off.size), _LEAST_DEVIATION)

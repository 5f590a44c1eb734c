"""Two cameras that run: what they are is learned from frame to frame."""

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
"""Frames after which blur is estimated anew, however much it looks as it was."""

Anchor: TypeAlias = tuple[float | ArrayLike, float | ArrayLike]

_MOST_TEXT = 2**20  # bytes: a saved rig has some thousands
_LEAST_DEVIATION = 0.1  # px: blocks of a plane err alike


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened to a rig.

    Parameters
    ----------
    subject
        What it is about: "cameras", "rows", "range", "blur" or "health".
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
    """The most there may be; of "reserve" and "fill" the least."""
    passed: bool | None
    """None: unknown, and not needed."""

    def __str__(self) -> str:
        word = {True: "ok", False: "FAILED", None: "unknown"}[self.passed]
        value = "not known" if math.isnan(self.value) else f"{self.value:.3g} {self.unit}".rstrip()
        bound = "at least" if self.name in ("reserve", "fill") else "at most"
        return f"{word}: {self.name} {value}, {bound} {self.limit:.3g} ({self.meaning})"


class Rig:
    r"""Two cameras, of which each pair they take shows more: rows, range, blur, what changes.

    The first pair is matched as `match` does. Those after it take over what holds: where rows
    correspond, filtered over the frames; which disparities there are; the cameras by which raw
    images are rectified; blur and noise, as long as they look as before. A frame whose rows have
    moved, or whose things are nearer than was searched for, is matched once more at once. A match
    that is not to be trusted changes nothing, nor does one that fails. Frames are matched one after
    another, by one thread at a time. It can be pickled, saved, and loaded.

    Parameters
    ----------
    num_disparities, min_disparity, preset, settings, threads, device, **overrides
        As `Matcher` and `match` take them, for every frame.
    anchor
        What no pair shows: by how much all disparities are off, since the cameras turn about the
        vertical axis. ``(found, true)``: disparities that were found at some place, and those that
        belong to its distance, in pixels: ``focal * baseline / distance``, 0 at infinity; numbers,
        or arrays of one shape, as over a plane. See `offset`. None: not known.
    reestimate
        Frames after which blur is estimated anew at the latest; 1: every frame is matched by
        itself.

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
        """How many frames it has seen."""
        return self._core.frames

    @property
    def health(self) -> float:
        """Share of the pixels that is probably wrong, over the last frames; NaN: unknown."""
        return self._core.health

    @property
    def events(self) -> tuple[Event, ...]:
        """What happened, the oldest first: the last 256."""
        return tuple(Event(*event) for event in self._core.events)

    @property
    def disparities(self) -> tuple[int, int] | None:
        """The disparities it has seen, half-open, with a reserve; None: nothing is known."""
        found = self._core.disparities
        return None if found is None else (found[0], found[0] + found[1])

    @property
    def field(self) -> Alignment | None:
        """Where rows correspond, and how exactly that is known; None: nothing is known."""
        return self._core.field

    @property
    def offset(self) -> tuple[float, float] | None:
        """What is to be added to disparities before they become depths, and its standard deviation.

        In pixels, by the anchor, as `phasestereo.depth_interval` takes it. None: without one.
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
            As `match` takes them; None: `vertical` is as the frames before have shown.
        temporal_filter
            As `Matcher.match` takes it.
        second, timeout
            As `match` takes them. The rig learns from the match alone.

        Returns
        -------
        Result
            As `match`; ``result.blur.reused`` says whether the blur of an earlier frame holds.

        Raises
        ------
        TypeError, ValueError, OSError, MemoryError, KeyboardInterrupt
            As `match`; ValueError also while another thread matches a pair by this rig. What is
            known after the last match can be read meanwhile.

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
        """Match the frames from the next one on in another way; what is known of them is kept.

        Parameters
        ----------
        settings
            How.
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
        """Compare what is known of the cameras with limits: go, or no-go.

        Parameters
        ----------
        limits
            Limits in the place of the usual ones, from which on a match is warned of: of "rows",
            "error", "drift", "rotation", "wrong", "reserve", "noise", "exposure", "blur".
        focal
            Focal length of the rectified images in pixels, by which rows become a rotation.

        Returns
        -------
        tuple of Check
            All quantities. Unmeasured quantities fail if a limit was given, and so have rows,
            their error and the wrong share.

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
        """Write what is known to a text file, which `load` reads to the bit.

        Kernels that even out blur are left out: they are estimated of the first frame of the next
        run.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        replace_text(path, self._core.text)

    @classmethod
    def load(cls, path: StrPath, **options: Any) -> Rig:
        """Read what `save` has written; options as those of the class.

        Raises
        ------
        OSError
            If the file cannot be read.
        TypeError, ValueError
            If it is not a saved rig, or damaged, and as the class.
        """
        rig = cls(**options)
        with named(str(path)), open_regular(path) as file:
            text = read_bounded(file, _MOST_TEXT).decode(errors="replace")
            rig._core = _core.Rig(text)
        return rig

    def export(self, path: StrPath, form: Form = "opencv") -> None:
        """Write the cameras that raw images are rectified by, for other programs.

        Parameters
        ----------
        path
            The file; of "camera_info" the folder, for ``left.yaml`` and ``right.yaml``.
        form
            "opencv": YAML with K1, D1, K2, D2, R, T; "camera_info": that of ROS; "kalibr": a
            camchain. The distance of the cameras is not known from images: it is 1.

        Raises
        ------
        ValueError
            If no raw images were rectified, or there is no such form.
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
        """Return the constructor and arguments of a copy: threads are not copied."""
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
    """Return the mean of true less found disparities, and its standard deviation."""
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

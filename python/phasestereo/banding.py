"""Bands of rows of a pair, matched by themselves or one after another, that fit to the bit.

All that lies between images and disparities reaches only so far up and down (`halo`), but for the
paths of semi-global matching, which come from all that is above: those are handed on from one band
to the next.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from phasestereo import _core
from phasestereo.equalisation import as_equalisation
from phasestereo.result import Result
from phasestereo.settings import Settings
from phasestereo.surveying import Checked, Survey

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from phasestereo.equalisation import Equalisation
    from phasestereo.surveying import Reader

    Progress = Callable[[int, int], object]

_BAND = 32  # rows: bands of semi-global matching begin at multiples of it
_MOST_BANDS = 8  # that are searched at the same time
# Bytes of a pixel, at most: of a code, of gray values as they are made, and, in a draft, of what is
# always there and of votes and gray values. Refining takes as many drafts.
_CODES, _GRAY, _MAP, _EXTRAS, _DRAFTS = 8, 16, 6, 8, 7
_STAGES = "description", "matching", "refinement"


def halo(settings: Settings, equalisation: Equalisation | None = None) -> int | None:
    """Return how many rows above and below a band its disparities depend on.

    Parameters
    ----------
    settings
        The settings.
    equalisation
        The versions in which pixels are compared; None: as they are. Those of a `Survey` belong to
        its settings.

    Returns
    -------
    int or None
        Rows of the images: those of the window, the neighbourhood and the kernels, and those that
        speckles, filling, smoothing and confidences look at. None with ``optimizer="sgm"``, whose
        paths come from all rows above. A row without any valid pixel copies another one, up to 95
        rows away; where there are such rows, `match_rows` and `Sweep` read as many more.

    Raises
    ------
    TypeError
        If an argument has the wrong type.
    """
    if not isinstance(settings, Settings):
        raise TypeError(f"settings: got {type(settings).__name__}; accepts Settings")
    reach = _Reach.of(settings, as_equalisation(None, equalisation))
    return None if settings.optimizer == "sgm" else reach.images + reach.map


def match_rows(
    read: Reader,
    survey: Survey,
    first: int,
    last: int,
    *,
    overlap: int | None = None,
    threads: int | _core.Workers | None = None,
) -> Result:
    """Match the rows [first, last) of a pair by themselves.

    Parameters
    ----------
    read
        As `phasestereo.survey` takes it; it is asked for these rows and those around them.
    survey
        What is known of the whole pair.
    first, last
        The rows, half-open.
    overlap
        With ``optimizer="sgm"``: paths from above begin so many rows, from 0, above those that are
        needed; the result is approximate near the top of the band unless they begin at the first
        row of the image. None, and nothing else makes a difference, with any other optimizer.
    threads
        As `phasestereo.match` takes them.

    Returns
    -------
    Result
        Of these rows alone, without the pair; with any optimizer but "sgm" the same bits as these
        rows of the whole.

    Raises
    ------
    TypeError, ValueError, MemoryError, KeyboardInterrupt
        As `phasestereo.match`; ValueError also if there are no such rows, or `overlap` is None with
        ``optimizer="sgm"``.
    """
    bands = _Bands(read, survey, threads)
    if survey.settings.optimizer == "sgm" and overlap is None:
        raise ValueError(
            "overlap: got None with optimizer='sgm', whose paths come from all rows above; accepts "
            "a number of rows after which they are forgotten, for an approximate result; exact are "
            "phasestereo.Sweep, from the top down, or another optimizer, as of preset='fast'"
        )
    _check_rows(survey, first, last)
    _check_overlap(overlap)
    first_drafted, end = bands.around(first, last)
    start = max(0, first_drafted - (overlap or 0)) // bands.unit * bands.unit
    chosen = bands.choose(start, end, None, None)
    draft = chosen.draft.rows(first_drafted - start, end - start)
    return bands.refine(draft, first - first_drafted, last - first, chosen.timings)


class Sweep:
    """Matches a pair from the top down, one band after another: exact with all settings.

    Parameters
    ----------
    read, threads
        As `match_rows` takes them; each row is asked for once, and those around bands again.
    survey
        What is known of the whole pair.
    state
        What `state` returned, of a sweep with the same images and survey that is to be gone on
        with; None: from the first row on.

    Raises
    ------
    TypeError, ValueError
        As `match_rows` does; also if no sweep with this survey can have left that state.
    """

    def __init__(
        self,
        read: Reader,
        survey: Survey,
        *,
        threads: int | None = None,
        state: Mapping[str, NDArray[Any]] | None = None,
    ) -> None:
        self._bands = _Bands(read, survey, _core.Workers(threads))
        self._done = self._top = self._chosen = 0
        self._draft: _Draft | None = None
        self._paths: NDArray[np.uint8] | None = None
        if state is not None:
            self._restore(state)

    @property
    def done(self) -> int:
        """The rows that are done, from the first one on."""
        return self._done

    def advance(self, last: int, *, progress: Progress | None = None) -> Result:
        """Match the rows [`done`, last).

        Parameters
        ----------
        last
            Up to which row, exclusive. Memory grows with the number of rows.
        progress
            As `phasestereo.match` takes it; of the rows at hand.

        Returns
        -------
        Result
            Of these rows alone, without the pair.

        Raises
        ------
        TypeError, ValueError, MemoryError, KeyboardInterrupt
            As `match_rows`; then nothing is done yet of these rows.
        """
        if progress is not None and not callable(progress):
            raise TypeError(f"progress: got {type(progress).__name__}; accepts a callable or None")
        _check_rows(self._bands.survey, self._done, last)
        first, end = self._bands.around(self._done, last)
        draft, paths, chosen, timings = self._draft, self._paths, self._chosen, {}
        if end > chosen:
            end = min(-(-end // _BAND) * _BAND, self._bands.survey.size[0])
            found = self._bands.choose(chosen, end, paths, progress)
            draft = found.draft if draft is None else draft.followed_by(found.draft)
            paths, chosen, timings = found.paths, end, found.timings
        assert draft is not None, "rows are chosen before they are refined"  # noqa: S101 - for mypy
        _, end = self._bands.around(self._done, last)
        around = draft.rows(first - self._top, end - self._top)
        result = self._bands.refine(around, self._done - first, last - self._done, timings)
        kept, _ = self._bands.around(last, last)
        self._draft, self._top = draft.rows(kept - self._top, chosen - self._top).alone(), kept
        self._done, self._paths, self._chosen = last, paths, chosen
        return result

    def state(self) -> dict[str, NDArray[Any]]:
        """Return what a new sweep goes on from: arrays that `numpy.savez` takes.

        They hold what was found of the rows around the next band, and with ``optimizer="sgm"``
        where its paths have come to: some ten bytes for each of these pixels, and about four for
        each column and disparity.
        """
        numbers = {"done": self._done, "top": self._top, "chosen": self._chosen}
        state: dict[str, NDArray[Any]] = {name: np.array(value) for name, value in numbers.items()}
        if self._draft is not None:
            state |= self._draft.planes()
        return state if self._paths is None else state | {"paths": self._paths}

    def _restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        if not isinstance(state, Mapping):
            raise TypeError(f"state: got {type(state).__name__}; accepts what Sweep.state returned")
        try:
            done, top, chosen = (int(state[name]) for name in ("done", "top", "chosen"))
            kept = {name: np.asarray(plane) for name, plane in state.items()} if chosen else {}
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"state: got {error}; accepts what Sweep.state returned") from None
        draft = _Draft._make(kept.get(name) for name in _Draft._fields) if chosen else None
        paths = kept.get("paths")
        self._bands.check_state((done, top, chosen), draft, paths)
        self._done, self._top, self._chosen = done, top, chosen
        self._draft, self._paths = draft, paths


class _Draft(NamedTuple):
    """What was chosen for some rows, before it is refined."""

    disparity: NDArray[np.float32]
    flags: NDArray[np.uint16]
    votes: NDArray[np.float32] | None
    gray: NDArray[np.int32] | None

    def rows(self, first: int, last: int) -> _Draft:
        """Return some of the rows, as views."""
        return _Draft._make(None if plane is None else plane[first:last] for plane in self)

    def alone(self) -> _Draft:
        """Return the rows as arrays of their own: what they were views of is not kept alive."""
        return _Draft._make(None if plane is None else plane.copy() for plane in self)

    def followed_by(self, other: _Draft) -> _Draft:
        """Return these rows and then those of another."""
        pairs = zip(self, other, strict=True)
        return _Draft._make(None if a is None else np.concatenate([a, b]) for a, b in pairs)

    def planes(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that there are by name."""
        return {name: plane for name, plane in self._asdict().items() if plane is not None}


@dataclass(frozen=True, slots=True)
class _Chosen:
    draft: _Draft
    paths: NDArray[np.uint8] | None
    timings: dict[str, float]


@dataclass(frozen=True, slots=True)
class _Reach:
    """Rows above and below that are looked at: of images, of a draft, around masked rows."""

    images: int
    map: int
    masked: int

    @classmethod
    def of(cls, settings: Settings, equalisation: Equalisation | None) -> _Reach:
        return cls(*_core.reach(settings, equalisation))


class _Bands:
    """Reads, chooses and refines rows of a pair."""

    def __init__(self, read: Reader, survey: Survey, threads: int | _core.Workers | None) -> None:
        if not isinstance(survey, Survey):
            raise TypeError(f"survey: got {type(survey).__name__}; accepts a phasestereo.Survey")
        self._read = Checked(read, survey.size, survey.dtype)
        self._reach = _Reach.of(survey.settings, survey.equalisation)
        self.survey, self._threads = survey, threads
        self.unit = _BAND if survey.settings.optimizer == "sgm" else 1

    def around(self, first: int, last: int) -> tuple[int, int]:
        """Return the rows that must be chosen for these to be refined."""
        return _widened(first, last, self._reach.map, self.survey.size[0])

    def check_state(
        self,
        rows: tuple[int, int, int],
        draft: _Draft | None,
        paths: NDArray[np.uint8] | None,
    ) -> None:
        """Refuse what no sweep with this survey can have left behind, or rows would not fit."""
        survey, (done, top, chosen) = self.survey, rows
        height, cols = survey.size
        first, least = self.around(done, done)
        is_begun = chosen > 0 and chosen >= least and (chosen % _BAND == 0 or chosen == height)
        if not (0 <= done <= height >= chosen and top == first and (is_begun or rows == (0, 0, 0))):
            told = f"done, top, chosen = {done}, {top}, {chosen}"
            raise ValueError(f"state: got {told}; accepts that of a sweep with this survey")
        planes = {} if draft is None else draft.planes()
        found: dict[str, Any] = {name: (plane.dtype, plane.shape) for name, plane in planes.items()}
        needed = _planes(survey, (chosen - top, cols)) if chosen else {}
        if survey.settings.optimizer == "sgm" and chosen:
            needed["paths"] = np.dtype(np.uint8), (0 if paths is None else paths.size,)
        if paths is not None:
            found["paths"] = paths.dtype, paths.shape
        if found != needed:
            raise ValueError(f"state: got arrays {found}; accepts those of this survey, {needed}")

    def choose(
        self,
        first: int,
        last: int,
        paths: NDArray[np.uint8] | None,
        progress: Progress | None,
    ) -> _Chosen:
        """Choose the disparities of rows, of which the first is a multiple of `unit`."""
        height = self.survey.size[0]
        end = -(-last // self.unit) * self.unit
        top, bottom = _widened(first, end, self._reach.images, height)
        top = top // self.unit * self.unit
        images, masks = self._read(top, bottom)
        if any(mask is not None and not mask.any(axis=1).all() for mask in masks):
            top, bottom = _widened(top, bottom, self._reach.masked, height)
            top = top // self.unit * self.unit
            images, masks = self._read(top, bottom)
        draft, paths, timings = _core.choose_rows(
            images, masks, self.survey, top, (first, last), paths, self._threads, progress
        )
        return _Chosen(_Draft(*draft), paths, timings)

    def refine(self, draft: _Draft, first: int, count: int, timings: Mapping[str, float]) -> Result:
        """Refine a draft, of which `count` rows from `first` on are wanted."""
        disparity, flags, confidence, found = _core.refine_rows(draft, self.survey, self._threads)
        rows = slice(first, first + count)
        kept = None if confidence is None else confidence[rows].copy()
        stages = {name: timings.get(name, 0.0) + found[name] for name in _STAGES}
        settings, blur = self.survey.settings, self.survey.blur
        return Result(disparity[rows].copy(), flags[rows].copy(), kept, settings, stages, blur)


def _planes(survey: Survey, shape: tuple[int, int]) -> dict[str, tuple[np.dtype[Any], Any]]:
    """Return type and shape of the planes of a draft."""
    settings = survey.settings
    kinds: dict[str, Any] = {"disparity": np.float32, "flags": np.uint16}
    if settings.confidence or settings.min_confidence > 0:
        kinds["votes"] = np.float32
    if survey.roughness is not None:
        kinds["gray"] = np.int32
    return {name: (np.dtype(kind), shape) for name, kind in kinds.items()}


def _widened(first: int, last: int, by: int, height: int) -> tuple[int, int]:
    return max(0, first - by), min(height, last + by)


def _check_overlap(overlap: int | None) -> None:
    if not isinstance(overlap, int | np.integer | None):
        raise TypeError(f"overlap: got {overlap!r}; accepts an integer or None")
    if overlap is not None and overlap < 0:
        raise ValueError(f"overlap: got {overlap}; accepts an integer from 0, or None")


def _check_rows(survey: Survey, first: int, last: int) -> None:
    if not (isinstance(first, int | np.integer) and isinstance(last, int | np.integer)):
        raise TypeError(f"first, last: got {first!r}, {last!r}; accepts integers")
    if not 0 <= first < last <= survey.size[0]:
        raise ValueError(
            f"first, last: got {first}, {last}; accepts rows from 0 to {survey.size[0]}, "
            "at least one"
        )


def working_memory(survey: Survey, rows: int, *, threads: int, itemsize: int) -> int:
    """Return how many bytes a `Sweep` takes at most, besides what the process had before.

    Parameters
    ----------
    survey
        What is known of the whole pair.
    rows
        Rows that it advances by at a time.
    threads
        Its threads.
    itemsize
        Bytes of a pixel of one image, all channels together, as the reader returns it.

    Returns
    -------
    int
        An upper bound: of what is searched in, which does not depend on `rows`, and of images,
        codes and maps of a band, which do.
    """
    settings, (_, cols) = survey.settings, survey.size
    reach = _Reach.of(settings, survey.equalisation)
    described = (rows + 2 * reach.images + _BAND) * cols
    drafted = (rows + 2 * reach.map + _BAND) * cols
    kinds = 1 if survey.equalisation is None else len(list(survey.equalisation.kernels))
    has_extras = survey.roughness is not None
    described *= 6 * itemsize + _CODES * (1 + kinds) + has_extras * _GRAY
    drafted *= _MAP + has_extras * _EXTRAS
    return _searching(survey, threads) + max(described + 2 * drafted, _DRAFTS * drafted)


def _searching(survey: Survey, threads: int) -> int:
    """Return the bytes in which the best disparities are searched for."""
    volume, settings = survey.size[1] * survey.num_disparities, survey.settings
    if settings.optimizer == "sgm":
        return volume * (230 + 115 * (min(threads, _MOST_BANDS) - 1))
    window = 1800 * settings.window * survey.num_disparities
    return threads * (30 * volume + window + 1200 * survey.size[1])

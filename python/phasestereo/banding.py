"""Bands of rows of a pair, matched by themselves, in any order: they fit to the bit.

All that lies between images and disparities reaches only so far up and down (`halo`): a band that
is matched together with so many rows around it is that of the whole pair.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phasestereo import _core
from phasestereo.equalisation import as_equalisation
from phasestereo.result import Result
from phasestereo.settings import Settings
from phasestereo.surveying import Checked, Survey

if TYPE_CHECKING:
    from collections.abc import Callable

    from phasestereo.alignment import Alignment
    from phasestereo.equalisation import Equalisation
    from phasestereo.surveying import Reader

    Progress = Callable[[int, int], object]


def halo(
    settings: Settings,
    equalisation: Equalisation | None = None,
    alignment: Alignment | None = None,
) -> int:
    """Return how many rows above and below a band its disparities depend on at most.

    Parameters
    ----------
    settings
        The settings.
    equalisation
        The versions in which pixels are compared; None: as they are. Those of a `Survey` belong to
        its settings.
    alignment
        How rows correspond: where it is applied, its largest offset and some more. None: they do.

    Returns
    -------
    int
        Rows of the images: those of the window, the neighborhood and the kernels, and those that
        speckles, filling, smoothing and confidences look at; with ``optimizer="sgm"`` also those
        that the paths from above and below come from. A row without any valid pixel copies another
        one, up to 95 rows away; where there are such rows, `match_rows` reads as many more.

    Raises
    ------
    TypeError
        If an argument has the wrong type.
    """
    if not isinstance(settings, Settings):
        raise TypeError(f"settings: got {type(settings).__name__}; accepts Settings")
    field = alignment.field if alignment is not None and alignment.applied else None
    around, _ = _core.reach(settings, as_equalisation(equalisation), field)
    return around


def match_rows(
    read: Reader,
    survey: Survey,
    first: int,
    last: int,
    *,
    threads: int | _core.Workers | None = None,
    progress: Progress | None = None,
) -> Result:
    """Match the rows [first, last) of a pair by themselves, whatever the settings.

    Parameters
    ----------
    read
        As `phasestereo.survey` takes it; it is asked for these rows and those around them.
    survey
        What is known of the whole pair.
    first, last
        The rows, half-open. Memory grows with their number.
    threads
        As `phasestereo.match` takes them.
    progress
        As `phasestereo.match` takes it; of the rows at hand, those around the band included.

    Returns
    -------
    Result
        Of these rows alone, without the pair: the same bits as these rows of the whole.

    Raises
    ------
    TypeError, ValueError, MemoryError, KeyboardInterrupt
        As `phasestereo.match`; ValueError also if there are no such rows.
    """
    if not isinstance(survey, Survey):
        raise TypeError(f"survey: got {type(survey).__name__}; accepts a phasestereo.Survey")
    if progress is not None and not callable(progress):
        raise TypeError(f"progress: got {type(progress).__name__}; accepts a callable or None")
    rows = Checked(read, survey.size, survey.dtype)
    _check_rows(survey, first, last)
    around, masked = _core.reach(survey.settings, survey.equalisation, survey.field)
    top, bottom = _widened(first, last, around, survey)
    images, masks = rows(top, bottom)
    if any(mask is not None and not mask.any(axis=1).all() for mask in masks):
        del images, masks  # or there would be two of them
        top, bottom = _widened(top, bottom, masked, survey)
        images, masks = rows(top, bottom)
    disparity, flags, confidence, timings = _core.match_rows(
        images, masks, survey, top, (first, last), threads, progress
    )
    return Result(
        disparity,
        flags,
        confidence,
        survey.settings,
        timings,
        search=survey.search,
        blur=survey.blur,
        alignment=survey.alignment,
        equalisation=survey.equalisation,
    )


def _widened(first: int, last: int, by: int, survey: Survey) -> tuple[int, int]:
    return max(0, first - by), min(survey.size[0], last + by)


def _check_rows(survey: Survey, first: int, last: int) -> None:
    if not (isinstance(first, int | np.integer) and isinstance(last, int | np.integer)):
        raise TypeError(f"first, last: got {first!r}, {last!r}; accepts integers")
    if not 0 <= first < last <= survey.size[0]:
        raise ValueError(
            f"first, last: got {first}, {last}; accepts rows from 0 to {survey.size[0]}, "
            "at least one"
        )


def working_memory(survey: Survey, rows: int, *, threads: int, itemsize: int) -> int:
    """Return how many bytes `match_rows` takes at most, besides what the process had before.

    Parameters
    ----------
    survey
        What is known of the whole pair.
    rows
        Rows that are matched at a time.
    threads
        Threads.
    itemsize
        Bytes of a pixel of one image, all channels together, as the reader returns it.

    Returns
    -------
    int
        An upper bound: of what is searched in, which does not depend on `rows`, and of images,
        codes and maps of a band and its halo, which do.
    """
    return _core.working_memory(survey, rows, threads, itemsize)

"""What must be known of a whole pair before any part is matched, gathered a few rows at a time.

Some things are the same for all parts, or parts would not fit together: the relative blur and the
map of it, the noise, the range in which the pixels of float images lie, how much neighbouring gray
values differ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from phasestereo import _core
from phasestereo._images import as_mask, as_pair
from phasestereo.equalisation import Equalisation, as_equalisation, as_noise
from phasestereo.estimates import as_estimates
from phasestereo.settings import resolve

if TYPE_CHECKING:
    import os
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from phasestereo._images import Pixels
    from phasestereo.alignment import Alignment, Field
    from phasestereo.blur import BlurEstimate
    from phasestereo.equalisation import Noise
    from phasestereo.search_range import SearchRange
    from phasestereo.settings import Settings

    Mask = NDArray[np.bool_]
    Rows: TypeAlias = tuple[ArrayLike, ArrayLike, ArrayLike | None, ArrayLike | None]
    Reader: TypeAlias = Callable[[int, int], Rows]
    Range: TypeAlias = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Survey:
    """What is known of a whole pair; `survey` makes it, and it can be pickled and saved.

    Parameters
    ----------
    size
        Rows and columns of either image.
    dtype
        Type of the pixels, "uint8", "uint16", "float32" or "float64".
    min_disparity, num_disparities
        The disparities to search.
    settings
        The settings that every part is matched with: with ``compensate_blur=True`` those that suit
        the blur that was found.
    equalisation
        The versions in which pixels are compared, of the whole pair; it tells the noise, too. None:
        the images as they are.
    blur
        What was found out about blur and noise, if that was asked for.
    alignment
        How the rows of the images correspond, if that was asked for and could be told.
    search
        The disparities to search, and whether they were told or found. None: they were told.
    ranges
        Where the pixels of the left and of the right image lie, if they are floats: (black, white)
        in thousandths of their unit, but for 0.1 % at either end. None: not needed.
    roughness
        By how much horizontal neighbours of the left image differ: the sum, in steps of gray
        values, and of how many pairs. None: not needed.
    """

    size: tuple[int, int]
    dtype: str
    min_disparity: int
    num_disparities: int
    settings: Settings
    equalisation: Equalisation | None = None
    blur: BlurEstimate | None = None
    alignment: Alignment | None = None
    search: SearchRange | None = None
    ranges: tuple[Range, Range] | None = None
    roughness: tuple[int, int] | None = None

    @property
    def field(self) -> Field | None:
        """The field that the right image is straightened by, as the core takes it."""
        if self.alignment is None or not self.alignment.applied:
            return None
        return self.alignment.field

    @property
    def is_inverted(self) -> bool:
        """Whether the negative of the right image is matched."""
        return self.search is not None and self.search.inverted and self.settings.compensate_blur

    @property
    def is_compensated(self) -> bool:
        """Whether a blur was found, and settings that suit it were taken."""
        found = self.blur is not None and any(blur.psf is not None for blur in self.blur.blurs)
        return found and self.settings.compensate_blur

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it to a file, ``.npz`` without pickled objects, which `load` reads.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        arrays = import_module("phasestereo.survey_files").as_arrays(self)
        with import_module("phasestereo.io.files").replacing(path) as file:
            np.savez(file, allow_pickle=False, **arrays)


def load(path: str | os.PathLike[str]) -> Survey:
    """Read what `Survey.save` has written.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is no such file.
    """
    names = "io.files", "io.limits", "io.npz", "survey_files"
    files, limits, npz, surveys = (import_module(f"phasestereo.{name}") for name in names)
    with files.decoding(path) as file:
        content = files.read_bounded(file, limits.SURVEY)
        found: Survey = surveys.from_arrays(npz.decode_arrays(content, limits.SURVEY))
        return found


def survey(
    read: Reader,
    size: tuple[int, int],
    *,
    num_disparities: int | None = None,
    min_disparity: int = 0,
    preset: str | None = None,
    settings: Settings | None = None,
    threads: int | None = None,
    noise: Noise | None = None,
    equalisation: Equalisation | None = None,
    **overrides: Any,
) -> Survey:
    """Gather what must be known of a whole pair, in memory that does not grow with its height.

    Parts that are matched with it come out as `phasestereo.match` has them, to the bit.

    Parameters
    ----------
    read
        Called as ``read(first, last)``, several times, some hundred rows at a time; returns the
        rows [first, last) of both images and of their masks, ``(left, right, left_mask,
        right_mask)``, as `phasestereo.match` takes them; a mask may be None. Other threads than the
        calling one call it, one at a time. What it raises comes out as it is.
    size
        Rows and columns of either image.
    num_disparities, min_disparity, preset, settings, threads, noise, equalisation, **overrides
        As `phasestereo.match` takes them.

    Returns
    -------
    Survey
        With no more than the settings need: one row is read in any case; the pair is gone through
        two or three times, of 16 bits once more, for the blur and the noise (``compensate_blur``,
        ``despike``, ``denoise`` or ``noise_threshold > 0``), a few times for the rows
        (``align_rows``), once for the range (``num_disparities=None``), once for
        ``adaptive_p2``, ``synthesis``, ``guided_median`` or confidences, once for float images.

    Raises
    ------
    TypeError, ValueError, MemoryError, KeyboardInterrupt
        As `phasestereo.match`.
    """
    asked = resolve(preset, settings, overrides)
    rows = Checked(read, as_size(size))
    (left, right), masks = rows(0, 1)
    dtype, search = left.dtype, (min_disparity, num_disparities)
    # Threads of its own: one of those that are shared would wait for a reader that matches.
    workers = _core.Workers(threads)
    told = as_noise(noise, equalisation), as_equalisation(equalisation), None, False
    one = _core.estimate_pair(
        (left, right), masks, search, replace(asked, align_rows=False), workers
    )
    del one  # The core owns the ranges of arguments, and refuses of one row what it would of all.
    ranges, roughness = None, None
    if dtype.kind == "f" and (asked.cost == "phase" or asked.intensity_range is None):
        ranges = _core.find_ranges(rows, rows.size, search)
    found = as_estimates(
        _core.estimate_pair_by_rows(rows, rows.size, search, asked, ranges, workers, told),
        asked,
        search,
        equalisation,
    )
    looks = asked.guided_median or asked.synthesis or asked.confidence
    if looks or asked.adaptive_p2 > 0 or asked.min_confidence > 0:
        impulses = found.equalisation.impulses[0] if found.equalisation else 0.0
        roughness = _core.find_roughness(rows, rows.size, search, ranges, impulses)
    versions = found.equalisation
    if versions is None and told[0] is not None:
        versions = Equalisation(noise=told[0])
    # No later pair is compared with it.
    blur = None if found.blur is None else replace(found.blur, glance=None)
    return Survey(
        size=rows.size,
        dtype=dtype.name,
        min_disparity=found.search.min_disparity,
        num_disparities=found.search.num_disparities,
        settings=found.settings,
        equalisation=versions,
        blur=blur,
        alignment=found.alignment,
        search=found.search,
        ranges=ranges,
        roughness=roughness,
    )


class Checked:
    """A reader whose rows are what they must be, as the core takes them."""

    def __init__(self, read: Reader, size: tuple[int, int], dtype: str | None = None) -> None:
        if not callable(read):
            raise TypeError(f"read: got {type(read).__name__}; accepts a callable")
        self.size = size
        self._read, self._dtype = read, dtype

    def __call__(
        self, first: int, last: int
    ) -> tuple[tuple[Pixels, Pixels], tuple[Mask | None, Mask | None]]:
        """Read rows, in the type of those that were read before."""
        found = self._read(first, last)
        if not isinstance(found, (tuple, list)) or len(found) != 4:
            many = f" of {len(found)}" if isinstance(found, (tuple, list)) else ""
            raise TypeError(
                f"read: got {type(found).__name__}{many}; accepts a tuple of four, (left, right, "
                "left_mask, right_mask)"
            )
        left, right, left_mask, right_mask = found
        pair = as_pair(left, right)
        size = last - first, self.size[1]
        if pair[0].shape[:2] != size:
            raise ValueError(
                f"read: got {pair[0].shape[:2]} pixels for the rows {first} to {last}; "
                f"accepts {size}"
            )
        name = pair[0].dtype.name
        if self._dtype not in (None, name):
            raise TypeError(
                f"read: got {name} for the rows {first} to {last}; accepts that of "
                f"others, {self._dtype}"
            )
        self._dtype = name
        masks = as_mask(left_mask, size, "left_mask"), as_mask(right_mask, size, "right_mask")
        return pair, masks


def as_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return numbers of rows and columns, or say by name why they are none."""
    if not isinstance(size, (tuple, list)) or len(size) != 2:
        raise TypeError(f"size: got {size!r}; accepts a pair (rows, columns)")
    rows, cols = size
    if not (isinstance(rows, int | np.integer) and isinstance(cols, int | np.integer)):
        raise TypeError(f"size: got {size!r}; accepts numbers of rows and columns")
    if rows < 1 or cols < 1:
        raise ValueError(f"size: got {size!r}; accepts at least one row and one column")
    return int(rows), int(cols)

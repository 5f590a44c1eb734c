"""What must be known of a whole pair to match parts of it, and the files that keep it.

A file is an ``.npz`` without pickled objects; what is not an array is in one array of JSON. Files
may come from anywhere: all is checked.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from phasestereo._numbers import as_integer
from phasestereo.io.drafts import replacing
from phasestereo.io.files import decoding, read_bounded
from phasestereo.io.limits import STATISTICS
from phasestereo.io.npy import decode_arrays
from phasestereo.rig.alignment import Alignment
from phasestereo.rig.blur import BlurEstimate
from phasestereo.rig.compensation import BlurCompensation
from phasestereo.rig.findings import Finding
from phasestereo.rig.search_range import SearchRange
from phasestereo.settings import Settings
from phasestereo_large.records import check_ranges, decoded

Range: TypeAlias = tuple[float, float]
Packing: TypeAlias = tuple[float, int, bool, bool]
Borders: TypeAlias = tuple[NDArray[np.uint32] | None, NDArray[np.uint32] | None]
Rectangle: TypeAlias = tuple[int, int, int, int]
Arrays: TypeAlias = dict[str, NDArray[Any]]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PairStatistics:
    """The statistics of a whole pair, by `pair_statistics`; they can be pickled and saved.

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
    blur_compensation
        The versions in which pixels are compared, of the whole pair; it has the noise, too. None:
        the images as they are.
    blur
        The estimates of blur and noise, if requested.
    alignment
        How the rows of the images correspond, if this was requested and could be estimated.
    search
        The disparities to search, and whether they were given or found. None: they were given.
    packing
        How the pixels become gray, which depends on their values alone: the step and the bits of
        the integers that they are, 0 bits for floats; whether the three channels of the left and
        of the right image are equal, so that one is enough.
    ranges
        Where the pixels of the left and of the right image lie: (black, white) in thousandths of
        their unit, but for 0.1 % at either end. None: not needed, as for 8 bits.
    borders
        The black borders of the left and of the right image, which are masked: the lengths of the
        runs from the top and from the bottom, by column, then from the left and from the right, by
        row, uint32. None: the images have no borders.
    overlays
        Overlays of both images, such as clocks, which are masked: of each rectangle the first row
        and that after the last one, then the same of its columns.
    findings
        Findings about the pair, as from `phasestereo.check`.
    roughness
        By how much horizontal neighbors of the left image differ: the sum, in steps of gray
        values, and of how many pairs. None: not needed.
    tally
        What all confidences depend on, counted over some rows of the map: the sum of the raw
        confidences of pixels not filled, in steps of 2^-20, and the number of these pixels; of
        pixels that fail the left-right check or are speckles; of those at the ends of the range;
        of all. None: not needed.
    """

    size: tuple[int, int]
    dtype: str
    min_disparity: int
    num_disparities: int
    settings: Settings
    blur_compensation: BlurCompensation | None = None
    blur: BlurEstimate | None = None
    alignment: Alignment | None = None
    search: SearchRange | None = None
    packing: Packing = (1.0, 0, False, False)
    ranges: tuple[Range, Range] | None = None
    roughness: tuple[int, int] | None = None
    tally: tuple[int, int, int, int, int] | None = None
    findings: tuple[Finding, ...] = ()
    borders: Borders = (None, None)
    overlays: tuple[Rectangle, ...] = ()

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
        arrays = _as_arrays(self)
        with replacing(path) as file:
            np.savez(file, allow_pickle=False, **arrays)


def load(path: str | os.PathLike[str]) -> PairStatistics:
    """Read a file written by `PairStatistics.save`.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is not such a file.
    """
    with decoding(path) as file:
        return _from_arrays(decode_arrays(read_bounded(file, STATISTICS), STATISTICS))


def as_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return numbers of rows and columns, or say by name why they are none."""
    if not isinstance(size, (tuple, list)) or len(size) != 2:
        raise TypeError(f"size: got {size!r}; accepts a pair (rows, columns)")

    rows, cols = size
    return as_integer("size", rows, least=1), as_integer("size", cols, least=1)


def _as_arrays(statistics: PairStatistics) -> Arrays:
    """Return arrays that `_from_arrays` makes the same statistics of."""
    arrays: Arrays = {}

    def plain(value: Any) -> Any:
        if is_dataclass(value):
            return {each.name: getattr(value, each.name) for each in fields(value)}
        if isinstance(value, np.ndarray):
            arrays[name := f"array_{len(arrays)}"] = value
            return name
        return value.item()  # a number of NumPy, which JSON refuses

    text = json.dumps(statistics, default=plain)
    return arrays | {"plain": np.array(text)}


def _from_arrays(arrays: Mapping[str, NDArray[Any]]) -> PairStatistics:
    """Return the statistics that arrays hold.

    Raises
    ------
    RecursionError, TypeError, ValueError
        If they hold none.
    """
    if "plain" not in arrays:
        raise ValueError(f"an archive of {sorted(arrays)}; accepts what a PairStatistics saves")
    plain = json.loads(str(arrays["plain"]))
    found: PairStatistics = decoded(PairStatistics, plain, "statistics", arrays, _OTHERS)

    as_size(found.size)
    step, bits, *_ = found.packing
    counts = (*(found.roughness or ()), *(found.tally or ()))
    field = found.alignment
    rows = [] if field is None else [field.coefficients, field.errors, field.sway]
    areas = found.blur
    check_ranges({
        "dtype": found.dtype in ("uint8", "uint16", "float32", "float64"),
        "num_disparities": 0 < found.num_disparities < 2**31,
        "min_disparity": abs(found.min_disparity) < 2**31,
        "packing": 0 < step < math.inf and 0 <= bits <= _MOST_BITS,
        "borders": all(
            border is None or border.shape == (2 * sum(found.size),) for border in found.borders
        ),
        "overlays": all(
            0 <= top < bottom <= found.size[0] and 0 <= left < right <= found.size[1]
            for top, bottom, left, right in found.overlays
        ),
        "roughness, tally": all(0 <= count < 2**64 for count in counts),
        "coefficients, errors, sway": [*map(len, rows)] in ([], [8, 16, 0], [8, 16, 19])
        and all(math.isfinite(value) for values in rows for value in values),
        "blurs": areas is None or int(areas.labels.max(initial=0)) < len(areas.blurs),
    })  # fmt: skip
    return found


_MOST_BITS = 16
_Kernel: TypeAlias = NDArray[np.float32] | None
_OTHERS: dict[Any, dict[str, Any]] = {
    BlurCompensation: {"kernels": tuple[tuple[_Kernel, _Kernel], ...]},
}
"""The types of fields as they are kept, where others may be given."""

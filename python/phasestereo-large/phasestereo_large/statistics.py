"""The statistics of a whole pair that matching its parts needs, and the files that keep them.

A file is an ``.npz`` without pickled objects; one array of JSON holds everything that is not an
array. Files may come from anywhere, so this module checks everything in them.
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
    """The statistics of a whole pair, from `pair_statistics`; you can pickle and save them.

    Parameters
    ----------
    size
        Rows and columns of either image.
    dtype
        Type of the pixels, "uint8", "uint16", "float32" or "float64".
    min_disparity, num_disparities
        The disparities to search.
    settings
        The settings for matching every part; with ``compensate_blur=True``, those that suit the
        blur found.
    blur_compensation
        The kernels for the images that the match compares, for the whole pair, and the noise. None:
        unchanged images.
    blur
        The estimates of blur and noise, if the settings request them.
    alignment
        The alignment of the images' rows, if the settings request it and the images show it.
    search
        The disparities to search, and whether the caller gave them or the search found them. None:
        the caller gave them.
    packing
        How the pixels become gray, which depends only on their values: the step and the bits of
        integers, 0 bits for floats; whether the three channels of the left and of the right image
        are equal, so that one is enough.
    ranges
        The ranges of the pixels of the left and of the right image: (black, white) in thousandths
        of their unit, without 0.1 % at either end. None: not needed, as for 8 bits.
    borders
        The black borders of the left and of the right image, which the match masks: the lengths of
        the runs from the top and from the bottom, by column, then from the left and from the right,
        by row, uint32. None: the images have no borders.
    overlays
        Overlays of both images, such as clocks, which the match masks: for each rectangle the first
        row and the one after the last, then the same for its columns.
    findings
        Findings about the pair, like those of `phasestereo.check`.
    roughness
        The differences between horizontal neighbors in the left image: their sum, in steps of gray
        values, and the number of pairs. None: not needed.
    tally
        Counts over some rows of the map that all confidences depend on: the sum of the raw
        confidences of pixels not filled, in steps of 2^-20, and the number of these pixels; the
        number of pixels that fail the left-right check or are speckles; of those at the ends of the
        range; of all. None: not needed.
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
        """Whether to match the negative of the right image."""
        return self.search is not None and self.search.inverted and self.settings.compensate_blur

    @property
    def is_compensated(self) -> bool:
        """Whether the estimate found a blur and adapted the settings to it."""
        found = self.blur is not None and any(blur.psf is not None for blur in self.blur.blurs)
        return found and self.settings.compensate_blur

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the statistics to a file for `load`, an ``.npz`` without pickled objects.

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
    """Return numbers of rows and columns, or raise an error that names them."""
    if not isinstance(size, (tuple, list)) or len(size) != 2:
        raise TypeError(f"size: got {size!r}; accepts a pair (rows, columns)")

    rows, cols = size
    return as_integer("size", rows, least=1), as_integer("size", cols, least=1)


def _as_arrays(statistics: PairStatistics) -> Arrays:
    """Return arrays that `_from_arrays` turns back into the same statistics."""
    arrays: Arrays = {}

    def plain(value: Any) -> Any:
        if is_dataclass(value):
            return {each.name: getattr(value, each.name) for each in fields(value)}
        if isinstance(value, np.ndarray):
            arrays[name := f"array_{len(arrays)}"] = value
            return name
        return value.item()  # a NumPy number, which JSON refuses

    text = json.dumps(statistics, default=plain)
    return arrays | {"plain": np.array(text)}


def _from_arrays(arrays: Mapping[str, NDArray[Any]]) -> PairStatistics:
    """Return the statistics in these arrays.

    Raises
    ------
    RecursionError, TypeError, ValueError
        If they do not hold statistics.
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
"""The stored types of fields for which callers may give other types."""

"""What must be known of a whole pair to match parts of it, and the files that keep it.

A file is an ``.npz`` without pickled objects; what is not an array is in one array of JSON. Files
may come from anywhere: all is checked.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, astuple, dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from phasestereo._core import MOST_CLASSES
from phasestereo._numbers import as_integer
from phasestereo.io.files import decoding, read_bounded, replacing
from phasestereo.io.limits import STATISTICS
from phasestereo.io.npz import decode_arrays
from phasestereo.rig.alignment import Alignment
from phasestereo.rig.blur import Blur, BlurEstimate
from phasestereo.rig.compensation import BlurCompensation
from phasestereo.rig.findings import Finding, Severity
from phasestereo.rig.search_range import LeftOut, SearchRange
from phasestereo.settings import Settings

Range: TypeAlias = tuple[float, float]
Packing: TypeAlias = tuple[float, int, bool, bool]
Plain: TypeAlias = dict[str, Any]
Arrays: TypeAlias = dict[str, NDArray[Any]]

_ESTIMATE = "tile", "certainty", "contrast", "noise", "gain", "gamma", "impulses", "coding"
_BOTH = "noise", "impulses", "coding"  # of the left and of the right image


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
        What was found out about blur and noise, if that was asked for.
    alignment
        How the rows of the images correspond, if that was asked for and could be estimated.
    search
        The disparities to search, and whether they were given or found. None: they were given.
    packing
        How the pair is stored while it is matched, which depends on its values alone: the step and
        the bits of the integers that the pixels become, 0 bits where they keep their type; whether
        the channels of the left and of the right image are equal, so that one is enough.
    ranges
        Where the pixels of the left and of the right image lie, packed: (black, white) in
        thousandths of their unit, but for 0.1 % at either end. None: not needed.
    findings
        What there is to say about the pair, as `phasestereo.check` says it.
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
    """Read what `PairStatistics.save` has written.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is no such file.
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
    names = (
        "size",
        "dtype",
        "packing",
        "ranges",
        "roughness",
        "tally",
        "min_disparity",
        "num_disparities",
    )

    plain: Plain = {name: getattr(statistics, name) for name in names}
    plain["settings"] = asdict(statistics.settings)
    plain["alignment"] = statistics.alignment and asdict(statistics.alignment)
    plain["search"] = statistics.search and asdict(statistics.search)
    plain["findings"] = [astuple(found) for found in statistics.findings]

    arrays: Arrays = {}
    if statistics.blur_compensation is not None:
        _put_blur_compensation(statistics.blur_compensation, plain, arrays)
    if statistics.blur is not None:
        _put_blur(statistics.blur, plain, arrays)

    # Numbers may be of NumPy's types, which JSON refuses.
    text = json.dumps(plain, default=lambda number: number.item())
    return arrays | {"plain": np.array(text)}


def _from_arrays(arrays: Mapping[str, NDArray[Any]]) -> PairStatistics:
    """Return the statistics that arrays hold.

    Raises
    ------
    AttributeError, KeyError, OverflowError, TypeError, ValueError
        If they hold none.
    """
    plain = json.loads(str(arrays["plain"]))
    settings: Plain = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in plain["settings"].items()
    }

    return PairStatistics(
        size=as_size(plain["size"]),
        dtype=plain["dtype"],
        min_disparity=as_integer("min_disparity", plain["min_disparity"]),
        num_disparities=as_integer("num_disparities", plain["num_disparities"]),
        settings=Settings(**settings),
        blur_compensation=_blur_compensation(plain, arrays) if "noise" in plain else None,
        blur=_blur(plain, arrays) if "blur" in plain else None,
        alignment=plain["alignment"] and _alignment(plain["alignment"]),
        search=plain["search"] and _search(**plain["search"]),
        packing=_packing(*plain["packing"]),
        ranges=plain["ranges"] and _ranges(*plain["ranges"]),
        roughness=plain["roughness"] and _roughness(*plain["roughness"]),
        tally=plain["tally"] and _tally(*plain["tally"]),
        findings=tuple(_finding(*found) for found in plain["findings"]),
    )


def _search(left_out: list[Plain], **others: Any) -> SearchRange:
    places = (
        LeftOut(tuple(rows), tuple(columns), **ends)
        for rows, columns, ends in (
            (place.pop("rows"), place.pop("columns"), place) for place in left_out
        )
    )
    return SearchRange(**others, left_out=tuple(places))


def _put_blur_compensation(compensation: BlurCompensation, plain: Plain, arrays: Arrays) -> None:
    kernels = list(compensation.kernels)
    names = "noise", "impulses", "smoothing", "tile"
    plain |= {name: getattr(compensation, name) for name in names}
    plain["classes"] = len(kernels)

    arrays["labels"] = compensation.labels
    for number, pair in enumerate(kernels):
        for side, taps in zip(("left", "right"), pair, strict=True):
            if taps is not None:
                arrays[f"{side}_{number}"] = np.asarray(taps)


def _blur_compensation(plain: Plain, arrays: Mapping[str, NDArray[Any]]) -> BlurCompensation:
    if plain["classes"] > MOST_CLASSES:
        raise ValueError(f"classes: got {plain['classes']}; accepts {MOST_CLASSES} at most")
    return BlurCompensation(
        noise=tuple(plain["noise"]),
        impulses=tuple(plain["impulses"]),
        smoothing=tuple(plain["smoothing"]),
        kernels=[
            (arrays.get(f"left_{number}"), arrays.get(f"right_{number}"))
            for number in range(plain["classes"])
        ],
        labels=arrays["labels"],
        tile=plain["tile"],
    )


def _put_blur(estimate: BlurEstimate, plain: Plain, arrays: Arrays) -> None:
    plain["blur"] = {name: getattr(estimate, name) for name in _ESTIMATE}
    plain["blurs"] = [blur.as_dict() for blur in estimate.blurs]

    arrays["blur_labels"] = estimate.labels
    for number, blur in enumerate(estimate.blurs):
        if blur.psf is not None:
            arrays[f"psf_{number}"] = blur.psf
        if blur.other is not None and blur.other.psf is not None:
            arrays[f"other_psf_{number}"] = blur.other.psf


def _blur(plain: Plain, arrays: Mapping[str, NDArray[Any]]) -> BlurEstimate:
    kinds = enumerate(plain["blurs"])
    blurs = tuple(_kind(kind, arrays, f"psf_{number}") for number, kind in kinds)
    numbers = plain["blur"] | {name: tuple(plain["blur"][name]) for name in _BOTH}
    return BlurEstimate(blurs=blurs, labels=arrays["blur_labels"], **numbers)


def _kind(plain: Plain, arrays: Mapping[str, NDArray[Any]], psf: str) -> Blur:
    """Return a blur, and that of the other image if it lacks something, too."""
    other = plain["other"] and _kind(plain["other"], arrays, f"other_{psf}")
    return Blur(**plain | {"psf": arrays.get(psf), "other": other})


def _alignment(plain: Plain) -> Alignment:
    coefficients = tuple(map(float, plain["coefficients"]))
    return Alignment(**plain | {"coefficients": coefficients, "size": as_size(plain["size"])})


def _packing(step: float, bits: int, left: bool, right: bool) -> Packing:  # noqa: FBT001 -- as JSON has it
    if not 0 < float(step) < math.inf:
        raise ValueError(f"packing: got a step of {step}; accepts positive numbers")
    return float(step), as_integer("packing", bits, least=0, most=16), bool(left), bool(right)


def _ranges(left: Range, right: Range) -> tuple[Range, Range]:
    (black, white), (other_black, other_white) = left, right
    return (float(black), float(white)), (float(other_black), float(other_white))


def _finding(topic: str, severity: Severity, sentence: str) -> Finding:
    if not all(isinstance(text, str) for text in (topic, severity, sentence)):
        raise TypeError(f"findings: got {topic!r}, {severity!r}, {sentence!r}; accepts texts")
    return Finding(topic, severity, sentence)


def _roughness(total: int, pairs: int) -> tuple[int, int]:
    if not 0 <= pairs < 2**64 or not 0 <= total < 2**64:
        raise ValueError(f"roughness: got {total}, {pairs}; accepts integers from 0 of 64 bits")
    return total, pairs


def _tally(
    confidence: int, own: int, failed: int, ends: int, pixels: int
) -> tuple[int, int, int, int, int]:
    counts = confidence, own, failed, ends, pixels
    if not all(0 <= count < 2**64 for count in counts):
        raise ValueError(f"tally: got {counts}; accepts integers from 0 of 64 bits")
    return counts

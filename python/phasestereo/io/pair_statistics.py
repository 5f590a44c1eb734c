"""Pair statistics as arrays, which ``.npz`` files hold without pickled objects, and back.

Whatever is no array is in one array of JSON. Files may come from anywhere: all is checked.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, astuple
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from phasestereo._core import MOST_CLASSES
from phasestereo._numbers import as_integer
from phasestereo.bands import PairStatistics, as_size
from phasestereo.rig.alignment import Alignment
from phasestereo.rig.blur import Blur, BlurEstimate
from phasestereo.rig.compensation import BlurCompensation
from phasestereo.rig.findings import Finding
from phasestereo.rig.search_range import LeftOut, SearchRange
from phasestereo.settings import Settings

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from phasestereo.bands import Packing, Range
    from phasestereo.rig.findings import Severity

    Plain: TypeAlias = dict[str, Any]
    Arrays: TypeAlias = dict[str, NDArray[Any]]

_ESTIMATE = "tile", "certainty", "contrast", "noise", "gain", "gamma", "impulses", "coding"
_BOTH = "noise", "impulses", "coding"  # of the left and of the right image


def as_arrays(statistics: PairStatistics) -> Arrays:
    """Return arrays that `from_arrays` makes the same statistics of."""
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


def from_arrays(arrays: Mapping[str, NDArray[Any]]) -> PairStatistics:
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
    if estimate.glance is not None:
        arrays["blur_places"], arrays["blur_excess"] = estimate.glance
    for number, blur in enumerate(estimate.blurs):
        if blur.psf is not None:
            arrays[f"psf_{number}"] = blur.psf
        if blur.other is not None and blur.other.psf is not None:
            arrays[f"other_psf_{number}"] = blur.other.psf


def _blur(plain: Plain, arrays: Mapping[str, NDArray[Any]]) -> BlurEstimate:
    kinds = enumerate(plain["blurs"])
    blurs = tuple(_kind(kind, arrays, f"psf_{number}") for number, kind in kinds)
    numbers = plain["blur"] | {name: tuple(plain["blur"][name]) for name in _BOTH}

    is_seen = "blur_places" in arrays
    glance = (arrays["blur_places"], arrays["blur_excess"]) if is_seen else None
    return BlurEstimate(blurs=blurs, labels=arrays["blur_labels"], glance=glance, **numbers)


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

"""What the core estimates of a pair before it matches, as Python objects."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from itertools import chain
from typing import Literal, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from phasestereo.rig.alignment import Alignment, Field
from phasestereo.rig.blur import BlurEstimate, Estimated, as_estimate
from phasestereo.rig.compensation import BlurCompensation
from phasestereo.rig.findings import Finding, Said, as_findings
from phasestereo.rig.photometry import Measured, Photometry, as_photometry
from phasestereo.rig.search_range import LeftOut, SearchRange
from phasestereo.settings import Settings

_Taps: TypeAlias = NDArray[np.float32] | None

_Checked = TypeVar("_Checked", Settings, BlurCompensation)

Span: TypeAlias = tuple[int, int, float, float, bool, bool, bool]
"""Disparities, ends of what was found, whether swapped, mixed, identical."""

Place: TypeAlias = tuple[tuple[int, int], tuple[int, int], float, float]
"""Rows, columns and disparities of a place that the range leaves out."""

Found: TypeAlias = tuple[
    tuple[int, int],
    "float | None",
    bool,
    "Span | None",
    "list[Place]",
    "tuple[Field, float, int, float, float] | None",
    "Field | None",
    "Estimated | None",
    "tuple[list[tuple[float, float]], list[tuple[_Taps, _Taps]], NDArray[np.uint8], int, "
    "tuple[int, int]] | None",
    float,
    "Measured | None",
    "list[Said]",
]
"""What the core returns: disparities, confidence of a rough match, whether that takes an inverted
image, range, places that it leaves out, offsets of rows, the field that is applied, blur, what
suits it, seconds, what gray values say, and findings on the pair."""

Matched: TypeAlias = (
    "tuple[NDArray[np.float32], NDArray[np.uint16], NDArray[np.float32] | None, "
    "NDArray[np.float32] | None, dict[str, float]]"
)
"""What a match gives: disparities, flags, confidence, uncertainty, seconds of its stages."""

Summarized: TypeAlias = tuple[float, float, float, float, float, float, float, float, float]
"""What a map says about itself: the fields of `phasestereo.Summary`."""

Supported: TypeAlias = "tuple[NDArray[np.uint8], float]"
"""What a temporal filter gives: how many frames support each disparity, seconds."""

Known: TypeAlias = (
    "tuple[tuple[float, float] | None, BlurCompensation | None, Field | None, bool, list[Said]]"
)
"""What the core is given: noise, the blur compensation, the field of the rows, whether the right
image is to be inverted, and findings on an earlier pair."""


@dataclass(frozen=True, slots=True, eq=False)
class Estimates:
    """What was estimated of a pair, and the settings and the compensation that suit it."""

    settings: Settings
    search: SearchRange
    alignment: Alignment | None
    blur: BlurEstimate | None
    blur_compensation: BlurCompensation | None
    seconds: float
    photometry: Photometry | None
    findings: tuple[Finding, ...]


def as_estimates(
    found: Found,
    settings: Settings,
    search: tuple[int, int | None],
    blur_compensation: BlurCompensation | None,
) -> Estimates:
    """Return what the core has estimated, completed by what the caller gave."""
    disparities, confidence, inverted, span, places, offsets, field, blur, suited = found[:9]
    seconds, measured, said = found[9:]
    photometry = None if measured is None else as_photometry(measured)
    curve = None if photometry is None else photometry.contrast

    # What the core found calls for a compensation, and for sizes that suit it.
    if suited is not None:
        (noise, impulses, smoothing), kernels, labels, tile, (neighborhood, window) = suited
        for array in (labels, *chain.from_iterable(kernels)):
            if array is not None:
                array.flags.writeable = False

        blur_compensation = _from_core(
            BlurCompensation,
            noise=noise,
            kernels=tuple(kernels),
            labels=labels,
            tile=tile,
            impulses=impulses,
            smoothing=smoothing,
        )
        same = {field.name: getattr(settings, field.name) for field in fields(settings)}
        suits = {"neighborhood": neighborhood, "window": window}
        settings = _from_core(Settings, **(same | suits))

    return Estimates(
        settings=settings,
        search=replace(
            _search(disparities, confidence, span, is_given=search[1] is not None),
            inverted=inverted,
            left_out=tuple(LeftOut(*place) for place in places),
        ),
        alignment=_alignment(offsets, field),
        blur=None if blur is None else as_estimate(blur, curve),
        blur_compensation=blur_compensation,
        seconds=seconds,
        photometry=photometry,
        findings=as_findings(said),
    )


def _from_core(kind: type[_Checked], **values: object) -> _Checked:
    """Return a frozen dataclass of what the core found, which the core need not check again."""
    made = object.__new__(kind)
    for name, value in values.items():
        object.__setattr__(made, name, value)
    return made


def _search(
    disparities: tuple[int, int],
    confidence: float | None,
    span: Span | None,
    *,
    is_given: bool,
) -> SearchRange:
    sure = math.nan if confidence is None else confidence
    if span is None:
        return SearchRange(*disparities, "given" if is_given else "default", sure)

    _, _, low, high, swapped, mixed, identical = span
    origin: Literal["given", "found"] = "given" if is_given else "found"
    return SearchRange(*disparities, origin, sure, low, high, swapped, mixed, identical)


def _alignment(
    offsets: tuple[Field, float, int, float, float] | None, field: Field | None
) -> Alignment | None:
    if offsets is None:
        return None

    (coefficients, size, _), error, blocks, spread, wobble = offsets
    applied = field is not None
    return Alignment(tuple(coefficients), error, blocks, spread, wobble, size, applied)

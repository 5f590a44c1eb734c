"""What a diagnosis means, in plain words: severities, sentences, and from where on they apply.

Here belongs everything between the numbers of a `phasestereo.diagnosis.Diagnosis` and its reader.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from phasestereo.rough import LEAST_SIZE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from phasestereo.alignment import Alignment
    from phasestereo.blur import Blur
    from phasestereo.diagnosis import Contrast, Diagnosis

    Severity = Literal["ok", "note", "warning"]

__all__ = ["Finding", "of", "spread"]

# From where on something is noted, and from where on it is warned of. Pairs as they come are below
# the first: rows of Middlebury's are off by up to 0.26 pixels rms, medians of their gray levels
# differ by up to 9 %, and gamma by up to 7 %.
_ROWS = 0.3, 0.75  # pixels, rms over the image
_ERRORS = 4.0, 5.0  # times the standard error, which the same must be
_PART_ERRORS = 3.0
_PART = 0.25, 0.5  # pixels at the centre, and at the border: parts worth telling
_CONTRAST = 0.12, 0.35  # logarithm of the ratio of gray levels
_GAMMA = 0.13, 0.37  # logarithm
_BLUR = 0.3, 0.7  # pixels, root mean square along an axis
_BLUR_SHARE = 0.05  # of the image
_SURE = 0.5
_NOISE = 0.02, 0.05  # of the range
_SATURATED = 0.05, 0.2  # of the pixels
_TEXTURELESS = 0.5, 0.8  # of the image
_UNIFORM = 0.97  # of the image
_LEAST_FACTOR = 1e-6
_ORDER: tuple[Severity, ...] = ("ok", "note", "warning")


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that there is to say about a pair.

    Parameters
    ----------
    topic
        "swap", "range", "alignment", "blur", "contrast", "noise", "saturation" or "texture".
    severity
        "ok", "note" (worth knowing) or "warning" (to be mended).
    sentence
        Plain words, with numbers.
    """

    topic: str
    severity: Severity
    sentence: str


def of(diagnosis: Diagnosis) -> tuple[Finding, ...]:
    """Return what there is to say about a pair, in a fixed order of topics."""
    return (
        *_search(diagnosis),
        _rows(diagnosis),
        *_blur(diagnosis),
        _contrast(diagnosis),
        _noise(diagnosis),
        _saturation(diagnosis),
        _texture(diagnosis),
    )


def _search(diagnosis: Diagnosis) -> Iterator[Finding]:
    found = diagnosis.search
    if found is None:
        yield _unknown(diagnosis, "range", "which disparities to search") or Finding(
            "range",
            "warning",
            "hardly anything in one image is found in the other: these are no pair, or far from "
            "rectified",
        )
        return
    ends = f"{round(found.low)} to {round(found.high)} px"
    if found.swapped:
        yield Finding(
            "swap",
            "warning",
            f"left and right seem to be swapped, since all disparities are negative ({ends}): "
            "exchange the images (cameras that squint, so that all of the scene is behind the "
            "point they look at, give the same: then search negative disparities)",
        )
    elif found.mixed:
        yield Finding(
            "swap",
            "note",
            f"disparities of both signs ({ends}): the cameras squint, or the images are cropped; "
            "search from a negative disparity on",
        )
    else:
        yield Finding("swap", "ok", "left and right are in their places")
    yield Finding(
        "range",
        "ok",
        f"disparities are {ends}: match with min_disparity {found.min_disparity} and "
        f"num_disparities {found.num_disparities}",
    )


def _rows(diagnosis: Diagnosis) -> Finding:
    found = diagnosis.alignment
    if found is None:
        return _unknown(diagnosis, "alignment", "whether rows correspond") or Finding(
            "alignment",
            "note",
            "too little is found in both images to tell whether rows correspond",
        )
    least, much = (
        max(rows, errors * found.error) for rows, errors in zip(_ROWS, _ERRORS, strict=True)
    )
    severity = _severity(found.rms, (least, much))
    off = f"{found.rms:.2f} px rms, known to {found.error:.2f} px"
    if severity == "ok":
        return Finding("alignment", "ok", f"rows correspond as well as can be told ({off})")
    parts = " and ".join(_parts(found)) or "is out of line"
    return Finding(
        "alignment", severity, f"the right image {parts} ({off}): rectify the pair again"
    )


def _parts(found: Alignment) -> Iterator[str]:
    """Name the parts of a misalignment that are seen."""
    rows, cols = found.size
    centre, border = (max(part, _PART_ERRORS * found.error) for part in _PART)
    if abs(found.vertical) >= centre:
        where = "lower" if found.vertical > 0 else "higher"
        yield f"shows things {abs(found.vertical):.1f} px {where} than the left one"
    if abs(found.slope_x) * cols / 2 >= border:
        turn = "clockwise" if found.slope_x > 0 else "counter-clockwise"
        yield f"is rotated {turn} (or sheared) by {abs(found.rotation):.2f} degrees"
    if abs(found.slope_y) * rows / 2 >= border:
        yield f"shows things at {found.scale:.3f} times the height"


def _blur(diagnosis: Diagnosis) -> Iterator[Finding]:
    estimate = diagnosis.blur
    if estimate is None:
        yield _not_measured(diagnosis, "blur", "which image is softer")
        return
    seen = [
        (blur, share)
        for blur, share in zip(estimate.blurs, estimate.areas(), strict=True)
        if spread(blur) >= _BLUR[0] and share >= _BLUR_SHARE
    ]
    for blur, share in seen:
        grave = spread(blur) >= _BLUR[1] and estimate.certainty >= _SURE
        where = "" if len(estimate.blurs) == 1 else f", over {share:.0%} of the image"
        probably = "" if estimate.certainty >= _SURE else "probably "
        other = "right" if blur.side == "left" else "left"
        yield Finding(
            "blur",
            "warning" if grave else "note",
            f"the {blur.side} image is {probably}softer than the {other} by {_shape(blur)}{where}: "
            f"{_cure(blur)}; robust matching will compensate",
        )
    if not seen:
        yield Finding("blur", "ok", "the images are equally sharp")


def spread(blur: Blur) -> float:
    """Return the standard deviation of a kernel along an axis, or along its path: pixels."""
    match blur.kind:
        case "gaussian":
            return blur.size
        case "disk":
            return blur.size / 2
        case "motion":
            return (blur.size - 1) / math.sqrt(12)
        case "other":
            return blur.size / math.sqrt(2)
    return 0.0


def _shape(blur: Blur) -> str:
    match blur.kind:
        case "gaussian":
            return f"a Gaussian of sigma {blur.size:.1f} px"
        case "disk":
            return f"a disk of radius {blur.size:.1f} px"
        case "motion":
            return f"a motion of {blur.size:.1f} px at {blur.angle:.0f} degrees"
    return f"a blur of no simple shape, of radius {blur.size:.1f} px rms"


def _cure(blur: Blur) -> str:
    if blur.kind in ("gaussian", "disk"):
        return "check its focus"
    return "check its mount and its exposure time"


def _contrast(diagnosis: Diagnosis) -> Finding:
    found = diagnosis.contrast
    if found is None or diagnosis.search is None:  # without a match there is nothing to compare
        return _not_measured(diagnosis, "contrast", "gain and gamma")
    severity = max(
        _severity(_distance(found.ratio), _CONTRAST),
        _severity(_distance(found.gamma), _GAMMA),
        key=_ORDER.index,
    )
    curve = f"left = {found.gain:.2f} x right ^ {found.gamma:.2f}"
    if severity == "ok":
        return Finding("contrast", "ok", f"both images are equally bright ({curve})")
    return Finding(
        "contrast", severity, f"{_difference(found)} ({curve}): check exposure, gain and gamma"
    )


def _difference(found: Contrast) -> str:
    if _distance(found.ratio) < _CONTRAST[0]:
        return "gray levels follow another curve in the right image"
    darker, other = ("right", "left") if found.ratio > 1 else ("left", "right")
    times = math.exp(-_distance(found.ratio))
    return f"the {darker} image is darker, its gray levels {times:.2f} times the {other} one's"


def _distance(factor: float) -> float:
    """Return how far a factor is from 1, the same for its inverse."""
    return abs(math.log(max(factor, _LEAST_FACTOR)))


def _noise(diagnosis: Diagnosis) -> Finding:
    found = diagnosis.noise
    if found is None:
        return _not_measured(diagnosis, "noise", "the noise")
    severity = _severity(max(found) / diagnosis.intensity_range, _NOISE)
    sentence = f"noise of {found[0]:.2g} gray levels in the left image, {found[1]:.2g} in the right"
    if severity != "ok":
        sentence += ": more light, or less gain, would help"
    return Finding("noise", severity, sentence)


def _saturation(diagnosis: Diagnosis) -> Finding:
    worst, where = max(
        (share, f"{share:.0%} of the {side} image is {end}")
        for side, found in zip(("left", "right"), diagnosis.saturation, strict=True)
        for share, end in (
            (found.bright, "as bright as it can be: expose it less"),
            (found.dark, "as dark as it can be: expose it longer"),
        )
    )
    if worst == 1:
        return Finding("saturation", "note", "an image of one or two gray levels: too few to tell")
    severity = _severity(worst, _SATURATED)
    if severity == "ok":
        return Finding("saturation", "ok", "hardly any pixel is at an end of the scale")
    return Finding("saturation", severity, where)


def _texture(diagnosis: Diagnosis) -> Finding:
    found = diagnosis.low_texture
    if found is None:
        return Finding("texture", "note", "the images are too small to tell their texture")
    share = max(found)
    severity = _severity(share, _TEXTURELESS)
    sentence = f"{share:.0%} of the image has no texture beyond noise"
    if severity != "ok":
        sentence += ": disparities there are guesses; project a pattern, or light it from the side"
    return Finding("texture", severity, sentence)


def _severity(value: float, levels: tuple[float, float]) -> Severity:
    if value >= levels[1]:
        return "warning"
    return "note" if value >= levels[0] else "ok"


def _unknown(diagnosis: Diagnosis, topic: str, what: str) -> Finding | None:
    """Say that size or uniformity of the images keeps something from being told, if it is that."""
    if min(diagnosis.size) < LEAST_SIZE:
        return Finding(topic, "note", f"the images are too small to tell {what}")
    if diagnosis.low_texture is not None and max(diagnosis.low_texture) >= _UNIFORM:
        return Finding(topic, "note", f"the images have too little texture to tell {what}")
    return None


def _not_measured(diagnosis: Diagnosis, topic: str, what: str) -> Finding:
    return _unknown(diagnosis, topic, what) or Finding(
        topic, "note", f"the images have too little in common to tell {what}"
    )

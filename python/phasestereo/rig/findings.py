"""What a diagnosis or a match means, in plain words: severities, sentences, and from where on.

Here belongs everything between the numbers of a `phasestereo.rig.diagnosis.Diagnosis` or of a
`phasestereo.Result` and their reader.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from phasestereo._core import LEAST_SIZE

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from phasestereo.result import Result, Summary
    from phasestereo.rig.alignment import Alignment
    from phasestereo.rig.blur import Blur, BlurEstimate
    from phasestereo.rig.diagnosis import Contrast, Diagnosis
    from phasestereo.rig.search_range import SearchRange

    Severity = Literal["ok", "note", "warning"]

__all__ = [
    "LEVELS",
    "Finding",
    "MatchWarning",
    "match_findings",
    "pair_findings",
    "spread",
    "untrusted",
    "warn",
]

# From where on something is noted, and from where on it is warned of. Ordinary pairs are below the
# first: rows of Middlebury's are off by up to 0.26 pixels rms, medians of their gray levels
# differ by up to 9 %, and gamma by up to 7 %.
_ROWS = 0.3, 0.75  # pixels, rms over the image
_ERRORS = 4.0, 5.0  # times the standard error, which the same must be
_PART_ERRORS = 3.0
_PART = 0.25, 0.5  # pixels at the center, and at the border: parts worth naming
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

# Of matches. On 12 pairs, sharp, after six one-sided blurs and with changed contrast: rough
# confidence 0.58 to 0.95, up to 22 % flagged, up to 0.1 % at the largest disparity; images that
# have nothing in common: 0.11 to 0.44 (a range of 16 disparities) and 43 % or more; rows 2 px off:
# 38 % or more; a range of a third: 3 % or more at its end, 11 % flagged.
_LEAST_ROUGH = 0.45
_FLAGGED = 0.25, 0.35  # of the pixels
_AT_END = 0.01, 0.02  # of the pixels
_BEYOND = 0.2  # of the range


LEVELS = {
    "rows": _ROWS,
    "errors": _ERRORS,
    "part": _PART,
    "part_errors": _PART_ERRORS,
    "contrast": _CONTRAST,
    "blur": _BLUR,
    "blur_share": _BLUR_SHARE,
    "sure": _SURE,
    "noise": _NOISE,
    "saturated": _SATURATED,
}
"""Levels of pairs by topic: the page that matches in a browser uses them, too."""

_NOTHING = (
    "hardly anything in one image is found in the other: these are no pair, or far from rectified"
)
_INVERTED = "what is bright in one image is dark in the other"
_INVERT = "invert one of them (255 - image), or match with compensate_blur=True, which does"
_TRUST = "match", "swap", "range"  # topics that decide whether a match is to be trusted at all


_SCATTERED = 0.35  # pixels: sharp pairs up to 0.28, with rows that wave by 1 px 0.41 or more


class MatchWarning(UserWarning):
    """A match as a whole is not to be trusted: what `phasestereo.match` warns of."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that there is to say about a pair, or about a match.

    Parameters
    ----------
    topic
        "match", "swap", "range", "alignment", "blur", "contrast", "noise", "saturation" or
        "texture".
    severity
        "ok", "note" (worth knowing) or "warning" (to be mended).
    sentence
        Plain words, with numbers.
    """

    topic: str
    severity: Severity
    sentence: str


def pair_findings(diagnosis: Diagnosis) -> tuple[Finding, ...]:
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


def match_findings(result: Result) -> tuple[Finding, ...]:
    """Return what there is to say about a match, the worst first: nothing if all is well.

    Without a left-right check, wrong matches lie anywhere in the range, and nothing is said of it.
    """
    search, summary = result.search, result.summary
    if search is None or summary is None or min(result.disparity.shape) < LEAST_SIZE:
        return ()

    asked = result.settings
    is_checked = asked.lr_check is not None
    found = list(_match(search, summary, evened=asked.compensate_blur)) if is_checked else []
    found += _matched_rows(result)

    if result.blur is not None and not result.blur.reused:
        # The blur was evened out, so it is never more than a note.
        found += (
            replace(one, severity="note") for one in _blur_of(result.blur) if one.severity != "ok"
        )

    return tuple(sorted(found, key=lambda one: -_ORDER.index(one.severity)))


def untrusted(found: Iterable[Finding]) -> list[Finding]:
    """Return those for which a match as a whole is not to be trusted."""
    return [one for one in found if one.severity == "warning" and one.topic in _TRUST]


def warn(found: tuple[Finding, ...]) -> None:
    """Warn of a match that is not to be trusted as a whole."""
    grave = [one.sentence for one in untrusted(found)]
    if grave:
        warnings.warn("; ".join(grave), MatchWarning, stacklevel=3)


def _match(search: SearchRange, summary: Summary, *, evened: bool) -> Iterator[Finding]:
    """Yield findings on the match as a whole, and on its range."""
    if search.swapped:
        yield _swapped(f"{round(search.low)} to {round(search.high)} px")
        return
    if search.inverted and not evened:
        yield Finding("match", "warning", f"{_INVERTED}: {_INVERT}")
        return

    if search.inverted:
        yield Finding("contrast", "note", f"{_INVERTED}: the negative of the right one was matched")

    is_unlike = search.confidence < _LEAST_ROUGH and math.isnan(search.low)
    if is_unlike or search.origin == "default":
        yield Finding("match", "warning", _NOTHING)
        return

    last = search.min_disparity + search.num_disparities - 1
    at_low = summary.at_low if search.min_disparity != 0 else 0.0  # nothing lies behind infinity
    severity = _severity(max(at_low, summary.at_high), _AT_END)
    beyond = max(search.min_disparity - search.low, search.high - last)  # NaN: nothing is known
    is_short = search.origin == "given" and beyond > _BEYOND * search.num_disparities

    if severity != "ok" or is_short:
        known = "" if math.isnan(search.low) else f": there seem to be {round(search.low)} to "
        known += "" if math.isnan(search.low) else f"{round(search.high)} px"
        yield Finding(
            "range",
            max(severity, "warning" if is_short else "ok", key=_ORDER.index),
            f"the range of {search.min_disparity} to {last} px is too short: "
            f"{max(at_low, summary.at_high):.0%} of the pixels are at its end{known}; search more "
            "disparities, or leave num_disparities out",
        )

    severity = _severity(summary.flagged, _FLAGGED)
    if severity != "ok":
        yield Finding(
            "match",
            severity,
            f"{summary.flagged:.0%} of the pixels fail the left-right check: "
            "check that rows correspond, the range of disparities, noise and focus",
        )


def _matched_rows(result: Result) -> Iterator[Finding]:
    """Yield findings on the rows, and on what was done about them."""
    found = result.alignment
    if found is None:
        return

    if found.applied and found.rms >= _ROWS[0]:
        parts = " and ".join(_parts(found)) or "is out of line"
        yield Finding(
            "alignment",
            "note",
            f"the right image {parts} ({found.rms:.2f} px rms): it was straightened, to about "
            f"{found.error:.2f} px; rectify the pair again",
        )
    elif not found.applied and found.rms >= max(_ROWS[1], _ERRORS[1] * found.error):
        yield Finding(
            "alignment",
            "note",
            f"rows seem to be {found.rms:.2f} px rms off, but straightening does not help: the "
            "baseline may not be level",
        )

    # Where one image is blurred, the blocks scatter anyway.
    is_blurred = result.blur is not None and result.blur.blur.side != "none"
    if found.spread > _SCATTERED and not is_blurred:
        yield Finding(
            "alignment",
            "note",
            f"rows are scattered by {found.spread:.1f} px about any smooth field: they may wobble, "
            "as those of a rolling shutter that shakes; that cannot be evened out",
        )


def _swapped(ends: str) -> Finding:
    return Finding(
        "swap",
        "warning",
        f"left and right seem to be swapped, since all disparities are negative ({ends}): "
        "exchange the images (cameras so toed in that all of the scene is behind the "
        "point they look at, give the same: then search negative disparities)",
    )


def _search(diagnosis: Diagnosis) -> Iterator[Finding]:
    found = diagnosis.search
    if found is None:
        yield _unknown(diagnosis, "range", "which disparities to search") or Finding(
            "range",
            "warning",
            _NOTHING,
        )
        return

    if found.inverted:
        yield Finding("contrast", "warning", f"{_INVERTED}: {_INVERT}")
    ends = f"{round(found.low)} to {round(found.high)} px"
    if found.swapped:
        yield _swapped(ends)
    elif found.mixed:
        yield Finding(
            "swap",
            "note",
            f"disparities of both signs ({ends}): the cameras are toed in, or the images are "
            "cropped; search from a negative disparity on",
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

    # An offset must be large, and clearly larger than its own error.
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
    center, border = (max(part, _PART_ERRORS * found.error) for part in _PART)

    if abs(found.vertical) >= center:
        where = "lower" if found.vertical > 0 else "higher"
        yield f"shows things {abs(found.vertical):.1f} px {where} than the left one"
    if abs(found.slope_x) * cols / 2 >= border:
        turn = "clockwise" if found.slope_x > 0 else "counter-clockwise"
        yield f"is rotated {turn} (or sheared) by {abs(found.rotation):.2f} degrees"
    if abs(found.slope_y) * rows / 2 >= border:
        yield f"shows things at {found.scale:.3f} times the height"


def _blur(diagnosis: Diagnosis) -> Iterator[Finding]:
    if diagnosis.blur is None:
        yield _not_measured(diagnosis, "blur", "which image is softer")
        return

    yield from _blur_of(diagnosis.blur)


def _blur_of(estimate: BlurEstimate) -> Iterator[Finding]:
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
        if blur.other is None:
            what = f"softer than the {other} by {_shape(blur)}"
        else:
            what = f"blurred by {_shape(blur)}, the {other} one by {_shape(blur.other)}"

        yield Finding(
            "blur",
            "warning" if grave else "note",
            f"the {blur.side} image is {probably}{what}{where}: {_hint(blur)}; robust matching "
            "will compensate",
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
        case "annulus":
            return blur.size / 1.6  # of a hole of 0.75; of one of half the radius 1.8
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
        case "annulus":
            return f"an annulus of outer radius {blur.size:.1f} px"
        case "motion":
            return f"a motion of {blur.size:.1f} px at {blur.angle:.0f} degrees"
    return f"a blur of no simple shape, of radius {blur.size:.1f} px rms"


def _hint(blur: Blur) -> str:
    if blur.kind in ("gaussian", "disk", "annulus"):
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

    curve = f"left = {found.gain:.2f} x right ^ {found.gamma:.2f}, black 0 to white 1"
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
    left, right = (f"{deviation:.2g}" for deviation in found)
    scale = f"on a scale of {diagnosis.intensity_range:.5g}"
    sentence = f"noise of {left} gray levels in the left image, {right} in the right, {scale}"
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
    """Return a finding that the images are too small or too uniform to say `what`, if they are."""
    if min(diagnosis.size) < LEAST_SIZE:
        return Finding(topic, "note", f"the images are too small to tell {what}")
    if diagnosis.low_texture is not None and max(diagnosis.low_texture) >= _UNIFORM:
        return Finding(topic, "note", f"the images have too little texture to tell {what}")
    return None


def _not_measured(diagnosis: Diagnosis, topic: str, what: str) -> Finding:
    return _unknown(diagnosis, topic, what) or Finding(
        topic, "note", f"the images have too little in common to tell {what}"
    )

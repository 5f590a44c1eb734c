"""The result of a match: the disparity map, and maps that describe each of its pixels."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from enum import IntFlag
from typing import Any, ClassVar, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from phasestereo import _core
from phasestereo.rig.alignment import Alignment
from phasestereo.rig.blur import BlurEstimate
from phasestereo.rig.compensation import BlurCompensation
from phasestereo.rig.findings import Finding, untrusted
from phasestereo.rig.rectified import Rectified
from phasestereo.rig.search_range import SearchRange
from phasestereo.settings import Settings

Layer: TypeAlias = Literal["flags", "confidence", "uncertainty"]
"""The name of a map of a result other than its disparities."""

LAYERS: tuple[Layer, ...] = get_args(Layer)

Keep: TypeAlias = Literal["trusted", "checked", "all"]
"""Which estimates become depths and points; see `Result.kept`."""

KEEPS: tuple[Keep, ...] = get_args(Keep)


@dataclass(frozen=True, slots=True)
class MapKind:
    """The content of a map of a result.

    Parameters
    ----------
    dtype
        Name of the type of its values.
    unit
        Their unit, named by the conventions for climate and forecast metadata (CF).
    meaning
        Their meaning, in words.
    optional
        Whether it is None with ``confidence=False``.
    """

    dtype: str
    unit: str
    meaning: str
    optional: bool = False


MAPS: Mapping[str, MapKind] = {
    "disparity": MapKind("float32", "pixel", "disparity"),
    "flags": MapKind("uint16", "1", "what is held against the disparity"),
    "confidence": MapKind(
        "float32", "1", "probability that the disparity is within 1 pixel", optional=True
    ),
    "uncertainty": MapKind(
        "float32",
        "pixel",
        "half the width of the interval that holds the true disparity with a probability of 90 %",
        optional=True,
    ),
}
"""The maps of a result by attribute name. Every writer of maps uses this list."""


def maps_with(settings: Settings) -> list[str]:
    """Return the names of the maps that a match with these settings returns."""
    return [name for name, kind in MAPS.items() if settings.confidence or not kind.optional]


class Flag(IntFlag):
    """Reasons why a pixel has no estimate or an untrusted one; bits of `Result.flags`.

    Examples
    --------
    >>> occluded = (result.flags & ps.Flag.OCCLUDED) != 0
    """

    MASKED = 1
    """The left pixel is masked and has no estimate."""
    NO_CANDIDATE = 2
    """No candidate has a valid pixel in the right image: the pixel has an estimate only if it is
    filled."""
    OUTSIDE = 4
    """The match lies outside the right image."""
    MATCH_MASKED = 8
    """The match lies on a masked pixel of the right image."""
    OCCLUDED = 16
    """The match belongs to another left pixel, and so do the matches of the neighbors: most likely
    the right image does not see this pixel."""
    MISMATCHED = 32
    """The match belongs to another left pixel, but neighbors have matches of their own: most likely
    the right image sees this pixel elsewhere."""
    LOW_CONFIDENCE = 64
    """The confidence is below ``min_confidence``."""
    SPECKLE = 128
    """The pixel belongs to a small region that differs from everything around it."""
    FILLED = 256
    """The disparity comes from the background next to the pixel; its own is not trusted."""
    AMBIGUOUS = 512
    """Another disparity costs nearly the same: the difference is below ``uniqueness``."""
    INFERRED = 1024
    """The disparity is that of a plane, fitted to a flat area without texture to match."""
    COARSE = 2048
    """The disparity comes from a match at half the size or less, which is more likely right here;
    the other flags are those of that match."""
    SECOND = 4096
    """The disparity comes from the map of ``second``, which is more likely right here."""

    @property
    def words(self) -> str:
        """The name in plain words."""
        return str(self.name).lower().replace("_", " ")


def count_flags(flags: NDArray[np.uint16]) -> dict[Flag, int]:
    """Return the number of pixels with each flag, 0 for unused flags."""
    return {flag: int((flags & flag != 0).sum()) for flag in Flag}


def describe_flags(flags: NDArray[np.uint16]) -> str:
    """Return the share of pixels with each flag that occurs, in words."""
    return format_counts(count_flags(flags), flags.size)


def format_counts(counts: Mapping[Flag, int], pixels: int) -> str:
    """Return the shares of pixels with each flag that occurs, in words."""
    shares = [f"{flag.words} {count / pixels:.1%}" for flag, count in counts.items() if count]
    return ", ".join(shares) or "none"


_LEAST = 0.01  # of the pixels; smaller shares are not given to the percent


@dataclass(frozen=True, slots=True)
class Summary:
    """Shares of pixels that describe a disparity map as a whole.

    Parameters
    ----------
    estimated
        Share of the pixels, 0 to 1, with an estimate.
    flagged
        Share that fails the left-right check or belongs to a speckle.
    at_low, at_high
        Share whose estimate, not filled in, is the smallest or the largest disparity searched.
    confidence
        Mean confidence; NaN without confidences.
    wrong
        Estimated share, 0 to 1, of the pixels with an estimate whose disparity is off by more than
        1 px: 1 minus the mean of their confidences. Without confidences, as with `fast`, it is
        estimated from one row in 64; NaN for images of fewer than 37 rows, and where nothing is
        compared with the texture of the image.
    coarse, inferred
        Share whose disparity comes from a smaller copy of the pair, and from a plane fitted to a
        flat area: flags `COARSE` and `INFERRED`.
    second
        Share whose disparity comes from a second map: flag `SECOND`.
    detail
        Where smaller copies decided, the images hold no detail finer than this, in pixels, 2 or
        more: the factor by which these copies are smaller, as a geometric mean over the pixels. NaN
        if none decided.

    Examples
    --------
    >>> summary = ps.match(left, right).summary
    >>> f"{summary.wrong:.0%} are probably wrong"
    """

    estimated: float
    flagged: float
    at_low: float
    at_high: float
    confidence: float
    wrong: float
    coarse: float
    inferred: float
    second: float
    detail: float

    def __str__(self) -> str:
        """State how many pixels are probably wrong, the first line of a result; "" if unknown."""
        if math.isnan(self.wrong):
            return ""
        share = f"about {100 * self.wrong:.0f} %" if self.wrong >= _LEAST else "less than 1 %"
        return f"{share} of the pixels are probably wrong"


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """A disparity map as seen from the left image; a pickle leaves out the pair.

    Parameters
    ----------
    disparity
        float32 (H, W), pixels: left pixel (x, y) corresponds to right pixel (x - disparity, y).
        NaN for pixels without an estimate, and with ``fill=False`` for untrusted ones.
    flags
        uint16 (H, W), bits of `Flag`; 0 where nothing speaks against the estimate.
    confidence
        float32 (H, W) in [0, 1], the probability that the disparity is within 1 px of the true one,
        filled ones included. It depends on the lead of the chosen candidate over all others, in the
        pixels around that share its disparity, those of similar gray value first, and on the match
        of the pair as a whole. Pixels that ``min_confidence`` or ``fill=False`` left without an
        estimate keep theirs; other pixels without one have 0. None with ``confidence=False``.
    settings
        The settings used; with ``compensate_blur=True``, those that suit the blur.
    timings
        Wall-clock seconds of the stages: ``"estimation"`` (of blur and noise, if requested),
        ``"description"`` (images to codes), ``"matching"`` (codes to disparities), ``"refinement"``
        (checks, filling, smoothing, confidences), ``"scales"`` (smaller copies, if they were
        matched, and planes), ``"temporal filter"`` (if there is one), ``"second"`` (the second
        matcher, and merging the maps).
    uncertainty
        float32 (H, W), pixels: half the width of the interval around the disparity that holds the
        true one with a probability of 90 %; NaN without an estimate. None with
        ``confidence=False``.
    blur
        The estimates of blur and noise, if requested.
    pair
        The left and the right image as given, each (H, W) or (H, W, C), to show next to the
        disparities. They are references that keep the images in memory, not copies, so later
        changes of the images show. None if unknown, as after a pickle.
    search
        The disparities searched, and whether they were given or found. None if unknown.
    alignment
        How the rows of the images correspond, and whether the right one was straightened, if this
        was requested and could be estimated.
    blur_compensation
        The versions in which pixels were compared, and the noise; None: the unchanged images.
    summary
        Shares of pixels that show whether to trust the match as a whole. None for a match of parts
        of a pair.
    findings
        Findings about the match as a whole, worst first; empty if all is well, and for a match of
        parts of a pair.
    temporal_support
        uint8 (H, W): the number of video frames that support each disparity, from 1 (only this one)
        to 8. None without a `phasestereo.TemporalFilter`.
    rectified
        The rectified pair that was matched, with ``self_rectify=True`` and images far from
        rectified: then `disparity` is x - x' of pixels that may lie on different rows. None: the
        images were matched unchanged.
    right
        The result for the right image, with ``right_map=True``: its pixel (x, y) corresponds to
        left pixel (x + disparity, y). Apart from its maps, it describes the match of the exchanged,
        mirrored pair. None: the right image was not matched.
    vertical
        Whether columns were matched, on request or by detection: left pixel (x, y) corresponds to
        right pixel (x, y - disparity).

    Examples
    --------
    >>> result = ps.match("left.png", "right.png")
    >>> reliable = np.where(result.trusted, result.disparity, np.nan)
    >>> occluded = (result.flags & ps.Flag.OCCLUDED) != 0
    """

    disparity: NDArray[np.float32]
    flags: NDArray[np.uint16]
    confidence: NDArray[np.float32] | None
    settings: Settings
    timings: Mapping[str, float]
    uncertainty: NDArray[np.float32] | None = None
    blur: BlurEstimate | None = None
    pair: tuple[NDArray[Any], NDArray[Any]] | None = None
    search: SearchRange | None = None
    alignment: Alignment | None = None
    blur_compensation: BlurCompensation | None = None
    summary: Summary | None = None
    findings: tuple[Finding, ...] = ()
    temporal_support: NDArray[np.uint8] | None = None
    rectified: Rectified | None = None
    right: Result | None = None
    vertical: bool = False

    _repr_html_: ClassVar[Callable[[Result], str]]
    """Jupyter and marimo show a result with it; the root of the package sets it."""

    @property
    def trusted(self) -> NDArray[np.bool_]:
        """Where the disparity is probably within 1 px, bool (H, W).

        True for confidences of at least 0.5. Without confidences, true for estimates without a
        flag, and false everywhere if the summary reports that most are wrong.
        """
        return self.kept("trusted")

    def kept(self, keep: Keep = "trusted") -> NDArray[np.bool_]:
        """Return the pixels to use: the choice between accuracy and density.

        Parameters
        ----------
        keep
            ``"trusted"``: `trusted`. ``"checked"``: fewer and more accurate pixels, trusted ones
            without a flag; none is filled in, inferred, from a coarser copy or from a second map.
            ``"all"``: every estimate.

        Returns
        -------
        ndarray
            bool (H, W). Estimates are finite with all three choices.

        Raises
        ------
        ValueError
            If the choice is unknown.

        Examples
        --------
        >>> sure = result.disparity[result.kept("checked")]
        """
        wrong = math.nan if self.summary is None else self.summary.wrong
        return _core.kept_pixels(keep, self.disparity, self.flags, self.confidence, wrong)

    def __reduce__(self) -> tuple[type[Result], tuple[Any, ...]]:
        """Return the constructor and arguments without the pair, which would dominate a pickle."""
        kept = {f.name: None if f.name == "pair" else getattr(self, f.name) for f in fields(self)}
        return type(self), tuple(kept.values())

    def __copy__(self) -> Result:
        """Return a copy with the same arrays, pair included: `copy.copy` does not pickle."""
        return replace(self)

    def __repr__(self) -> str:
        """Show the size, the wrong share, the maps and the time, not the arrays."""
        rows, cols = self.disparity.shape
        known = np.isfinite(self.disparity) if self.confidence is None else self.trusted
        share = f"{known.mean():.1%} {'estimated' if self.confidence is None else 'trusted'}"
        parts = f"Result {cols}x{rows}", self.verdict, share, f"{sum(self.timings.values()):.3f} s"
        return f"<{', '.join(part for part in parts if part)}>"

    @property
    def maps(self) -> dict[str, NDArray[Any]]:
        """All maps of this result, each (H, W), by the names in `MAPS`."""
        found = {name: getattr(self, name) for name in MAPS}
        return {name: values for name, values in found.items() if values is not None}

    @property
    def verdict(self) -> str:
        """The share of pixels that are probably wrong, in words; "" if unknown.

        For two identical images, or without confidences, the first warning about the match.
        """
        if self.summary is None:
            return ""
        share = str(self.summary)
        is_one_image = self.search is not None and self.search.identical
        grave = [one for one in untrusted(self.findings) if one.topic == "match"]
        return grave[0].sentence if grave and (is_one_image or not share) else share

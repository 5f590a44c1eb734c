"""Every knob of a match, and the presets: named sets of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from types import MappingProxyType
from typing import Any, Literal

from phasestereo import _core

_DEFAULTS = _core.preset("robust")


@dataclass(frozen=True, kw_only=True)
class Settings:
    """All settings of a match; the defaults are the ``"robust"`` preset.

    ``Settings.preset("paper")`` and ``Settings.preset("fast")`` are the others;
    `dataclasses.replace` changes some of their fields.

    Section and equation numbers are those of Pedone & Heikkilä, *Blur and Contrast Invariant Fast
    Stereo Matching*, ACIVS 2008.

    Parameters
    ----------
    cost
        What two pixels are compared by: ``"phase"``, the Hamming distance of their phase codes
        (unit: bits; eq. 7); ``"sad"``, the sum over the channels of absolute differences (unit:
        gray levels, of which the intensity range has 255; gray where either image is);
        ``"nsad"``, the same after every channel has been normalized by the mean and the standard
        deviation in the window around the pixel (unit: standard deviations). Default ``"phase"``.
    neighborhood
        Side L of the square neighborhood which a code describes, in pixels; odd, 3 to 63.
        Larger ones resist blur better and fatten the foreground more. Default 3.
    taper
        Window under the local Fourier transform: ``"uniform"`` as in the paper, ``"gaussian"``
        (standard deviation (L - 1) / 4) or ``"hann"``. Only the uniform window costs the same
        whatever L is. Default ``"uniform"``.
    frequencies
        Highest frequency indices (r, s) along x and y (eq. 3); each 0 to 4 and at most
        (L - 1) / 2, not both 0. Default (1, 1).
    power
        Power k of the spectrum (eq. 3): 1, or 2, which makes the codes blind to the sign flips
        of a symmetric blur beyond its first zero, and less discriminative. Default 1.
    bits
        Bits b of the phase, 1 to 4: it is quantized to 2^b levels (eq. 3). A pixel's code takes
        (r (2 s + 1) + s) 2^(b - 1) bits, at most 64. Default 2.
    noise_threshold
        Real and imaginary parts of the spectrum whose magnitude is up to so many standard
        deviations of what the noise of the image makes of them count as weak, 0 to 100: where
        there is little texture their signs are noise. A weak part differs by one from a clear one,
        and clear ones of opposite signs by two; so a pixel's code takes twice the bits. It needs
        ``bits=2`` and ``cost="phase"``, and the noise, which `match` estimates unless it is given.
        0: there is no such level. Default 0.5.
    sizes
        Sizes of neighborhoods that a code describes, 1 or 2. With 2 the bits of `neighborhood` are
        joined by those of one that is two pixels larger, of which only the components (0, 1) and
        (1, 0) count; these alone have the weak level. Small neighborhoods keep details, larger
        ones stand noise, compression and softness. It needs a `neighborhood` of 61 at most, and
        without a weak level takes (r (2 s + 1) + s + 2) 2^(b - 1) bits. Default 2.
    window
        Side of the square aggregation window, in pixels; odd, 1 to 63; it may be larger than the
        image. Default 5.
    shiftable
        Whether the best of five windows counts, which the pixel anchors at the center, top,
        bottom, left and right (section 2.3), or the centered one alone. Default False.
    precision
        How exactly aggregated costs are worked out: ``"full"``, exactly; ``"byte"``, to so many
        bits that each fits a byte, which is nearly twice as fast: from the sum of each column of
        the window the lowest n bits are dropped, the least n for which
        window * (window * ceiling >> n) <= 170, the ceiling being the largest cost of one pixel;
        one more where only so the largest sum and P2 together fit a byte, if that
        leaves a largest sum of at least 80. So totals fit one, too, unless penalties are large.
        Default ``"byte"``.
    optimizer
        How a row of costs becomes a row of disparities. Default ``"sgm"``.

        - ``"dp"``: one-pass dynamic programming along the row under the ordering constraint
          (section 2.3): from a pixel to the next the disparity stays, rises by one or drops to
          any smaller one.
        - ``"so"``: scanline optimization without the ordering constraint: the least mean of two
          paths along the row, from the left and from the right. Along a path the disparity stays,
          changes by one either way, for P1, or jumps to any other, for P2 (Hirschmüller, *Stereo
          Processing by Semiglobal Matching and Mutual Information*, PAMI 2008).
        - ``"wta"``: winner-takes-all, each pixel by itself.
        - ``"sgm"``: semi-global matching, the least mean of four such paths: from the left, the
          right, above and below. Those from above and below begin 16 rows outside each band of 64
          rows, so that bands depend on nothing else: memory does not grow with the height, and
          parts of a pair are those of the whole.
    p1
        P1, what a change of disparity by one costs along a path, in units of the cost, as averaged
        over the window; 0 to 65535 (OpenCV's ``P1``). With ``"dp"``: what a rise by one costs.
        ``"wta"`` ignores it. Default 6.
    p2
        P2, what any other change of disparity costs, at least P1; 0 to 65535 (OpenCV's ``P2``).
        With ``"dp"``: what a drop costs, by whatever. ``"wta"`` ignores it. Default 24.
    adaptive_p2
        With ``"so"`` and ``"sgm"``: where the gray value of the left image jumps from one pixel of
        a path to the next by more than so many times the mean difference of neighbors, P2 is
        halved, by more than thrice that, a third of it, but at least P1; 0 to 1000, 0: nowhere.
        Default 1.
    compensate_blur
        Whether the relative blur of the two images is estimated (`phasestereo.estimate_blur`) and
        the sharper one is given it, area by area, before they are compared; for ``cost="phase"``.
        What is left of a blur is described by larger neighborhoods: where any is found,
        `neighborhood` and `window` are two pixels larger than said (`neighborhood` four, where all
        of it is Gaussian, of 2.25 pixels or more), 61 and 63 at most; with ``sizes=2`` both
        neighborhoods grow. Default True.
    align_rows
        Whether it is estimated how the rows of the images correspond: a smooth field of vertical
        offsets (shift, turn, focal length, keystone, distortion). Where it is significant, the
        right image is straightened by it, that is resampled along its columns; where it is slight,
        only if some bands are matched better so. Default True.
    despike
        Whether it is found out if the images have impulses (hot, dead and stuck pixels, salt and
        pepper), and these take the median of their eight neighbors before all else; for
        ``cost="phase"``. An image has some if more than 4e-5 of its pixels lie beyond the range of
        their neighbors (without the largest and the smallest) by more than three times that range
        and 40 gray levels of 256; then those are repaired that do by more than it and 20. Black to
        white is 8 bits, as many of 16 as the values take, or the range of floats. Default True.
    denoise
        Whether the noise of the images, and what compression in blocks (JPEG, video) has lost, are
        estimated and smoothed away before they are described, edges kept; for ``cost="phase"``. The
        weak level stays that of the noise as it was. Default True.
    intensity_range
        Intensities (black, white) of the images, which set the unit of ``"sad"`` and ``"nsad"``;
        values beyond one range below black or above white are clamped. None: 0 to 255 for values
        of 8 bits, of whatever type; else the range in which the pixels of both images lie, but for
        0.1 % at either end. Phase codes do not depend on it. Default None.
    subpixel
        Whether disparities lie between whole pixels: at the tip of a V through the costs about the
        chosen one, corrected for what a V gets wrong; then smoothed over 7 x 7 pixels of the same
        surface. Default True.
    lr_check
        Left-right check: a pixel is flagged when the right pixel that was chosen for it fits
        another left pixel better whose disparity differs by more than so many pixels, 0 to 16384
        (OpenCV's ``disp12MaxDiff``). None: no check. Default 1.
    uniqueness
        A pixel is flagged whose disparity costs not at least so many percent less than the best one
        elsewhere, that is more than one away: 0 to 100, 0: none is (OpenCV's ``uniquenessRatio``).
        Default 0.
    speckle_size
        Regions of up to so many pixels that stand out from all around are flagged; 0: none is
        (OpenCV's ``speckleWindowSize``). Default 100.
    speckle_range
        Neighboring pixels whose disparities differ by no more, in pixels, are in one region; 0 to
        16384 (OpenCV's ``speckleRange``). Default 1.
    synthesis
        Whether, where one image alone is blurred, the disparities near jumps are taken from the map
        at hand, or it eroded or dilated by 4 pixels, by which of them the blurred image can best be
        made again from the sharp one (analysis by synthesis). Default True.
    guided_median
        Whether edges in depth are drawn to those of the left image: near a jump of the disparities
        a pixel takes the median of those of similar gray value. Default True.
    median
        Side of the square over which disparities give way to their median, 3; 0: none. Default 3.
    fill
        Whether pixels that the left-right check, ``uniqueness`` or the removal of speckles flags,
        and with any of these also those whose match lies outside the right image, take the
        disparity of the background beside them (True) or become NaN (False). Without such checks
        nothing is filled: with True all estimates stay, flagged. Default True.
    confidence
        Whether confidences are worked out. If not, `Result.confidence` is None. Default True.
    min_confidence
        Estimates of less confidence, filled ones too, become NaN and are flagged; 0 to 1: 0.9
        leaves those of which at most one in ten is expected to be off by more than 1 px.
        Default 0.
    scales
        Whether copies of half the size, a quarter and so on decide where they are more likely to be
        right than the pair as it is, as on plain surfaces in large images, and flat areas become
        planes where these are (flags ``COARSE`` and ``INFERRED``). From 384 disparities on a copy
        also tells where each part of the image is searched. For ``cost="phase"``; it needs
        confidences, which take their time with ``confidence=False``, too. Parts of a pair are
        matched without. Default True.

    Raises
    ------
    TypeError
        If a field has the wrong type.
    ValueError
        If a field, or the length of the code, is out of range.
    """

    cost: Literal["phase", "sad", "nsad"] = _DEFAULTS["cost"]
    neighborhood: int = _DEFAULTS["neighborhood"]
    taper: Literal["uniform", "gaussian", "hann"] = _DEFAULTS["taper"]
    frequencies: tuple[int, int] = _DEFAULTS["frequencies"]
    power: int = _DEFAULTS["power"]
    bits: int = _DEFAULTS["bits"]
    noise_threshold: float = _DEFAULTS["noise_threshold"]
    sizes: int = _DEFAULTS["sizes"]
    window: int = _DEFAULTS["window"]
    shiftable: bool = _DEFAULTS["shiftable"]
    precision: Literal["full", "byte"] = _DEFAULTS["precision"]
    optimizer: Literal["dp", "so", "wta", "sgm"] = _DEFAULTS["optimizer"]
    p1: float = _DEFAULTS["p1"]
    p2: float = _DEFAULTS["p2"]
    adaptive_p2: float = _DEFAULTS["adaptive_p2"]
    compensate_blur: bool = _DEFAULTS["compensate_blur"]
    align_rows: bool = _DEFAULTS["align_rows"]
    despike: bool = _DEFAULTS["despike"]
    denoise: bool = _DEFAULTS["denoise"]
    intensity_range: tuple[float, float] | None = _DEFAULTS["intensity_range"]
    subpixel: bool = _DEFAULTS["subpixel"]
    lr_check: int | None = _DEFAULTS["lr_check"]
    uniqueness: int = _DEFAULTS["uniqueness"]
    speckle_size: int = _DEFAULTS["speckle_size"]
    speckle_range: float = _DEFAULTS["speckle_range"]
    synthesis: bool = _DEFAULTS["synthesis"]
    guided_median: bool = _DEFAULTS["guided_median"]
    median: int = _DEFAULTS["median"]
    fill: bool = _DEFAULTS["fill"]
    confidence: bool = _DEFAULTS["confidence"]
    min_confidence: float = _DEFAULTS["min_confidence"]
    scales: bool = _DEFAULTS["scales"]

    def __post_init__(self) -> None:
        """Check every field at once, in the core, which owns the ranges."""
        _core.check_settings(self)

    @staticmethod
    def preset(name: str) -> Settings:
        """Return the settings of a preset, one of `PRESETS`.

        Raises
        ------
        TypeError
            If the name is no string.
        ValueError
            If there is no such preset.
        """
        return Settings(**_core.preset(name))


PRESETS: Mapping[str, Settings] = MappingProxyType(
    {name: Settings.preset(name) for name in _core.PRESETS}
)
"""The named settings. ``"robust"``: finds by itself which image is blurred and how, evens that out,
repairs impulses, smooths noise and compression away, describes two sizes of neighborhoods, keeps
noise out of the codes, searches along four paths, checks, fills and smooths. ``"paper"``: the
method of the paper to the letter. ``"fast"``, for frame rates: short codes, costs in bytes, two
paths along the row, a median, no confidence."""

PRESET = "robust"
"""Name of the settings to start from where nothing else is said."""


def resolve(
    preset: str | None, settings: Settings | None, overrides: Mapping[str, Any]
) -> Settings:
    """Return the settings that a call means: a preset or given settings, then overrides by name.

    Raises
    ------
    TypeError
        If an override names no field, an argument has the wrong type, or both a preset and
        settings are given.
    ValueError
        If there is no such preset, or a value is out of range.
    """
    if settings is not None and not isinstance(settings, Settings):
        raise TypeError(f"settings: got {type(settings).__name__}; accepts Settings or None")
    if preset is not None and settings is not None:
        raise TypeError(
            f"preset: got {preset!r} beside settings; accepts one of the two: preset or settings"
        )

    names = [field.name for field in fields(Settings)]
    unknown = [name for name in overrides if name not in names]
    if unknown:
        raise TypeError(f"{unknown[0]}: no such setting; accepts {', '.join(names)}")

    if settings is None:
        settings = PRESETS[PRESET] if preset is None else Settings.preset(preset)
    return replace(settings, **overrides) if overrides else settings

"""Every knob of a match, and the presets: named sets of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from types import MappingProxyType
from typing import Any, Literal, TypedDict, cast

from phasestereo import _core
from phasestereo._numbers import check_type


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
        Matching cost of two pixels. Default ``"phase"``.

        - ``"phase"``: The Hamming distance of their phase codes (unit: bits; eq. 7).
        - ``"sad"``: The absolute difference of their gray levels, 255 of which span the intensity
          range; color becomes gray first (unit: gray levels).
        - ``"nsad"``: The same, after gray levels are normalized by the mean and the standard
          deviation of the window around the pixel (unit: standard deviations).
        - ``"zncc"``: 1 minus the zero-mean normalized cross-correlation of the gray levels of their
          neighborhoods (unit: 1; from 0 for equal neighborhoods to 2 for inverted ones).
    neighborhood
        Side L of the square neighborhood that a phase code describes or ``"zncc"`` correlates,
        pixels. Larger ones resist blur better and fatten the foreground more. An odd integer from 3
        to 63. Default ``3`` (paper ``7``, fast ``9``).
    taper
        The window under the local Fourier transform. Default ``"uniform"``.

        - ``"uniform"``: Every pixel of the neighborhood has the same weight, as in the paper. Only
          this one costs the same for every L.
        - ``"gaussian"``: A Gaussian of standard deviation (L - 1) / 4.
        - ``"hann"``: A raised cosine that would reach zero one pixel outside the neighborhood.
    frequencies
        Highest frequency indices (r, s) of the transform along x and y in a code (eq. 3). Each is
        at most (L - 1) / 2. Two integers from 0 to 4, not both 0. Default ``(1, 1)`` (paper ``(2,
        1)``).
    power
        Power k of the spectrum (eq. 3). 2 makes the codes blind to the sign flips of a symmetric
        blur beyond its first zero, but less discriminative. An integer from 1 to 2. Default ``1``.
    bits
        Bits b of each phase: it is quantized to 2^b levels (eq. 3). A pixel's code takes (r (2 s +
        1) + s) 2^(b - 1) bits, at most 64. An integer from 1 to 4. Default ``2``.
    noise_threshold
        Noise threshold: a part of the spectrum must exceed it to count as clear. Real and imaginary
        parts of up to this many standard deviations of their image noise count as weak: where there
        is little texture, their signs are noise. A weak part differs by one from a clear one, and
        clear ones of opposite signs by two, so a pixel's code takes twice the bits. It needs 2
        ``bits``, phase codes, and the noise, which a match estimates unless it is given. 0: no weak
        level. A number from 0 to 100. Default ``0.5`` (paper ``0.0``, fast ``0.0``).
    sizes
        Number of neighborhood sizes that a code describes. With 2, a neighborhood two pixels larger
        adds its bits to those of ``neighborhood``. Of the larger one only the components (0, 1) and
        (1, 0) count, and only these have the weak level. Small neighborhoods keep details; larger
        ones resist noise, compression and softness. It needs a ``neighborhood`` of 61 at most, and
        without a weak level takes (r (2 s + 1) + s + 2) 2^(b - 1) bits. An integer from 1 to 2.
        Default ``2`` (paper ``1``, fast ``1``).
    window
        Side of the square aggregation window, pixels. It may be larger than the image (OpenCV's
        ``blockSize``). An odd integer from 1 to 63. Default ``5`` (paper ``9``, fast ``9``).
    shiftable
        Whether the best of five windows counts, or only the centered one. The pixel is at their
        center, top, bottom, left and right (section 2.3). Default ``False`` (paper ``True``).
    precision
        Precision of aggregated costs. Default ``"byte"`` (paper ``"full"``).

        - ``"full"``: Exact.
        - ``"byte"``: Rounded to fit a byte each, which is nearly twice as fast. The sum of each
          column of the window drops its lowest n bits: the smallest n for which window * (window *
          ceiling >> n) <= 170, where the ceiling is the largest cost of one pixel. It drops one
          more if the largest sum and P2 together fit a byte only then, and the largest sum stays at
          least 80. Totals then fit a byte too, unless penalties are large.
    optimizer
        Optimizer: how costs become disparities. Default ``"sgm"`` (paper ``"dp"``, fast ``"so"``).

        - ``"dp"``: One-pass dynamic programming along the row under the ordering constraint
          (section 2.3): from one pixel to the next the disparity stays, rises by one, or drops to
          any smaller one.
        - ``"so"``: Scanline optimization without the ordering constraint: the minimum of the mean
          of two paths along the row, from the left and from the right. Along a path the disparity
          stays, changes by one either way at cost P1, or jumps to any other at cost P2
          (Hirschmüller, *Stereo Processing by Semiglobal Matching and Mutual Information*, PAMI
          2008).
        - ``"wta"``: Winner-takes-all: each pixel by itself.
        - ``"sgm"``: Semi-global matching: the minimum of the mean of four such paths, from the
          left, the right, above and below. Paths from above and below begin 16 rows outside each
          band of 64 rows, so each band depends on nothing else: memory does not grow with the
          height, and a part of a pair matches as it does in the whole.
    p1
        P1: the cost of a change of disparity by one along a path. The unit is that of the cost,
        averaged over the window (OpenCV's ``P1``). With ``"dp"``, the cost of a rise by one.
        ``"wta"`` ignores it. A number from 0 to 65535. Default ``6.0`` (paper ``2.0``, fast
        ``3.0``).
    p2
        P2: the cost of any other change of disparity, at least P1. The unit is that of ``p1``
        (OpenCV's ``P2``). With ``precision="byte"``, it also decides how coarsely costs are
        rounded. With ``"dp"``, the cost of a drop of any depth. ``"wta"`` ignores it. A number from
        0 to 65535. Default ``24.0`` (paper ``2.0``, fast ``16.0``).
    adaptive_p2
        Adaptive P2: how large a jump of the gray value lowers P2. With ``"so"`` and ``"sgm"``:
        where the gray value of the left image changes from one pixel of a path to the next by more
        than this multiple of the mean difference of neighbors, P2 is halved; by more than three
        times that, it is divided by three. It stays at least P1. 0: never lowered. A number from 0
        to 1000. Default ``1.0`` (paper ``0.0``, fast ``2.0``).
    compensate_blur
        Whether to estimate the relative blur of the images, and blur the sharper one to match. The
        images are blurred area by area before they are compared; it needs phase codes. Slight blur
        is left, except in noise. Larger neighborhoods cope with the rest of stronger blur: in
        noise, or if it is wide in all directions (a disk of 3.2 pixels), ``neighborhood`` and
        ``window`` are two pixels larger than set (``neighborhood`` four if the blur is all
        Gaussian, of 2.25 pixels or more), up to 61 and 63. With 2 ``sizes``, both neighborhoods
        grow. Default ``True`` (paper ``False``, fast ``False``).
    align_rows
        Whether to estimate vertical offsets between the rows of the images, and straighten the
        right image. The estimate is a smooth field of vertical offsets (shift, turn, focal length,
        keystone, distortion), and a spline of the row if rows sway. If the offsets are significant,
        the right image is straightened: resampled along its columns. If they are slight, it is only
        if some bands match better that way. If the fields of an interlaced image are shifted, only
        its even rows are matched, and the raw mosaic of a color sensor is smoothed, except in parts
        of a pair. Default ``True`` (paper ``False``, fast ``False``).
    self_rectify
        Whether to rectify a pair whose rows are too far off to straighten, from its images, before
        it is matched. It is tried if small copies hardly match: turned, tilted, zoomed and toed-in
        cameras, lenses that distort. It is kept if they match better, and a finding reports it;
        disparities are then x - x' of the original images. Default ``True`` (paper ``False``, fast
        ``False``).
    despike
        Whether to detect and repair impulses (hot, dead and stuck pixels, salt and pepper). Before
        anything else, they take the median of their eight neighbors; it needs phase codes. An image
        has impulses if more than 4e-5 of its pixels lie beyond the range of their neighbors
        (without the largest and the smallest) by more than three times that range plus 40 gray
        levels of 256; then pixels beyond it by more than that range plus 20 levels are repaired.
        Black to white is 8 bits, the bits that 16-bit values use, or the range of floats. Default
        ``True`` (paper ``False``, fast ``False``).
    denoise
        Whether to smooth away noise and compression artifacts before the images are described. The
        noise of the images and the loss from block compression (JPEG, video) are estimated; edges
        are kept. It needs phase codes. The weak level stays that of the original noise. Default
        ``True`` (paper ``False``, fast ``False``).
    intensity_range
        Intensities (black, white) of the images, which set the unit of gray levels for all costs
        but ``"phase"``. Values more than one range below black or above white are clamped. None: 0
        to 255 for 8-bit values of any type; else the range of the pixels of both images, without
        0.1 % at either end. Phase codes do not depend on it. Two numbers of magnitude up to 1e300,
        the first smaller, or None. Default ``None``.
    subpixel
        Whether disparities lie between whole pixels. They are then at the tip of a V through the
        costs around the chosen one, corrected for the error of a V, and smoothed over 7 x 7 pixels
        of the same surface. Default ``True`` (paper ``False``, fast ``False``).
    lr_check
        Left-right check: most pixels by which the disparities of two left pixels with one match may
        differ. A pixel is flagged if the right pixel chosen for it fits another left pixel better
        whose disparity differs by more (OpenCV's ``disp12MaxDiff``). None: no check. An integer
        from 0 to 16384, or None. Default ``1`` (paper ``None``, fast ``None``).
    uniqueness
        Percent of the second-best cost by which that of the chosen disparity must be lower. A pixel
        is flagged unless its disparity costs less, by at least this percentage, than the best of
        those more than one pixel away (OpenCV's ``uniquenessRatio``). 0: no check. An integer from
        0 to 100. Default ``0``.
    speckle_size
        Largest region that counts as a speckle, pixels. Regions of up to this size that differ from
        everything around them are flagged (OpenCV's ``speckleWindowSize``). 0: no check. Default
        ``100`` (paper ``0``, fast ``0``).
    speckle_range
        Most pixels by which the disparities of neighbors in one region differ (OpenCV's
        ``speckleRange``). A number from 0 to 16384. Default ``1.0``.
    synthesis
        Whether to choose the disparities near jumps that best explain the blurred image (analysis
        by synthesis). If only one image is blurred, they come from the current map, or from it
        eroded or dilated by 4 pixels, whichever best reproduces the blurred image from the sharp
        one. Default ``True`` (paper ``False``, fast ``False``).
    guided_median
        Whether to align depth edges with those of the left image (guided median). Near a jump of
        the disparities, a pixel takes the median of those of similar gray value; OpenCV's
        ``ximgproc.createDisparityWLSFilter`` is similar. Default ``True`` (paper ``False``, fast
        ``False``).
    median
        Side of the square median filter over disparities. 0: no filter. 0 or 3. Default ``3``
        (paper ``0``).
    fill
        Whether pixels that fail a check are filled from the background beside them, or left without
        an estimate. These are the pixels that the left-right check, ``uniqueness`` or the speckle
        filter flags, and with any of these also those whose match lies outside the right image. If
        not filled, they become NaN. Without such checks nothing is filled: all estimates stay,
        flagged. Default ``True``.
    confidence
        Whether to compute confidences. Default ``True`` (fast ``False``).
    min_confidence
        Lowest confidence of an estimate that stays in the map. Estimates of lower confidence,
        including filled ones, become NaN and are flagged: with 0.9, at most one in ten of the
        others is expected to be off by more than 1 pixel. A number from 0 to 1. Default ``0.0``.
    scales
        Whether smaller copies of the pair, and planes, decide where they are more likely to be
        right. Copies of half the size, a quarter and so on may be right on plain surfaces in large
        images; flat areas may become planes (flags ``COARSE`` and ``INFERRED``). With 384 or more
        disparities, a copy also sets where each part of the image is searched. It needs phase codes
        and confidences, which are computed for it even without ``confidence``. Parts of a pair are
        matched without it. Default ``True`` (paper ``False``, fast ``False``).
    budget
        Seconds after which a match skips optional parts. The search for cameras, smaller copies and
        planes are skipped if they would end later, judging by the time taken so far, and a finding
        reports it. The match itself is never cut short. Which parts fit depends on the machine and
        its load. None: no limit. A number from 0 to 86400, or None. Default ``None``.

    Raises
    ------
    TypeError
        If a field has the wrong type.
    ValueError
        If a field, or the length of the code, is out of range.

    Examples
    --------
    >>> from dataclasses import replace
    >>> settings = ps.Settings(window=7, fill=False)
    >>> ps.match(left, right, settings=settings)
    >>> replace(ps.PRESETS["fast"], median=0)
    """

    # These fields, and the parameters above, are written from the table in Rust
    # (rust/match/src/settings/table.rs) by ``make settings``.
    cost: Literal["phase", "sad", "nsad", "zncc"] = "phase"
    neighborhood: int = 3
    taper: Literal["uniform", "gaussian", "hann"] = "uniform"
    frequencies: tuple[int, int] = (1, 1)
    power: int = 1
    bits: int = 2
    noise_threshold: float = 0.5
    sizes: int = 2
    window: int = 5
    shiftable: bool = False
    precision: Literal["full", "byte"] = "byte"
    optimizer: Literal["dp", "so", "wta", "sgm"] = "sgm"
    p1: float = 6.0
    p2: float = 24.0
    adaptive_p2: float = 1.0
    compensate_blur: bool = True
    align_rows: bool = True
    self_rectify: bool = True
    despike: bool = True
    denoise: bool = True
    intensity_range: tuple[float, float] | None = None
    subpixel: bool = True
    lr_check: int | None = 1
    uniqueness: int = 0
    speckle_size: int = 100
    speckle_range: float = 1.0
    synthesis: bool = True
    guided_median: bool = True
    median: int = 3
    fill: bool = True
    confidence: bool = True
    min_confidence: float = 0.0
    scales: bool = True
    budget: float | None = None

    def __post_init__(self) -> None:
        """Check every field at once, in the core, which owns the ranges."""
        _core.check_settings(self)

    @staticmethod
    def preset(name: str) -> Settings:
        """Return the settings of a preset, one of `PRESETS`.

        Raises
        ------
        TypeError
            If the name is not a string.
        ValueError
            If there is no such preset.
        """
        return Settings(**_core.preset(name))


class SettingsOverrides(TypedDict, total=False):
    """Fields of `Settings` by name, as `match` and others take them beside a preset."""

    # These lines, too, are those of ``make settings``:
    cost: Literal["phase", "sad", "nsad", "zncc"]
    neighborhood: int
    taper: Literal["uniform", "gaussian", "hann"]
    frequencies: tuple[int, int]
    power: int
    bits: int
    noise_threshold: float
    sizes: int
    window: int
    shiftable: bool
    precision: Literal["full", "byte"]
    optimizer: Literal["dp", "so", "wta", "sgm"]
    p1: float
    p2: float
    adaptive_p2: float
    compensate_blur: bool
    align_rows: bool
    self_rectify: bool
    despike: bool
    denoise: bool
    intensity_range: tuple[float, float] | None
    subpixel: bool
    lr_check: int | None
    uniqueness: int
    speckle_size: int
    speckle_range: float
    synthesis: bool
    guided_median: bool
    median: int
    fill: bool
    confidence: bool
    min_confidence: float
    scales: bool
    budget: float | None


PresetName = Literal["robust", "paper", "fast"]
"""Name of a preset."""

PRESETS: Mapping[str, Settings] = MappingProxyType(
    {name: Settings.preset(name) for name in _core.PRESETS}
)
"""The named settings. ``"robust"``: finds by itself which image is blurred and how, evens that out,
repairs impulses, smooths noise and compression away, describes two sizes of neighborhoods, keeps
noise out of the codes, searches along four paths, checks, fills and smooths. ``"paper"``: the
method of the paper to the letter. ``"fast"``, for frame rates: short codes, costs in bytes, two
paths along the row, a median, no confidence."""

PRESET: PresetName = "robust"
"""Name of the default preset."""


_ARGUMENTS = [
    "num_disparities",
    "min_disparity",
    "preset",
    "settings",
    "threads",
    "device",
    "left_mask",
    "right_mask",
    "progress",
    "known",
    "vertical",
]
"""What a match takes beside settings, for those who mistype it."""


def resolve(
    preset: str | None, settings: Settings | None, overrides: Mapping[str, object]
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
    check_type("settings", settings, (Settings, type(None)), "Settings or None")
    if preset is not None and settings is not None:
        raise TypeError(
            f"preset: got {preset!r} beside settings; accepts one of the two: preset or settings"
        )

    names = [field.name for field in fields(Settings)]
    unknown = [name for name in overrides if name not in names]
    if unknown:
        likely = get_close_matches(unknown[0], {*names, *_ARGUMENTS}, 1)
        meant = f" (did you mean {likely[0]}?)" if likely else ""
        if unknown[0] in _ARGUMENTS:
            meant = " (an argument of match)"
        raise TypeError(f"{unknown[0]}: no such setting{meant}; accepts {', '.join(names)}")

    if settings is None:
        settings = PRESETS[PRESET] if preset is None else Settings.preset(preset)
    return replace(settings, **cast("dict[str, Any]", overrides)) if overrides else settings

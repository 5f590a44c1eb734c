"""Scores of a disparity map, as benchmarks define them, and the flicker of a video's."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from phasestereo._images import as_numbers
from phasestereo._numbers import as_integer, as_number
from phasestereo.metrics.pixels import Floats, Mask, Values, scored_values

_D1_PIXELS = 3.0
_D1_SHARE = 0.05
_LEAST_FRAMES = 2

_LABELS = {
    "bad_0_5": "bad-0.5",
    "bad_1": "bad-1.0",
    "bad_2": "bad-2.0",
    "bad_4": "bad-4.0",
    "a50": "A50",
    "a90": "A90",
    "a95": "A95",
    "a99": "A99",
    "d1": "D1",
    "epe": "EPE",
}


class Scored(Protocol):
    """Anything with a truth and masks, such as the pairs of a dataset."""

    @property
    def truth(self) -> Floats | None:
        """Disparities in px, float (H, W), NaN = unknown; None without a truth."""

    @property
    def masks(self) -> Mapping[str, Mask]:
        """The pixels to score, bool (H, W), by region: "nonocc", "all", "disc"."""


@dataclass(frozen=True, slots=True)
class MiddleburyV2:
    """Bad pixels by region, in percent of the region's scored pixels; None without that mask.

    Attributes
    ----------
    nonocc
        Pixels visible in both images.
    all
        Those and the half-occluded ones.
    disc
        Visible pixels near a depth discontinuity.
    threshold
        The largest error in pixels that is not bad.
    """

    nonocc: float | None
    all: float | None
    disc: float | None
    threshold: float


@dataclass(frozen=True, slots=True)
class Score:
    """All scores of one estimate: Middlebury version 3, KITTI's D1, end-point error.

    Attributes
    ----------
    pixels
        Number of scored pixels.
    bad_0_5, bad_1, bad_2, bad_4
        Percent of the scored pixels that are off by more than 0.5, 1, 2, 4 px or missing.
    invalid
        Percent of the scored pixels whose estimate is missing: part of each of the above.
    avgerr, rms
        Mean and root mean square of the absolute error, px, over the pixels with an estimate.
    a50, a90, a95, a99
        Quantiles of the absolute error, px, over the pixels with an estimate.
    d1
        Percent of the scored pixels off by more than 3 px and 5 % of the truth, or missing.
    epe
        Mean absolute error in px over the pixels with an estimate; estimates are never clipped
        here.

    Notes
    -----
    Where every estimate is missing, the errors over pixels with an estimate are NaN.
    """

    pixels: int
    bad_0_5: float
    bad_1: float
    bad_2: float
    bad_4: float
    invalid: float
    avgerr: float
    rms: float
    a50: float
    a90: float
    a95: float
    a99: float
    d1: float
    epe: float

    def as_dict(self) -> dict[str, float]:
        """Return the numbers by their printed names: "bad-0.5", "A90", "EPE" ..."""
        return {_LABELS.get(name, name): value for name, value in asdict(self).items()}


def unit_of(metric: str) -> str:
    """Return the unit of a metric by its name in `Score.as_dict`: % or px."""
    return "%" if metric.startswith(("bad", "invalid", "D1")) else "px"


@dataclass(frozen=True, slots=True)
class SubPixel:
    """The precision of right estimates, and their locking to whole pixels.

    Attributes
    ----------
    inliers
        Percent of the scored pixels whose error is at most `inlier`; the other numbers use only
        these.
    rms
        Root mean square of their errors, px.
    bias
        Mean of estimate - truth, px.
    locking
        Largest difference between the histograms of the fractional parts of estimates and truth, in
        percent of a uniform bin.
    inlier
        The largest error in pixels of an inlier.

    Notes
    -----
    Without inliers, the others are NaN.
    """

    inliers: float
    rms: float
    bias: float
    locking: float
    inlier: float


def bad_pixels(
    estimate: Floats, truth: Floats, threshold: float, mask: Mask | None = None
) -> float:
    """Return the percentage of scored pixels with |estimate - truth| > threshold (strictly).

    Parameters
    ----------
    estimate, truth
        Disparities in px, float (H, W); NaN or infinite = missing, unknown.
    threshold
        The largest error that is not bad, px, >= 0.
    mask
        Pixels to score, bool (H, W); without one, all with known truth.

    Returns
    -------
    float
        0 to 100; a missing estimate counts as bad.

    Raises
    ------
    TypeError
        If the disparities are not floats, the mask is not bool or the threshold not a number.
    ValueError
        If shapes differ, the threshold is negative or not finite, or nothing is left to score.

    References
    ----------
    Scharstein & Szeliski, "A taxonomy and evaluation of dense two-frame stereo correspondence
    algorithms", IJCV 47, 2002, section 5.1.
    """
    return _percent_bad(
        _errors(*scored_values(estimate, truth, mask)), as_number("threshold", threshold, least=0)
    )


def middlebury_v2(
    estimate: Floats,
    pair: Scored | tuple[Floats, Mapping[str, Mask]],
    *,
    threshold: float = 1.0,
) -> MiddleburyV2:
    """Return the bad pixels in each region of the Middlebury evaluation, version 2.

    Parameters
    ----------
    estimate
        Disparities in px, float (H, W); NaN = missing.
    pair
        A pair with truth and masks, or just `(truth, masks)`, with masks of bool (H, W) by region,
        "nonocc", "all" and "disc".
    threshold
        The largest error that is not bad, px, >= 0; the evaluation's own is 1.

    Raises
    ------
    TypeError, ValueError
        As `bad_pixels`; ValueError also if there is no truth, or none of the three masks.

    References
    ----------
    Scharstein & Szeliski, IJCV 47, 2002, and vision.middlebury.edu/stereo/eval.
    """
    truth, masks = pair if isinstance(pair, tuple) else (pair.truth, pair.masks)
    if truth is None:
        raise ValueError("pair has no truth: there is nothing to score against")
    regions = {region: masks.get(region) for region in ("nonocc", "all", "disc")}
    if all(mask is None for mask in regions.values()):
        raise ValueError(f"masks must hold nonocc, all or disc, got {sorted(masks) or 'none'}")

    percent = {
        region: None if mask is None else bad_pixels(estimate, truth, threshold, mask)
        for region, mask in regions.items()
    }
    return MiddleburyV2(**percent, threshold=as_number("threshold", threshold, least=0))


def end_point_error(estimate: Floats, truth: Floats, mask: Mask | None = None) -> float:
    """Return the mean of |estimate - truth| in px over the scored pixels that have an estimate.

    NaN if every estimate is missing. Check the density, too: this number alone rewards estimating
    only easy pixels.

    Parameters
    ----------
    estimate, truth, mask
        As for `bad_pixels`.

    Raises
    ------
    TypeError, ValueError
        As `bad_pixels`.
    """
    return _mean(_present(_errors(*scored_values(estimate, truth, mask))))


def score(
    estimate: Floats,
    truth: Floats,
    *,
    mask: Mask | None = None,
    num_disparities: int | None = None,
) -> Score:
    """Return all numbers at once: those of Middlebury's version 3, KITTI's D1, and the EPE.

    As in Middlebury's official program, pixels of unknown truth are skipped, and a missing estimate
    is left out of avgerr, rms and the quantiles. Unlike its tables of sparse results, the bad-pixel
    rates count a missing estimate as bad (the program's "totalbad"), so that leaving pixels out
    never pays; `invalid` is their share. KITTI's kit fills holes before it counts; here a missing
    estimate is an outlier.

    Parameters
    ----------
    estimate, truth, mask
        As for `bad_pixels`.
    num_disparities
        Clip the estimates to [0, num_disparities] first, as that program does (by `ndisp` of
        calib.txt), for all numbers but D1 and EPE. None: no clipping.

    Raises
    ------
    TypeError, ValueError
        As `bad_pixels`; also if `num_disparities` is not a positive integer.

    Notes
    -----
    The quantiles interpolate linearly between the sorted errors.

    References
    ----------
    Scharstein et al., "High-resolution stereo datasets with subpixel-accurate ground truth",
    GCPR 2014, section 6, and the program `evaldisp` of the MiddEval3 kit. Menze & Geiger, "Object
    scene flow for autonomous vehicles", CVPR 2015, section 4.
    """
    values, wanted = scored_values(estimate, truth, mask)

    errors = _errors(values, wanted)
    clipped = errors
    if num_disparities is not None:
        limit = as_integer("num_disparities", num_disparities, least=1)
        clipped = _errors(np.clip(values, 0, limit), wanted)

    present = _present(clipped)
    quantiles = np.quantile(present, (0.5, 0.9, 0.95, 0.99)) if present.size else [math.nan] * 4
    a50, a90, a95, a99 = (float(value) for value in quantiles)
    excess = errors - np.maximum(_D1_PIXELS, _D1_SHARE * np.abs(wanted))

    return Score(
        pixels=errors.size,
        bad_0_5=_percent_bad(clipped, 0.5),
        bad_1=_percent_bad(clipped, 1.0),
        bad_2=_percent_bad(clipped, 2.0),
        bad_4=_percent_bad(clipped, 4.0),
        invalid=100.0 * (errors.size - present.size) / errors.size,
        avgerr=_mean(present),
        rms=math.sqrt(_mean(present**2)),
        a50=a50,
        a90=a90,
        a95=a95,
        a99=a99,
        d1=_percent_bad(excess, 0.0),
        epe=_mean(_present(errors)),
    )


def subpixel(
    estimate: Floats,
    truth: Floats,
    mask: Mask | None = None,
    *,
    inlier: float = 1.0,
    bins: int = 10,
) -> SubPixel:
    """Return the subpixel error of correct estimates, and their bias to whole pixels.

    Parameters
    ----------
    estimate, truth, mask
        As for `bad_pixels`. The truth should have fractions of a pixel, spread evenly: with a truth
        rounded to steps, locking mostly measures the steps.
    inlier
        The largest error of a right estimate, px, >= 0.
    bins
        Number of equal bins of the fractional parts, from 2; the first one starts at whole pixels.

    Returns
    -------
    SubPixel

    Raises
    ------
    TypeError, ValueError
        As `bad_pixels`; also if `bins` is not an integer, or less than 2.

    Notes
    -----
    Chance alone causes some locking: about 200 sqrt(bins / inliers) percent, a percent or two in an
    image of usual size.

    References
    ----------
    Shimizu & Okutomi, "Precise sub-pixel estimation on area-based matching", ICCV 2001.
    """
    limit = as_number("inlier", inlier, least=0)
    count = as_integer("bins", bins, least=2)

    values, wanted = scored_values(estimate, truth, mask)
    errors = values - wanted
    right = np.abs(errors) <= limit  # false for the NaN of a missing estimate
    errors, values, wanted = errors[right], values[right], wanted[right]

    return SubPixel(
        inliers=100.0 * errors.size / right.size,
        rms=math.sqrt(_mean(errors**2)),
        bias=_mean(errors),
        locking=_locking(values, wanted, count),
        inlier=limit,
    )


def _locking(values: Values, wanted: Values, bins: int) -> float:
    if not values.size:
        return math.nan
    excess = _fractions(values, bins) - _fractions(wanted, bins)
    return 100.0 * bins * float(np.abs(excess).max()) / values.size


def _fractions(values: Values, bins: int) -> npt.NDArray[np.intp]:
    """Return the histogram of the fractional parts; that of -1e-20 is 1, by rounding."""
    places = np.minimum(np.mod(values, 1.0) * bins, bins - 1).astype(np.intp)
    return np.bincount(places, minlength=bins)


def _percent_bad(errors: Values, threshold: float) -> float:
    good = np.count_nonzero(errors <= threshold)  # false for the NaN of a missing estimate
    return 100.0 * (errors.size - good) / errors.size


def _errors(values: Values, wanted: Values) -> Values:
    return np.abs(values - wanted)


def _present(errors: Values) -> Values:
    return errors[~np.isnan(errors)]


def _mean(values: Values) -> float:
    return float(values.mean()) if values.size else math.nan


def temporal_deviation(estimates: Sequence[Floats] | Floats, mask: Mask | None = None) -> float:
    """Return the standard deviation of a pixel's disparity over the frames, mean over the pixels.

    It measures how much the maps of a static scene flicker, right or wrong. Only pixels with a
    finite estimate in every frame are scored: check their number, too.

    Parameters
    ----------
    estimates
        Disparities in px of two frames at least, float (N, H, W) or a sequence of (H, W); NaN or
        infinite = missing.
    mask
        Pixels to score, bool (H, W): those whose true disparity is the same in all frames. Without
        one, all.

    Returns
    -------
    float
        px, 0 and above. The deviation is that of all frames from their mean (N, not N - 1).

    Raises
    ------
    TypeError
        If the disparities are not floats, or the mask is not bool.
    ValueError
        If there are fewer than two frames, shapes differ, or nothing is left to score.
    """
    if len(estimates) < _LEAST_FRAMES:
        raise ValueError(f"estimates: got {len(estimates)} frames; accepts two or more")
    size = as_numbers(estimates[0], "estimates", "f").shape
    stack = np.stack([as_numbers(each, "estimates", "f", size) for each in estimates])
    scored = np.isfinite(stack).all(axis=0)
    if mask is not None:
        scored &= as_numbers(mask, "mask", "b", size)

    if not scored.any():
        raise ValueError("nothing is left to score: no pixel has an estimate in every frame")

    return float(stack[:, scored].astype(np.float64).std(axis=0).mean())

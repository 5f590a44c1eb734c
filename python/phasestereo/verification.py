"""A second opinion on a disparity map: the pixels that the images refute or support."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo import _core
from phasestereo._images import ImageOrPath, as_numbers, as_pixels, as_rgb8
from phasestereo._numbers import check_callable
from phasestereo._opening import Progress, opened_valid
from phasestereo.known import Known, as_known
from phasestereo.result import Result
from phasestereo.rig.findings import Finding
from phasestereo.settings import PRESETS

_DIMMED = 0.5  # of the gray values without a verdict
_WEIGHT = 0.55  # of the color of a verdict
# Blue and orange differ for every kind of color vision, and also in brightness.
_COLORS = {"SUPPORTED": (0, 110, 200), "REFUTED": (255, 140, 0)}


class Verdict(IntEnum):
    """The images' verdict on a map's disparity; values of `Verification.verdict`.

    Examples
    --------
    >>> found = ps.verify(left, right, result.disparity)
    >>> refuted = found.verdict == ps.Verdict.REFUTED
    """

    NO_CLAIM = 0
    """The map has no finite disparity here."""
    UNKNOWN = 1
    """The images cannot judge it: too little texture, an occlusion, or an unsure match."""
    SUPPORTED = 2
    """The images support it: the match is confident, and within 1.5 px of it."""
    REFUTED = 3
    """The images refute it: another disparity fits better, here and around."""


@dataclass(frozen=True, slots=True, eq=False)
class Verification:
    """The result of `verify` for a disparity map; printing it prints its sentences.

    Parameters
    ----------
    verdict
        uint8 (H, W), values of `Verdict`.
    better
        float32 (H, W), pixels: the disparity that fits better where the map is refuted, else NaN.
    confidence
        float32 (H, W), 0 to 1: the probability that the map is within 1 px of the truth; 0 where
        the map has no disparity.
    uncertainty
        float32 (H, W), pixels: the error bar of the map, which holds 90 % of its errors; NaN where
        the map has no disparity.
    findings
        Findings about the map as a whole, worst first, then about the match.
    result
        The match that the map was compared with, with the preset ``"robust"``, over the disparities
        found in the images and nearly all those of the map.

    Examples
    --------
    >>> found = ps.verify(left, right, result.disparity)
    >>> found.refuted, found.supported, found.unknown  # shares of the disparities
    """

    verdict: NDArray[np.uint8]
    better: NDArray[np.float32]
    confidence: NDArray[np.float32]
    uncertainty: NDArray[np.float32]
    findings: tuple[Finding, ...]
    result: Result

    @property
    def refuted(self) -> float:
        """Share of the map's disparities, 0 to 1, that the images refute."""
        return self._share(Verdict.REFUTED)

    @property
    def supported(self) -> float:
        """Share of the map's disparities, 0 to 1, that the images support."""
        return self._share(Verdict.SUPPORTED)

    @property
    def unknown(self) -> float:
        """Share of the map's disparities, 0 to 1, that the images cannot judge."""
        return self._share(Verdict.UNKNOWN)

    def picture(self) -> NDArray[np.uint8]:
        """Return the left image in gray, blue where the map is supported, orange where refuted.

        Returns
        -------
        ndarray
            uint8 (H, W, 3); darker where there is no verdict.

        Raises
        ------
        ValueError
            If the pair is not available any more, for example after pickling.
        """
        if self.result.pair is None:
            raise ValueError("result: got no pair, as after a pickle; accepts one with its images")

        pixels = as_rgb8(as_pixels(self.result.pair[0], "left")).astype(np.float64)
        shown = np.repeat(pixels.mean(axis=2, keepdims=True), 3, axis=2)

        dark = self.verdict <= Verdict.UNKNOWN
        shown[dark] *= _DIMMED
        for name, color in _COLORS.items():
            where = self.verdict == Verdict[name]
            shown[where] += _WEIGHT * (np.array(color) - shown[where])

        return np.asarray(np.rint(shown), np.uint8)

    def __str__(self) -> str:
        """Return one line per finding: its severity, and a sentence."""
        return "\n".join(f"{found.severity}: {found.sentence}" for found in self.findings)

    def __repr__(self) -> str:
        """Show the size and the shares, not the arrays."""
        rows, cols = self.verdict.shape
        shares = {each: getattr(self, each) for each in ("refuted", "supported", "unknown")}
        told = ", ".join(f"{share:.1%} {name}" for name, share in shares.items())
        return f"<Verification {cols}x{rows}, {told}>"

    def _share(self, verdict: Verdict) -> float:
        counts = np.bincount(self.verdict.ravel(), minlength=len(Verdict))
        claims = int(counts[Verdict.UNKNOWN :].sum())
        return float(counts[verdict]) / max(claims, 1)


def verify(
    left: ImageOrPath,
    right: ImageOrPath,
    disparity: ArrayLike,
    *,
    threads: int | None = None,
    left_mask: ArrayLike | None = None,
    right_mask: ArrayLike | None = None,
    progress: Progress | None = None,
    known: Known | None = None,
) -> Verification:
    """Judge a disparity map of any origin by its images.

    The pair is prepared as `match` does with the preset ``"robust"``: cameras, rows, blur, light
    and noise are estimated and compensated for. It is matched; where the map differs, the matching
    costs of both disparities around the pixel decide. Pixels that the right image does not see are
    never refuted. The probability that the map is right is learned from maps of networks and other
    matchers, by ``phasestereo bench confidence --of maps``.

    Parameters
    ----------
    left, right, threads, left_mask, right_mask, progress, known
        As `match` takes them, `known` without ``before``.
    disparity
        (H, W), the map of the left image: left column x corresponds to right column ``x -
        disparity``. Floats or integers, in pixels; non-finite values are missing.

    Returns
    -------
    Verification
        A confidence, an error bar and a verdict for every pixel, better disparities, findings.

    Raises
    ------
    TypeError
        If the map is not an array of real numbers; else as `match`.
    ValueError
        If the map's shape differs from the images', or it has no finite value; else as `match`.
    OSError, ImportError, MemoryError, KeyboardInterrupt
        As `match`.

    Notes
    -----
    A map with the opposite sign, or in 16ths of a pixel (from OpenCV's matchers) or 256ths (from
    KITTI's files), is judged as it stands, and a finding reports it.

    On 12 Middlebury pairs, 45 % of HITNet's disparities that are wrong by more than 1 px are
    refuted, and 0.7 % of the right ones; with noise of 20 gray levels 21 and 0.8 %, with one image
    out of focus 52 and 2.2 %. `phasestereo bench verify` measures it.

    Examples
    --------
    >>> found = ps.verify(left, right, disparity)
    >>> wrong = found.verdict == ps.Verdict.REFUTED
    """
    images, masks = (left, right), (left_mask, right_mask)
    return judge(images, masks, disparity, threads=threads, progress=progress, known=known)


def judge(
    images: tuple[ImageOrPath, ImageOrPath],
    masks: tuple[ArrayLike | None, ArrayLike | None],
    disparity: ArrayLike,
    *,
    threads: int | None,
    known: Known | None,
    progress: Progress | None = None,
    ready: _core.Ready | None = None,
) -> Verification:
    """Judge as `verify` does; a pair that its settings mark as ready is not estimated again."""
    check_callable("progress", progress)
    arrays, pair, valid = opened_valid(images, masks)
    claims = as_claims(disparity, pair[0].shape[:2])
    judged = _core.verify_map(
        pair, valid, claims, PRESETS["robust"], threads, progress, as_known(known), ready
    )
    return replace(judged, result=replace(judged.result, pair=arrays))


def as_claims(
    disparity: ArrayLike, size: tuple[int, ...], name: str = "disparity"
) -> NDArray[np.float32]:
    """Return a map as the core takes it; infinity, PFM's mark, counts as missing.

    Raises
    ------
    TypeError
        If it is not an array of real numbers.
    ValueError
        If it has another shape, or no finite value.
    """
    values = as_numbers(disparity, name, "iuf", size)
    with np.errstate(over="ignore"):  # values beyond float32 lie outside the right image, too
        narrow = values.astype(np.float32)
    beyond = np.isinf(narrow) & np.isfinite(values)
    narrow[beyond] = np.copysign(np.finfo(np.float32).max, narrow[beyond])

    if not np.isfinite(narrow).any():
        raise ValueError(f"{name}: no pixel claims a disparity; accepts some finite values")
    return narrow

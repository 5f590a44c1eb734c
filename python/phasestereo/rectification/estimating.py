"""How the cameras of a pair stand to each other, from what its images show, and nothing else.

Features that both images show are brought onto the same rows by a model of the two cameras
(`model`, `fitting`); then corners are followed in the roughly rectified images, and the model is
fitted to these (`features`). It says so, rather than guess, where the images do not show enough.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from phasestereo._extras import require
from phasestereo._images import Pixels
from phasestereo.rectification.cameras import Maps
from phasestereo.rectification.features import Matches, Plane, Points, followed, led_back, matched
from phasestereo.rectification.fitting import Fit, consensus, fitted, fitted_anew
from phasestereo.rectification.record import inside

Planes = tuple[Plane, Plane]

_LEAST = 40  # matches of features: unrelated images have 20 or so
_LEAST_AGREE = 30
_LEAST_CORNERS = 60
_SHARE = 0.4  # of the matches that agree: those of unrelated images agree by chance
_LARGEST_ERROR = 1.0  # rows
_LARGEST_SPREAD = 1.5  # rows, of images 1000 pixels wide: no two cameras are like that
_UNCERTAIN = 0.25  # rows
_SMOOTH = 2.0  # pixels
_BIAS = 0.03  # rows: error that no averaging removes
_ROUNDS = 2
_NEAR = 4.0  # robust standard deviations: features to start from
_PLACES = 16  # along each side of the image, at which the error is worked out
_ENDS = 2.0, 50.0, 98.0  # percentiles of the disparities
_DISTORTED = 0.05
_LONGEST = 1.5  # focal length of toed-in cameras, in widths of the image
_NEARLY_ALL = 0.95
_CLEARLY = 2.0  # pixels
_LUMA = np.array([0.299, 0.587, 0.114])


class EstimatedMaps(NamedTuple):
    """The maps that rectify a pair, the expected error in rows, and sentences."""

    maps: Maps
    error: float
    sentences: tuple[str, ...]


def estimated(pairs: Sequence[tuple[Pixels, Pixels]]) -> EstimatedMaps:
    """Estimate the cameras of pairs that all come from the same two.

    Parameters
    ----------
    pairs
        As `as_pair` returns them, all of one size.

    Raises
    ------
    ValueError
        If they differ in size, or the images do not show enough; the message says why.
    """
    size = pairs[0][0].shape[1], pairs[0][0].shape[0]
    if any(pair[0].shape[:2] != size[::-1] for pair in pairs):
        raise ValueError(f"others: got pairs of another size; accepts that of left, {size[::-1]}")

    planes = [(_gray(left, "left"), _gray(right, "right")) for left, right in pairs]
    rough = [(pair, _agreeing(pair)) for pair in planes]
    used = [(pair, found) for pair, found in rough if not isinstance(found, str)]

    negative = not used
    if negative:  # features of a picture and of its negative differ, so the negative is tried
        turned = [((left, -right), _agreeing((left, -right))) for left, right in planes]
        used = [(pair, found) for pair, found in turned if not isinstance(found, str)]

    if not used:
        raise ValueError(f"left, right: {rough[0][1]}")

    fit = fitted_anew(_joined([found for _, found in used]), size)
    _refuse_spread(fit)

    best = _tried(used, fit, 0.0)
    if isinstance(best, ValueError) or best.error > _UNCERTAIN:  # as where one image is blurred
        again = _tried(used, fit, _SMOOTH)
        if not isinstance(again, ValueError) and (
            isinstance(best, ValueError) or again.error < best.error
        ):
            best = again

    if isinstance(best, ValueError):
        raise best

    return _found(best, len(used), negative=negative)


def _gray(image: Pixels, side: str) -> Plane:
    """Return an image in gray, of a scale that float32 can hold."""
    if not np.isfinite(image).all():
        raise ValueError(f"{side}: got NaN or infinite pixels; accepts finite ones")

    scaled = image / max(float(np.abs(image).max()), 1.0)
    gray = scaled @ _LUMA if image.shape[2] == 3 else scaled[:, :, 0]
    return gray.astype(np.float32)


class _Tried(NamedTuple):
    """A fit to corners that were followed, and the error in rows that it is expected to have."""

    fit: Fit
    matches: Matches
    maps: Maps
    disparity: Points
    error: float
    moved: float
    """Pixels by which columns are moved so that disparities are positive."""


def _tried(used: Sequence[tuple[Planes, Matches]], fit: Fit, smooth: float) -> _Tried | ValueError:
    """Return what comes of following corners, or why nothing does."""
    try:
        return _followed(used, fit, smooth)
    except ValueError as error:
        return error


def _followed(used: Sequence[tuple[Planes, Matches]], fit: Fit, smooth: float) -> _Tried:
    """Follow corners in images that are rectified by a rough fit, and fit the model to them."""
    found = [matches for _, matches in used]
    for _ in range(_ROUNDS):
        # Each round follows corners in images that are rectified a little better.
        found = [
            _refined(pair, fit, matches, smooth) if len(matches[0]) else matches
            for (pair, _), matches in zip(used, found, strict=True)
        ]

        count = sum(len(left) for left, _ in found)
        if count < _LEAST_CORNERS:
            raise ValueError(
                f"left, right: got images in which only {count} corners can be followed from one "
                f"into the other; accepts {_LEAST_CORNERS} or more"
            )
        fit = fitted(_joined(found), fit.model)
        _refuse_spread(fit)

    left, right = _joined(found)
    agree = left[fit.agree], right[fit.agree]

    shifts = fit.model.shifts(agree)
    columns = [points[:, 0] for points in fit.model.rectified(agree)]
    disparity = columns[0] + shifts[0][0] - columns[1] - shifts[1][0]

    moved, low = 0.0, float(np.percentile(disparity, _ENDS[0]))
    if _are_negative(disparity) and _are_toed_in(agree, fit.model.size, low):
        moved = -low
        shifts = (shifts[0][0] + moved / 2, shifts[0][1]), (shifts[1][0] - moved / 2, shifts[1][1])
    maps, disparity = fit.model.maps(shifts), disparity + moved

    error = float(np.hypot(fit.error(_everywhere(maps, disparity)), _BIAS))
    if fit.model.folds:
        error = np.inf
    return _Tried(fit, agree, maps, disparity, error, moved)


def _are_toed_in(matches: Matches, size: tuple[int, int], low: float) -> bool:
    """Return whether rows lie as those of cameras that are turned towards each other.

    A camera of focal length f that is turned moves columns by s, here to disparities down to `low`,
    and rows at (x, y) from its center by s x y / f^2; images that are exchanged leave rows alone.
    """
    (left, right), (cols, rows) = matches, size
    x, y = 2 * right[:, 0] / (cols - 1) - 1, 2 * left[:, 1] / (rows - 1) - 1
    terms = np.stack([np.ones_like(x), x, y, x * y, x * x, y * y], axis=1)
    twist = float(np.linalg.lstsq(terms, right[:, 1] - left[:, 1])[0][3])
    return twist >= -low * rows / (4 * _LONGEST**2 * cols)


def _are_negative(disparity: Points) -> bool:
    return bool(np.mean(disparity < 0) >= _NEARLY_ALL and np.median(disparity) <= -_CLEARLY)


def _agreeing(pair: Planes) -> Matches | str:
    """Return matches of features that agree on where rows are, or say why there are none."""
    matches = matched(*pair)
    count = len(matches[0])
    if count < _LEAST:
        return (
            f"got images in which only {count} features of the same things are found; accepts "
            f"{_LEAST} or more, spread over both images"
        )

    agree = consensus(matches, pair[0].shape[1])
    if agree.sum() < max(_LEAST_AGREE, _SHARE * count):
        return (
            f"got images of which only {agree.sum()} of {count} matches of features agree on how "
            "rows lie; accepts two views of one scene, taken side by side"
        )

    return matches[0][agree], matches[1][agree]


def _joined(matches: Sequence[Matches]) -> Matches:
    left, right = (np.concatenate(parts) for parts in zip(*matches, strict=True))
    return left, right


def _refined(pair: Planes, fit: Fit, matches: Matches, smooth: float) -> Matches:
    """Follow corners in images that are rectified as well as is known so far."""
    cv2 = require("cv2", extra="rectify")
    maps = fit.model.maps()
    left, right = (
        cv2.remap(image, *part, cv2.INTER_LANCZOS4) for image, part in zip(pair, maps, strict=True)
    )

    masks = [inside(part, pair[0].shape).astype(np.uint8) for part in maps]
    near = np.abs(fit.model.rows(matches)) < _NEAR * fit.spread
    if near.sum() < _LEAST_AGREE:
        return np.zeros((0, 2)), np.zeros((0, 2))

    seeds = fit.model.rectified((matches[0][near], matches[1][near]))
    found = followed((left, right), seeds, (masks[0], masks[1]), smooth)
    return led_back(found, maps) if len(found[0]) else found  # OpenCV reads one place at least


def _refuse_spread(fit: Fit) -> None:
    most = _LARGEST_SPREAD * max(1.0, fit.model.size[0] / 1000)
    if fit.spread > most:
        raise ValueError(
            "left, right: got images that no two cameras take at one moment: their rows stay "
            f"{fit.spread:.1f} px apart; accepts at most {most:.1f} px"
        )


def _found(best: _Tried, pairs: int, *, negative: bool) -> EstimatedMaps:
    """Sum up a fit.

    Raises
    ------
    ValueError
        If rows are not known well enough.
    """
    if best.error == np.inf:
        raise ValueError(
            "left, right: got images that fit no two cameras but such as show things twice; "
            "accepts pairs that tell more: give others of the same cameras, or a calibration"
        )

    if not best.error <= _LARGEST_ERROR:
        raise ValueError(
            f"left, right: got images that tell rows to {best.error:.1f} px only, since they show "
            f"too little in common, or only in a part; accepts {_LARGEST_ERROR:g} px: give more "
            "pairs of the same cameras (others), or a calibration"
        )

    said = ("the right image seems to be a negative of the left one",) if negative else ()
    return EstimatedMaps(best.maps, best.error, (*_sentences(best, pairs), *said))


def _everywhere(maps: Maps, disparity: Points) -> Matches:
    """Return matches all over the raw images, at disparities as they are."""
    rows, cols = maps[0][0].shape
    y, x, shift = (
        part.ravel()
        for part in np.meshgrid(
            np.linspace(0, rows - 1, _PLACES),
            np.linspace(0, cols - 1, _PLACES),
            np.percentile(disparity, _ENDS),
            indexing="ij",
        )
    )

    # What counts is in both rectified images, and in both raw ones.
    seen = (x - shift >= 0) & (x - shift <= cols - 1)
    right = np.stack([x - shift, y], axis=1)[seen]
    raw = led_back((np.stack([x, y], axis=1)[seen], right), maps)

    size = np.array([cols - 1, rows - 1])
    there = np.all([(points >= 0) & (points <= size) for points in raw], axis=(0, 2))
    return raw[0][there], raw[1][there]


def _sentences(best: _Tried, pairs: int) -> Iterator[str]:
    fit, disparity = best.fit, best.disparity
    before = best.matches[1][:, 1] - best.matches[0][:, 1]
    several = "" if pairs == 1 else f" of {pairs} pairs"
    yield (
        f"rows were {np.sqrt(np.mean(before**2)):.1f} px off; those of {len(before)} corners"
        f"{several} now agree within {fit.spread:.2f} px, and rows are known to {best.error:.2f} px"
    )

    k1 = np.mean([camera[1][0] for camera in fit.model.cameras()])
    if abs(k1) > _DISTORTED:
        yield f"the lenses seem to distort (k1 about {k1:.2f}): that is undone, as far as rows tell"

    low, _, high = np.percentile(disparity, _ENDS)
    yield f"disparities are about {low:.0f} to {high:.0f} px"

    if best.moved:
        yield (
            f"the cameras are toed in: columns were moved by {best.moved:.0f} px, so that "
            "disparities are not negative"
        )
    if _are_negative(disparity):
        yield (
            "left and right seem to be swapped, since all disparities are negative: exchange the "
            "images (toed-in cameras give the same)"
        )

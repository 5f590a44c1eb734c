"""What both images of a raw pair show: places in the left one, and where they are in the right.

First features that are known again however they moved (SIFT), then, once the images are roughly
rectified, corners followed from one into the other to a tenth of a pixel. All by OpenCV; here
belongs that they are spread over the image, since a camera is known only where it was seen.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo.rectification.cameras import Maps

Plane: TypeAlias = NDArray[np.float32]
Gray: TypeAlias = NDArray[np.uint8]
Points: TypeAlias = NDArray[np.float64]
"""Columns and rows, (N, 2), pixels."""
Matches: TypeAlias = tuple[Points, Points]
"""The same things in the left and in the right image."""

_PIXELS = 1_500_000  # of the copy in which features are looked for
_GRID = 8, 12  # cells, down and across
_FEATURES = 40  # of a cell
_CORNERS = 24  # of a cell
_CONTRAST = 0.01  # of a feature: a quarter of OpenCV's default, for dark images
_RATIO = 0.8  # of the distances of the best and the next best match, as Lowe has it
_ENDS = 0.5, 99.5  # percentiles of gray levels that become black and white
_SURROUND = 31  # pixels: gain and offset are evened out over this much
_QUIET = 3.0  # gray levels: contrast that is not made larger
_WINDOW = 21  # pixels around a corner
_BACK = 0.25  # pixels from where a corner came, when it is followed back
_UNLIKE = 25.0  # mean difference of what is around a corner, in levels of an evened image
_NEAREST = 3  # features around a corner, by which its place is guessed


def matched(left: Plane, right: Plane) -> Matches:
    """Return where features of the left image are in the right one.

    Parameters
    ----------
    left, right
        Gray images, float32 (H, W), of any scale.

    Returns
    -------
    tuple
        Columns and rows in the left and in the right image, (N, 2) each; a few per cent are wrong,
        or all if the images have nothing in common.
    """
    (here, left_codes), (there, right_codes) = (_features(image) for image in (left, right))
    if min(len(here), len(there)) < 2:
        return np.zeros((0, 2)), np.zeros((0, 2))

    # Codes have length 1: the squared distance of two is 2 minus twice their product.
    likeness = left_codes @ right_codes.T
    best = likeness.argmax(axis=1)
    which = np.arange(len(here))
    mutual = likeness.argmax(axis=0)[best] == which

    # Lowe's ratio test: the best match must be clearly nearer than the next best one.
    first = likeness[which, best].copy()
    likeness[which, best] = -1
    distances = (np.sqrt(np.maximum(1 - like, 0)) for like in (first, likeness.max(axis=1)))
    clear = np.less(next(distances), _RATIO * next(distances))

    chosen = np.flatnonzero(mutual & clear)
    _, unique = np.unique(here[chosen], axis=0, return_index=True)  # one of several orientations
    chosen = chosen[np.sort(unique)]
    return here[chosen], there[best[chosen]]


def followed(
    images: tuple[Plane, Plane], seeds: Matches, masks: tuple[Gray, Gray], smooth: float
) -> Matches:
    """Return where corners of the left image are in the right one, to a tenth of a pixel or so.

    Parameters
    ----------
    images
        Gray images, float32 (H, W), roughly rectified.
    seeds
        What is known to be in both.
    masks
        uint8 (H, W): not 0 where the images are known.
    smooth
        Standard deviation of a Gaussian that makes both alike where one is blurred, pixels.

    Notes
    -----
    J.-Y. Bouguet, *Pyramidal Implementation of the Lucas Kanade Feature Tracker*, Intel 2000.
    """
    cv2 = require("cv2", extra="rectify")
    left, right = (_evened(image, smooth) for image in images)
    near = cv2.getStructuringElement(cv2.MORPH_RECT, (_WINDOW, _WINDOW))
    masks = cv2.erode(masks[0], near), cv2.erode(masks[1], near)

    found = cv2.goodFeaturesToTrack(left, 0, 0.002, 4, mask=masks[0])
    if found is None:
        return np.zeros((0, 2)), np.zeros((0, 2))

    corners = _spread(found.reshape(-1, 2), left.shape, _CORNERS)
    guesses = (corners + _moved(corners, seeds)).astype(np.float32)
    options = {
        "winSize": (_WINDOW, _WINDOW),
        "maxLevel": 1,
        "criteria": (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 40, 0.005),
        "flags": cv2.OPTFLOW_USE_INITIAL_FLOW,
    }

    there, seen, unlike = cv2.calcOpticalFlowPyrLK(left, right, corners, guesses, **options)
    back, again, _ = cv2.calcOpticalFlowPyrLK(right, left, there, corners.copy(), **options)

    # A corner counts that looks alike and, followed back, comes out where it began.
    good = (seen[:, 0] > 0) & (again[:, 0] > 0) & (unlike[:, 0] < _UNLIKE)
    good &= np.abs(back - corners).max(axis=1) < _BACK
    good[good] = _at(masks[1], there[good]) > 0
    return corners[good].astype(np.float64), there[good].astype(np.float64)


def led_back(matches: Matches, maps: Maps) -> Matches:
    """Return matches in rectified images as matches in the images that maps read."""
    cv2 = require("cv2", extra="rectify")

    left, right = (
        np.stack(
            [
                cv2.remap(part, *points.astype(np.float32).T[:, np.newaxis], cv2.INTER_LINEAR)[0]
                for part in pair
            ],
            axis=1,
        ).astype(np.float64)
        for points, pair in zip(matches, maps, strict=True)
    )
    return left, right


def _features(image: Plane) -> tuple[Points, Plane]:
    """Return where features are, and their codes, of length 1 (RootSIFT)."""
    cv2 = require("cv2", extra="rectify")
    gray = _stretched(image)
    scale = min(1.0, (_PIXELS / gray.size) ** 0.5)
    if scale < 1:
        gray = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)

    sift = cv2.SIFT_create(contrastThreshold=_CONTRAST)
    keys = sorted(sift.detect(gray, None), key=lambda key: -key.response)
    places = np.array([key.pt for key in keys], np.float64).reshape(-1, 2)
    chosen = _chosen(places, gray.shape, _FEATURES)

    if not chosen.size:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    kept, codes = sift.compute(gray, [keys[number] for number in chosen])

    # RootSIFT: Arandjelović and Zisserman, *Three things everyone should know*, CVPR 2012.
    sums = np.maximum(codes.sum(axis=1, keepdims=True), 1e-6)
    points = np.array([key.pt for key in kept])

    sides = np.array(image.shape[::-1]) / gray.shape[::-1]
    return (points + 0.5) * sides - 0.5, np.sqrt(codes / sums)


def _spread(points: Plane, shape: tuple[int, ...], most: int) -> Plane:
    return np.ascontiguousarray(points[_chosen(points, shape, most)], np.float32)


def _chosen(points: Points | Plane, shape: tuple[int, ...], most: int) -> NDArray[np.intp]:
    """Return the numbers of the first points in each cell of a grid, so many at most."""
    cells = np.array(_GRID[::-1])
    place = np.minimum((points * cells / np.array(shape[1::-1])).astype(np.intp), cells - 1)

    cell = place[:, 1] * cells[0] + place[:, 0]
    # Points come the strongest first, which a stable order keeps within each cell.
    order = np.argsort(cell, kind="stable")
    ranks = np.empty_like(order)
    first = np.searchsorted(cell[order], cell[order])
    ranks[order] = np.arange(order.size) - first

    return np.flatnonzero(ranks < most)


def _moved(points: Plane, seeds: Matches) -> Points:
    """Return by how much points move, as the nearest seeds do: the median of these."""
    near = seeds[0].astype(np.float32)
    # Squared distances but for a term that is the same for all seeds.
    squares = (near**2).sum(axis=1) - 2 * points @ near.T
    count = min(_NEAREST, len(near))
    nearest = np.argpartition(squares, count - 1, axis=1)[:, :count]

    moves: Points = np.median((seeds[1] - seeds[0])[nearest], axis=1)
    return moves


def _at(mask: Gray, points: Plane) -> Gray:
    rows, cols = mask.shape
    column, row = np.rint(points).astype(np.intp).T
    value: Gray = mask[np.clip(row, 0, rows - 1), np.clip(column, 0, cols - 1)]
    return value


def _stretched(image: Plane) -> Gray:
    low, high = np.percentile(image, _ENDS)
    share = (image - low) / max(high - low, np.finfo(np.float32).tiny)
    return np.asarray(255 * np.clip(share, 0, 1), np.uint8)


def _evened(image: Plane, smooth: float) -> Gray:
    """Return an image whose surroundings have all the same mean and contrast."""
    cv2 = require("cv2", extra="rectify")
    gray = _stretched(image).astype(np.float32)
    if smooth:
        gray = cv2.GaussianBlur(gray, (0, 0), smooth)

    mean = cv2.blur(gray, (_SURROUND, _SURROUND))
    power = cv2.blur(gray * gray, (_SURROUND, _SURROUND)) - mean * mean
    even = (gray - mean) / np.sqrt(np.maximum(power, 0) + _QUIET**2)
    return np.asarray(np.clip(40 * even + 128, 0, 255), np.uint8)

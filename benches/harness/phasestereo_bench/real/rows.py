"""Compares estimates of the rows of raw frames, from the images alone, with the calibration.

For each distance, the calibration gives the raw right pixel that shows the same point as a raw left
pixel. These places, all over the image and at five distances, are the truth.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import interpolate

import phasestereo as ps
from phasestereo import Rectification
from phasestereo.rig.findings import unwarned
from phasestereo_bench.arrays import Plane
from phasestereo_bench.real.frames import read_frame

_STEP = 12  # px between places
_DISTANCES = 5
_COARSE = 6  # px between the points that invert the maps


class Places(NamedTuple):
    """Raw pixels of both images that show the same points, each (N,)."""

    left_x: Plane
    left_y: Plane
    right_x: Plane
    right_y: Plane


def score_rows(folder: Path, files: tuple[Path, ...]) -> dict[str, Any]:
    """Return the row errors of a raw frame, before and after corrections from the frame alone.

    Returns
    -------
    dict
        Root mean squares over the image in px: ``"delivered"``; ``"match"``, after `match`
        straightens the rows by itself; ``"rectify"``, after `rectify` without the calibration, None
        if it refuses; ``"calibrated"``, measured on the pair after rectification by the
        calibration, None if too little is seen. ``"offset"``: row offset at the center that `match`
        finds, None if it finds no offset.

    Raises
    ------
    ImportError, OSError, ValueError
        As `phasestereo.rectify`.
    """
    left, right = read_frame(files)
    truth = ps.rectify(left, right, folder)

    with unwarned():  # this function measures those faults itself
        places = corresponding(truth, _disparities(truth), (left.shape[0], left.shape[1]))
        alignment = ps.match(left, right, threads=1).alignment

    off = places.right_y - places.left_y
    straightened = off
    if alignment is not None and alignment.applied:
        straightened = off - alignment.offsets(places.right_x, places.left_y)

    return {
        "delivered": _rms(off),
        "match": _rms(straightened),
        "rectify": _rectified(left, right, places),
        "calibrated": truth.error,
        "offset": None if alignment is None else alignment.vertical,
    }


def corresponding(truth: Rectification, disparities: Plane, size: tuple[int, int]) -> Places:
    """Return the raw pixels that show the same points by a calibration, at these disparities.

    Parameters
    ----------
    truth
        The frame rectified by the calibration.
    disparities
        Disparities in the rectified pair, whole px.
    size
        Height and width of the raw images.
    """
    (left_x, left_y), (right_x, right_y) = truth.maps
    rows, cols = left_x.shape
    y, x = (grid.ravel() for grid in np.mgrid[0:rows:_STEP, 0:cols:_STEP])

    parts = []
    for disparity in disparities.astype(int):
        inside = (x >= disparity) & (x - disparity < cols)
        at, here, there = y[inside], x[inside], x[inside] - disparity
        parts.append([left_x[at, here], left_y[at, here], right_x[at, there], right_y[at, there]])

    # A place outside one of the raw images corresponds to nothing.
    found = np.concatenate([np.asarray(part, np.float64) for part in parts], axis=1)
    limits = np.array([size[1], size[0], size[1], size[0]])[:, np.newaxis] - 1
    return Places(*found[:, ((found >= 0) & (found <= limits)).all(axis=0)])


def _disparities(truth: Rectification) -> Plane:
    """Return whole disparities over the full range of the rectified pair."""
    result = ps.match(
        truth.left,
        truth.right,
        left_mask=truth.left_mask,
        right_mask=truth.right_mask,
        threads=1,
    )

    trusted = result.disparity[np.isfinite(result.disparity) & (result.flags == 0)]
    low, high = np.percentile(trusted, (2.0, 98.0))
    return np.rint(np.linspace(float(low), float(high), _DISTANCES))


def _rectified(left: Any, right: Any, places: Places) -> float | None:
    """Return the row errors after `rectify` from the images alone; None if it refuses."""
    try:
        found = ps.rectify(left, right)
    except ValueError:
        return None

    (left_x, left_y), (right_x, right_y) = found.maps
    off = _turned_around(left_x, left_y, places.left_x, places.left_y) - _turned_around(
        right_x, right_y, places.right_x, places.right_y
    )
    return _rms(off[np.isfinite(off)])


def _turned_around(x_map: Any, y_map: Any, x: Plane, y: Plane) -> Plane:
    """Return the rows to which a rectification brings raw pixels; NaN outside of it."""
    rows, cols = x_map.shape
    at, across = np.mgrid[0:rows:_COARSE, 0:cols:_COARSE]
    points = np.stack([x_map[at, across].ravel(), y_map[at, across].ravel()], axis=1)

    # Maps lead from rectified to raw pixels; interpolation between scattered points inverts them.
    row = interpolate.CloughTocher2DInterpolator(
        points.astype(np.float64), at.ravel().astype(float)
    )
    return row(x, y)


def _rms(values: Plane) -> float:
    return float(np.sqrt(np.mean(values**2)))

"""Judges a map without a truth, by whether the matcher agrees with itself.

If you mirror both images of a pair and swap them, you get a pair again, whose disparities are those
of the right image. Every matcher takes such a pair, so each one can run twice. Pixels that only one
camera sees cannot agree, so even a perfect map has less than 100 %.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo.rig.findings import unwarned
from phasestereo_bench.arrays import Floats
from phasestereo_bench.methods import method
from phasestereo_bench.middlebury import matched
from phasestereo_bench.real.frames import read_frame

NUM_DISPARITIES = 64
"""The number of disparities for methods that need one."""

CONFIDENT = 0.5
"""A method itself trusts a disparity with this confidence or more."""


def score_frame(folder: Path, files: tuple[Path, ...], spec: str, *, rectified: bool) -> Any:
    """Match a frame from either side, raw or rectified with the calibration.

    Returns
    -------
    dict
        ``"agreement"``: share of the pixels, 0 to 1, whose disparity the map of the right image
        confirms within 1 px; ``"trusted"``: share whose confidence is at least `CONFIDENT`, None
        for methods without one; ``"seconds"`` and ``"peak_bytes"`` of the first of both matches.

    Raises
    ------
    ImportError, OSError, ValueError
        As `phasestereo.rectify` and `phasestereo_bench.method`.
    """
    left, right = read_frame(files)
    valid = np.ones(left.shape[:2], np.bool_)
    if rectified:
        rig = ps.rectify(left, right, folder)
        left, right, valid = rig.left, rig.right, rig.left_mask

    entrant = method(spec)
    with unwarned():
        found = matched(entrant, left, right, NUM_DISPARITIES)
        other = matched(entrant, _mirrored(right), _mirrored(left), NUM_DISPARITIES).disparity

    confidence = found.confidence
    trusted = None if confidence is None else float((confidence >= CONFIDENT)[valid].mean())

    return {
        "agreement": float(confirmed(found.disparity, _mirrored(other))[valid].mean()),
        "trusted": trusted,
        "seconds": found.seconds,
        "peak_bytes": found.peak_bytes,
    }


def confirmed(disparity: Floats, of_right: Floats) -> NDArray[np.bool_]:
    """Return for every left pixel whether the right map confirms its disparity, within 1 px.

    Parameters
    ----------
    disparity, of_right
        Disparities of the left and of the right image, (H, W), px; NaN elsewhere.
    """
    cols = disparity.shape[1]
    column = np.rint(np.arange(cols) - np.nan_to_num(disparity, nan=np.inf))
    inside = (column >= 0) & (column < cols)

    # Columns outside are read at 0, and masked out below.
    index = np.where(inside, column, 0).astype(np.intp)
    there = np.take_along_axis(of_right, index, axis=1)
    return inside & (np.abs(there - disparity) <= 1)


def _mirrored(image: Any) -> Any:
    return np.ascontiguousarray(image[:, ::-1])

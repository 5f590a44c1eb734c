"""Surfaces from disparities and a calibration: triangles that carry the left image."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._numbers import as_number
from phasestereo.io import Calibration
from phasestereo.result import Keep, Result
from phasestereo.shapes import Mesh
from phasestereo.views.depths import Anchor, Selection, as_disparities
from phasestereo.views.triangulation import triangulate


def surface_mesh(
    disparity: Result | ArrayLike,
    calibration: Calibration,
    *,
    image: ArrayLike | None = None,
    mask: ArrayLike | None = None,
    keep: Keep = "trusted",
    min_depth: float | None = None,
    max_depth: float | None = None,
    decimate: int = 1,
    max_step: float = 1.0,
    anchor: Anchor | None = None,
) -> Mesh:
    """Turn a disparity map into a surface.

    Parameters
    ----------
    disparity, calibration, mask, keep, min_depth, max_depth, decimate
        As `phasestereo.point_cloud` takes them.
    image
        The image on the surface, as `point_cloud` takes it; None: the left image of the result's
        pair, if it is known.
    max_step
        Largest difference, in pixels, between the disparities of four joined neighbors, more than
        0: where they differ by more, one surface ends and another begins.
    anchor
        A pixel of known distance, as `depth_interval` takes it.

    Returns
    -------
    Mesh
        Two triangles for each four neighboring pixels with a depth on one surface.

    Raises
    ------
    TypeError, ValueError
        As `point_cloud`; also if max_step is not positive.

    Examples
    --------
    >>> mesh = ps.surface_mesh(result, calibration, decimate=2)
    """
    found = triangulate(
        disparity,
        calibration,
        Selection(keep=keep, min_depth=min_depth, max_depth=max_depth, decimate=decimate),
        image=image,
        mask=mask,
        yaw=0.0,
        anchor=anchor,
    )
    values = found.depths.picked(as_disparities(disparity)) / decimate
    faces = _faces(values, found.kept, as_number("max_step", max_step, positive=True))

    rows, cols = np.nonzero(found.kept)
    places = np.stack([cols, rows], axis=1)
    pixels = ((places + 0.5) * decimate - 0.5).astype(np.float32)
    return Mesh(found.points, faces, pixels, found.picture)


def _faces(values: NDArray[Any], wanted: NDArray[np.bool_], step: float) -> NDArray[np.int64]:
    """Return the triangles between the wanted pixels, numbered row by row."""
    number = np.cumsum(wanted).reshape(wanted.shape) - 1
    # The four neighbors: top left, top right, bottom left, bottom right.
    corners = [
        (slice(None, -1), slice(None, -1)),
        (slice(None, -1), slice(1, None)),
        (slice(1, None), slice(None, -1)),
        (slice(1, None), slice(1, None)),
    ]

    there = np.logical_and.reduce([wanted[corner] for corner in corners])
    four = np.where(wanted, values, 0)
    parts = [four[corner] for corner in corners]
    joined = there & (np.maximum.reduce(parts) - np.minimum.reduce(parts) <= step)

    a, b, c, d = (number[corner][joined] for corner in corners)
    return np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])

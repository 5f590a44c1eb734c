"""The points of the 3-D view: not all of them, but as many as a browser turns around with ease."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from phasestereo.io import Calibration
from phasestereo.pair_page.embedding import packed

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Map = NDArray[np.float32]

__all__ = ["Scene", "scene_of"]

_FAR = 1.5  # depths beyond so many times the 90th percentile are left out: they dwarf the rest


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Points in front of the left camera: x to the right, y down, z ahead.

    Parameters
    ----------
    pixels
        uint32 (N,): index of each point's pixel in the layers of the page.
    total
        Number of pixels with a depth, from which these were drawn.
    far
        Share of these that are too far away to be shown.
    limit
        The largest depth that is shown.
    geometry
        The geometry that makes points of pixels.
    nominal
        Whether it is made up, for want of a calibration.
    """

    pixels: NDArray[np.uint32]
    total: int
    far: float
    limit: float
    geometry: Calibration
    nominal: bool

    def described(self) -> dict[str, Any]:
        """Return it as the page has it, the array as text."""
        (focal, _, x), (_, vertical, y), _ = self.geometry.cam0
        return {
            "pixels": packed(self.pixels),
            "nominal": self.nominal,
            "focal": [focal, vertical],
            "centre": [x, y],
            "scale": focal * self.geometry.baseline,  # depth = scale / (disparity + doffs)
            "doffs": self.geometry.doffs,
            "unit": "in baselines" if self.nominal else "in the unit of the baseline",
        }


def scene_of(
    disparity: Map,
    calibration: Calibration | None,
    *,
    step: int,
    most: int,
    max_depth: float | None = None,
) -> Scene:
    """Return points of a disparity map, spread evenly over its pixels.

    Parameters
    ----------
    disparity
        float32 (H, W), pixels.
    calibration
        The geometry; None: the focal length is the images' width, the cameras look the same way
        from one unit apart.
    step
        Only pixels are chosen that the layers of the page hold: every step-th of every step-th row.
    most
        The largest number of points.
    max_depth
        Points farther away are left out; None: those far beyond nearly all of them.
    """
    geometry = calibration or _nominal(disparity.shape)
    depth = geometry.depth(disparity[::step, ::step]).ravel()
    index = np.flatnonzero(np.isfinite(depth))
    limit = max_depth
    if limit is None:
        limit = _FAR * float(np.percentile(depth[index], 90)) if index.size else 0.0
    near = index[depth[index] <= limit]
    far = 1 - near.size / index.size if index.size else 0.0
    chosen = _spread(near, most).astype(np.uint32)
    return Scene(chosen, index.size, far, limit, geometry, calibration is None)


def _nominal(size: tuple[int, ...]) -> Calibration:
    rows, cols = size
    return Calibration.from_focal(cols, 1.0, width=cols, height=rows)


def _spread(index: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """Return at most so many of them, drawn at random: a grid would show as a pattern."""
    if index.size <= most:
        return index
    return np.sort(np.random.default_rng(0).choice(index, most, replace=False))

"""The points of the 3-D view: their number, and the geometry that turns pixels into points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from phasestereo._images import Map
from phasestereo.io import Calibration
from phasestereo.views.depths import Ranging

_FAR = 1.5  # leave out depths beyond this multiple of the 90th percentile: they dwarf the rest


@dataclass(frozen=True, slots=True, eq=False)
class ScenePoints:
    """Points in front of the left camera: x to the right, y down, z ahead.

    Parameters
    ----------
    shown
        Number of points.
    total
        Number of pixels with a depth.
    far
        Share of these that are too far away to show.
    nearest, limit
        The smallest and the largest depth on display.
    ranging
        The converter from pixels to points, and from error bars to the ends of depths.
    nominal
        Whether the geometry is an assumption, without a calibration.
    """

    shown: int
    total: int
    far: float
    nearest: float
    limit: float
    ranging: Ranging
    nominal: bool

    @property
    def geometry(self) -> Calibration:
        """The geometry of the points."""
        return self.ranging.calibration

    def described(self) -> dict[str, Any]:
        """Return it in the form that the page uses."""
        unit = "baselines" if self.nominal else self.geometry.unit or ""
        return {
            **described(self.ranging, unit),
            "nearest": self.nearest,
            "limit": self.limit,
            "nominal": self.nominal,
        }

    @property
    def unit(self) -> str:
        """The unit of distances, in words."""
        if self.nominal:
            return "in baselines"
        return f"in {self.geometry.unit or 'the unit of the baseline'}"


def described(ranging: Ranging, unit: str) -> dict[str, Any]:
    """Return a geometry and its accuracy in the form that scripts use."""
    known = ranging.calibration
    (focal, _, x), (_, vertical, y), _ = known.cam0
    return {
        "nominal": False,
        "focal": [focal, vertical],
        "center": [x, y],
        "scale": focal * known.baseline,  # depth = scale / (disparity + doffs)
        "doffs": known.doffs,
        "right": [known.cam1[0][0], known.cam1[0][2]],
        "unit": unit,
        "share": ranging.share,  # px that the yaw adds to an error bar
    }


def scene_points(
    disparity: Map,
    ranging: Ranging | None,
    *,
    step: int,
    min_depth: float | None = None,
    max_depth: float | None = None,
) -> ScenePoints:
    """Return the points of a disparity map.

    Parameters
    ----------
    disparity
        float32 (H, W), pixels.
    ranging
        The geometry and its accuracy; None: the focal length is the images' width, the cameras are
        parallel and one unit apart.
    step
        Only the pixels in the layers of the page count: every step-th of every step-th row.
    min_depth
        Leaves out points nearer than this; None: no limit.
    max_depth
        Leaves out points farther than this; None: those far beyond nearly all of them.
    """
    known = ranging or _nominal(disparity.shape)
    depth = known.calibration.depth(disparity[::step, ::step]).ravel()
    index = np.flatnonzero(np.isfinite(depth))

    limit = max_depth
    if limit is None:
        limit = _FAR * float(np.percentile(depth[index], 90)) if index.size else 0.0

    nearest = min_depth or 0.0
    shown = int(np.count_nonzero((depth[index] >= nearest) & (depth[index] <= limit)))
    far = float(np.mean(depth[index] > limit)) if index.size else 0.0
    return ScenePoints(shown, index.size, far, nearest, limit, known, ranging is None)


def _nominal(size: tuple[int, ...]) -> Ranging:
    rows, cols = size
    geometry = Calibration.from_focal(cols, 1.0, width=cols, height=rows)
    return Ranging(geometry, 0.0, 0.0, (0.0, 0.0, 0.0))

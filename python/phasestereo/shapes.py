"""Points and surfaces in space, as plain data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phasestereo._images import as_numbers


@dataclass(frozen=True, slots=True, eq=False)
class PointCloud:
    """Points in the frame of the left camera: X to the right, Y down, Z forward.

    Parameters
    ----------
    points
        float32 (N, 3), finite: X, Y, Z in the unit of the baseline.
    colors
        uint8 (N, 3), RGB; None: the points have no colors.
    near, far
        float32 (N,): the depths at the ends of the error bars, as `depth_interval` gives them;
        ``far`` may be infinite. None: there are no error bars.

    Raises
    ------
    TypeError
        If an array is not of its type.
    ValueError
        If an array has the wrong shape, a coordinate is not finite, or only one end is given.

    Examples
    --------
    >>> cloud = ps.point_cloud(result, calibration)
    >>> cloud.points, cloud.colors  # float32 (N, 3), uint8 (N, 3)
    """

    points: NDArray[np.float32]
    colors: NDArray[np.uint8] | None = None
    near: NDArray[np.float32] | None = None
    far: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        """Refuse data that no file of points could hold."""
        as_numbers(self.points, "points", ("float32",), ("N", 3), (0, 3))
        if not np.isfinite(self.points).all():
            raise ValueError("points: got infinity or NaN; accepts finite coordinates")
        if (self.near is None) != (self.far is None):
            raise ValueError("near, far: got one of them; accepts both or none")

        wanted = len(self.points)
        if self.colors is not None:
            as_numbers(self.colors, "colors", ("uint8",), (wanted, 3))
        for name in ("near", "far"):
            if getattr(self, name) is not None:
                as_numbers(getattr(self, name), name, ("float32",), (wanted,))

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        """Show the number of points and their distances, not the arrays."""
        depth = self.points[:, 2]
        span = f", depth {depth.min():.5g} to {depth.max():.5g}" if len(self) else ""
        return f"<PointCloud {len(self)} points{span}{'' if self.colors is None else ', colored'}>"


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """A surface in the frame of the left camera: X to the right, Y down, Z forward.

    Parameters
    ----------
    points
        float32 (N, 3): corners, in the unit of the baseline.
    faces
        int64 (M, 3): the corners of each triangle, by their row in `points`; counter-clockwise as
        the camera sees them.
    pixels
        float32 (N, 2): column and row of each corner in the picture.
    picture
        uint8 (H, W, 3), RGB: the texture of the surface; None: no texture.

    Examples
    --------
    >>> mesh = ps.surface_mesh(result, calibration)
    >>> ps.io.write_glb("surface.glb", mesh)
    """

    points: NDArray[np.float32]
    faces: NDArray[np.int64]
    pixels: NDArray[np.float32]
    picture: NDArray[np.uint8] | None

    def __repr__(self) -> str:
        """Show the numbers of corners and triangles, not the arrays."""
        return f"<Mesh {len(self.points)} points, {len(self.faces)} triangles>"

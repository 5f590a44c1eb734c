"""A calibrated camera pair, and what OpenCV makes of it: maps that rectify its images, and Q."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo._images import Map

Matrix: TypeAlias = NDArray[np.float64]
Maps: TypeAlias = tuple[tuple[Map, Map], tuple[Map, Map]]
"""Of the left and of the right image: column and row at which to read each rectified pixel."""

INTRINSICS = "K1", "D1", "K2", "D2"
POSE = "R", "T"
RECTIFIED = "R1", "R2", "P1", "P2"
MAPS = "map1x", "map1y", "map2x", "map2y"
_LONGEST_SIDE = 32766  # pixels: `cv2.remap` counts in 16 bits


class Warp(NamedTuple):
    """The maps that rectify images of one size, and OpenCV's matrix Q (None: not known)."""

    maps: Maps
    q: Matrix | None
    vertical: bool = False
    """Whether the right camera is below the left one."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Cameras:
    """A calibrated camera pair, by OpenCV's names.

    Parameters
    ----------
    matrices
        ``K1``, ``K2`` (3, 3) and ``D1``, ``D2`` (4, 5, 8, 12 or 14), the intrinsics; beside them
        ``R`` (3, 3) and ``T`` (3, 1), which lead from the left camera to the right one, or a
        rectification: ``R1``, ``R2`` (3, 3), ``P1``, ``P2`` (3, 4). Or the maps themselves:
        ``map1x``, ``map1y``, ``map2x``, ``map2y`` (H, W). ``Q`` (4, 4) may be there, too.
    size
        Columns and rows of the images, if the calibration has them.
    fisheye
        Whether the distortion is that of ``cv2.fisheye``.

    Raises
    ------
    ValueError
        If something is missing.
    """

    matrices: Mapping[str, Matrix]
    size: tuple[int, int] | None = None
    fisheye: bool = False

    def __post_init__(self) -> None:
        """Refuse what is incomplete."""
        if self._has(*MAPS):
            return

        wanted = INTRINSICS if self._has(*RECTIFIED) else (*INTRINSICS, *POSE)
        missing = [name for name in wanted if name not in self.matrices]
        if missing:
            raise ValueError(
                f"has no {', '.join(missing)}, only {', '.join(sorted(self.matrices)) or 'nothing'}"
                "; a rectification takes K1, D1, K2, D2 with R, T or with R1, R2, P1, P2, or the "
                "maps map1x, map1y, map2x, map2y"
            )

    def warp(self, size: tuple[int, int], alpha: float | None) -> Warp:
        """Return what rectifies images of this size (columns, rows).

        Parameters
        ----------
        size
            Columns and rows of the images.
        alpha
            As ``cv2.stereoRectify`` has it. None: the rectification that the calibration has, or
            else OpenCV's -1.

        Raises
        ------
        ValueError
            If the calibration is of images of another size, or the left camera is on the right of
            the other one, or below it.
        """
        if max(size) > _LONGEST_SIDE:
            raise ValueError(
                f"left: got {size[0]} x {size[1]} pixels; accepts {_LONGEST_SIDE} either way, "
                "which is as far as OpenCV counts"
            )

        known = self.matrices[MAPS[0]].shape[::-1] if self._has(*MAPS) else self.size
        if known not in (None, size):
            raise ValueError(
                f"calibration: got that of {known[0]} x {known[1]} pixels; accepts that of the "
                f"images' {size[0]} x {size[1]}"
            )

        if self._has(*MAPS):
            (x1, y1, x2, y2) = (self.matrices[name].astype(np.float32) for name in MAPS)
            return Warp(((x1, y1), (x2, y2)), self.matrices.get("Q"))

        try:
            poses = self._poses(size, alpha)
            maps = self._maps(size, poses)
        except require("cv2", extra="rectify").error as error:
            raise ValueError("calibration: got cameras that OpenCV cannot rectify") from error
        return Warp(maps, q_of(poses["P1"], poses["P2"]), is_vertical(poses["P1"], poses["P2"]))

    def _has(self, *names: str) -> bool:
        return all(name in self.matrices for name in names)

    def _poses(self, size: tuple[int, int], alpha: float | None) -> Mapping[str, Matrix]:
        """Return the rectification: that which the calibration has, or a new one."""
        # An alpha asks for another rectification than the calibrated one, if there is a pose.
        if self._has(*RECTIFIED) and (alpha is None or not self._has(*POSE)):
            return self.matrices

        cv2 = require("cv2", extra="rectify")
        k1, d1, k2, d2, r, t = (self.matrices[name] for name in (*INTRINSICS, *POSE))
        if self.fisheye:
            balance = 0.0 if alpha is None else max(alpha, 0.0)
            found = cv2.fisheye.stereoRectify(
                k1, d1, k2, d2, size, r, t, flags=cv2.CALIB_ZERO_DISPARITY, balance=balance
            )
        else:
            share = -1.0 if alpha is None else alpha
            found = cv2.stereoRectify(
                k1, d1, k2, d2, size, r, t, flags=cv2.CALIB_ZERO_DISPARITY, alpha=share
            )

        return dict(zip(RECTIFIED, found[:4], strict=True))

    def _maps(self, size: tuple[int, int], poses: Mapping[str, Matrix]) -> Maps:
        cv2 = require("cv2", extra="rectify")
        model = cv2.fisheye if self.fisheye else cv2

        left, right = (
            model.initUndistortRectifyMap(
                self.matrices[f"K{side}"],
                self.matrices[f"D{side}"],
                poses[f"R{side}"],
                poses[f"P{side}"],
                size,
                cv2.CV_32FC1,
            )
            for side in (1, 2)
        )
        return left, right


def q_of(left: Matrix, right: Matrix) -> Matrix | None:
    """Return OpenCV's matrix Q of two rectified cameras; None where they have no baseline.

    Raises
    ------
    ValueError
        If the left one is on the right, or below the other one.
    """
    if left.shape != (3, 4) or right.shape != (3, 4):
        return None

    axis = int(is_vertical(left, right))
    baseline = right[axis, 3] - left[axis, 3]
    if baseline > 0:
        side = ("on the right of", "below")[axis]
        raise ValueError(
            f"calibration: got a left camera that is {side} the other one; exchange the "
            "cameras, and the images if these are exchanged, too"
        )
    if baseline == 0:
        return None

    focal, row = left[0, 0], left[0, 0] / left[1, 1]
    q = np.diag([1.0, row, 0.0, 0.0])
    q[:3, 3] = -left[0, 2], -left[1, 2] * row, focal
    # By the focal length along the baseline, which is fy where that is vertical.
    q[3, 2:] = -focal / baseline, (left[axis, 2] - right[axis, 2]) * focal / baseline
    return q


def is_vertical(left: Matrix, right: Matrix) -> bool:
    """Return whether the projections of two rectified cameras have one above the other."""
    if left.shape != (3, 4) or right.shape != (3, 4):
        return False

    # The last column of P is minus the baseline times the focal length.
    along, down = np.abs(right[:2, 3] - left[:2, 3])
    return bool(down > along)

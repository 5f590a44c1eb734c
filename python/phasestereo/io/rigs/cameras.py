"""A calibrated camera pair, and its rectification by OpenCV: the maps for its images, and Q."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo._images import Map, RightView
from phasestereo.io.calibration import Calibration, fits
from phasestereo.io.depth import LengthUnit

Matrix: TypeAlias = NDArray[np.float64]
Maps: TypeAlias = tuple[tuple[Map, Map], tuple[Map, Map]]
"""Of the left and of the right image: column and row at which to read each rectified pixel."""

INTRINSICS = "K1", "D1", "K2", "D2"
POSE = "R", "T"
RECTIFIED = "R1", "R2", "P1", "P2"
MAPS = "map1x", "map1y", "map2x", "map2y"
_LONGEST_SIDE = 32766  # pixels: `cv2.remap` counts in 16 bits
_MIDDLE = 0.25, 0.75  # of the sides: where principal points of whole images lie


class Warp(NamedTuple):
    """The maps that rectify images of one size, and OpenCV's matrix Q (None: unknown)."""

    maps: Maps
    q: Matrix | None
    vertical: bool = False
    """Whether the right camera is below the left one."""
    notes: tuple[str, ...] = ()
    """What was assumed: sentences."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Cameras:
    """A calibrated camera pair, by OpenCV's names.

    Parameters
    ----------
    matrices
        ``K1``, ``K2`` (3, 3) and ``D1``, ``D2`` (4, 5, 8, 12 or 14), the intrinsics; with them
        ``R`` (3, 3) and ``T`` (3, 1), from the left camera to the right one, or a rectification:
        ``R1``, ``R2`` (3, 3), ``P1``, ``P2`` (3, 4). Or the maps themselves: ``map1x``, ``map1y``,
        ``map2x``, ``map2y`` (H, W). ``Q`` (4, 4) is optional.
    size
        Columns and rows of the images, if the calibration has them.
    right_size
        Columns and rows of the right images, if they differ.
    fisheye
        Whether the distortion is that of ``cv2.fisheye``.
    unit
        The unit of `T`, of the baseline in ``P2`` and of `Q`; None: unknown.
    note
        A remark on the calibration; "" without one.
    also
        The same cameras for images of other sizes.

    Raises
    ------
    ValueError
        If something is missing.
    """

    matrices: Mapping[str, Matrix]
    size: tuple[int, int] | None = None
    right_size: tuple[int, int] | None = None
    fisheye: bool = False
    unit: LengthUnit | None = None
    note: str = ""
    also: tuple[Cameras, ...] = ()

    @classmethod
    def rectified(
        cls,
        left: Matrix,
        right: Matrix,
        baseline: float,
        *,
        size: tuple[int, int] | None = None,
        unit: LengthUnit | None = None,
        note: str = "",
    ) -> Cameras:
        """Return the cameras of already rectified images from their intrinsics, (3, 3)."""
        found: dict[str, Matrix] = {}
        for side, camera, x in (("1", left, 0.0), ("2", right, -baseline * right[0, 0])):
            found[f"K{side}"], found[f"D{side}"] = camera, np.zeros((5, 1))
            found[f"R{side}"], found[f"P{side}"] = np.eye(3), np.column_stack([camera, [x, 0, 0]])
        return cls(matrices=found, size=size, unit=unit, note=note)

    def __post_init__(self) -> None:
        """Refuse incomplete cameras."""
        if self.is_maps:
            return

        wanted = INTRINSICS if self._has(*RECTIFIED) else (*INTRINSICS, *POSE)
        missing = [name for name in wanted if name not in self.matrices]
        if missing:
            raise ValueError(
                f"has no {', '.join(missing)}, only {', '.join(sorted(self.matrices)) or 'nothing'}"
                "; a rectification takes K1, D1, K2, D2 with R, T or with R1, R2, P1, P2, or the "
                "maps map1x, map1y, map2x, map2y"
            )

    @property
    def is_maps(self) -> bool:
        """Whether these are maps for ``cv2.remap``, which leave nothing to choose."""
        return self._has(*MAPS)

    def warp(
        self, size: tuple[int, int], alpha: float | None, right: RightView | None = None
    ) -> Warp:
        """Return the rectification of images of this size (columns, rows).

        Parameters
        ----------
        size
            Columns and rows of the left images.
        alpha
            As in ``cv2.stereoRectify``. None: the rectification in the calibration, or else
            OpenCV's -1.
        right
            The conversion of right images of another size to the size of the left ones; None: they
            are of this size.

        Raises
        ------
        ValueError
            If the calibration is for images of another size, or the left camera is to the right of
            the other one, or below it.
        """
        if max(size) > _LONGEST_SIDE:
            raise ValueError(
                f"left: got {size[0]} x {size[1]} pixels; accepts {_LONGEST_SIDE} either way, "
                "which is as far as OpenCV counts"
            )

        cameras, notes = self.at(size, right)
        if cameras.is_maps:
            (x1, y1, x2, y2) = (cameras.matrices[name].astype(np.float32) for name in MAPS)
            return Warp(((x1, y1), (x2, y2)), self.matrices.get("Q"), notes=notes)

        try:
            poses = cameras._poses(size, alpha)
            maps = cameras._maps(size, poses)
        except require("cv2", extra="rectify").error as error:
            raise ValueError("calibration: got cameras that OpenCV cannot rectify") from error
        is_below = is_vertical(poses["P1"], poses["P2"])
        return Warp(maps, q_of(poses["P1"], poses["P2"]), is_below, notes)

    def geometry(self, size: tuple[int, int] | None) -> tuple[Calibration, tuple[str, ...]]:
        """Return the geometry of the rectified pair, and its assumptions, in sentences.

        Parameters
        ----------
        size
            Columns and rows of the images; None: those of the calibration.

        Raises
        ------
        ValueError
            As `warp`; if the size or the baseline is unknown.
        """
        wanted = size or (self._known and self._known[0])
        if wanted is None:
            raise ValueError("size: got None, and the file has none; accepts (columns, rows)")

        right = self.right_size and RightView(self.right_size, _scaling(self.right_size, wanted))
        cameras, notes = self.at(wanted, right)
        q = cameras.matrices.get("Q")
        if not cameras.is_maps:
            poses = cameras._poses(wanted, None)
            q = q_of(poses["P1"], poses["P2"])
        if q is None:
            raise ValueError("has no baseline: depths need one")
        if not cameras._has(*RECTIFIED) and not cameras.is_maps:
            notes += ("the geometry is that of pairs which `rectify` makes by this calibration",)
        return Calibration.from_q(q, width=wanted[0], height=wanted[1], unit=self.unit), notes

    def at(
        self, size: tuple[int, int], right: RightView | None = None
    ) -> tuple[Cameras, tuple[str, ...]]:
        """Return the cameras for images of this size (columns, rows), and the assumptions.

        Parameters
        ----------
        size, right
            As `warp` takes them.

        Raises
        ------
        ValueError
            If the calibration is for images of other proportions.
        """
        notes = (self.note,) if self.note else ()
        wanted = size, right.size if right else size
        every = [one for one in (self, *self.also) if one._known]
        if not every:
            return self._fitted(right), notes + self._placed(wanted)
        exact = [one for one in every if one._known == wanted]
        if exact:
            return exact[0]._fitted(right), notes

        fitting = [
            one for one in every if not one.is_maps and all(map(fits, one._known or (), wanted))
        ]
        if not fitting:
            known = " or ".join(_in_words(one._known or ()) for one in every)
            if every[0].is_maps:
                raise ValueError(
                    f"calibration: got maps of {known} pixels, which cannot be scaled; accepts "
                    f"those of the images' {_in_words(wanted)}"
                )
            raise ValueError(
                f"calibration: got that of {known} pixels; accepts that of the images' "
                f"{_in_words(wanted)}, or of images of the same proportions"
            )
        known = _in_words(fitting[0]._known or ())
        said = f"the calibration of {known} pixels is scaled to {_in_words(wanted)}"
        return fitting[0]._scaled(wanted)._fitted(right), (*notes, said)

    @property
    def _known(self) -> tuple[tuple[int, int], tuple[int, int]] | None:
        """Columns and rows of the left and the right images, if known."""
        size = self.size
        if self.is_maps:
            rows, cols = self.matrices[MAPS[0]].shape
            size = cols, rows
        return size and (size, self.right_size or size)

    def _placed(self, sizes: tuple[tuple[int, int], tuple[int, int]]) -> tuple[str, ...]:
        """Compare principal points with sizes that the calibration does not give.

        Raises
        ------
        ValueError
            If one lies outside the images: they are of another size.
        """
        notes: tuple[str, ...] = ()
        for side, size in zip("12", sizes, strict=True):
            x, y = self.matrices[f"K{side}"][:2, 2]
            at = f"K{side}: the principal point ({x:.5g}, {y:.5g})"
            if not (0 <= x <= size[0] and 0 <= y <= size[1]):
                raise ValueError(
                    f"calibration: {at} lies outside of images of {size[0]} x {size[1]} pixels; "
                    "accepts a calibration of images of this size"
                )
            low, high = _MIDDLE
            if not (low <= x / size[0] <= high and low <= y / size[1] <= high):
                notes += (
                    f"{at} is far from the middle of {size[0]} x {size[1]} pixels: is the "
                    "calibration of images of this size?",
                )
        return notes

    def _scaled(self, sizes: tuple[tuple[int, int], tuple[int, int]]) -> Cameras:
        """Return the cameras for the same images at sizes other than the known ones."""
        left, right = map(_scaling, self._known or (), sizes)
        found = {
            name: (right if name[1] == "2" else left) @ matrix if name[0] in "KP" else matrix
            for name, matrix in self.matrices.items()
            if name != "Q"
        }
        return replace(self, matrices=found, size=sizes[0], right_size=sizes[1])

    def _fitted(self, right: RightView | None) -> Cameras:
        """Return the cameras of right images at the size of the left ones."""
        if right is None:
            return self
        found = dict(self.matrices)
        for name in {"K2", "P2"} & found.keys():
            found[name] = right.matrix @ found[name]
        return replace(self, matrices=found, right_size=None)

    def _has(self, *names: str) -> bool:
        return all(name in self.matrices for name in names)

    def _is_straight(self) -> bool:
        """Return whether the rectification leaves images unchanged, to the bit."""
        return all(
            np.array_equal(self.matrices[f"K{side}"], self.matrices[f"P{side}"][:, :3])
            and np.array_equal(self.matrices[f"R{side}"], np.eye(3))
            and not self.matrices[f"D{side}"].any()
            for side in "12"
        )

    def _poses(self, size: tuple[int, int], alpha: float | None) -> Mapping[str, Matrix]:
        """Return the rectification: the one in the calibration, or a new one."""
        # If the pose is known, an alpha asks for a rectification other than the calibrated one.
        if self._has(*RECTIFIED) and (alpha is None or not self._has(*POSE)):
            return self.matrices

        cv2 = require("cv2", extra="rectify")
        k1, d1, k2, d2, r, t = (self.matrices[name] for name in (*INTRINSICS, *POSE))
        given = k1, d1, k2, d2, size, r, t
        share = -1.0 if alpha is None else alpha
        options = {"flags": cv2.CALIB_ZERO_DISPARITY}
        if self.fisheye:
            found = cv2.fisheye.stereoRectify(*given, **options, balance=max(share, 0.0))
        else:
            found = cv2.stereoRectify(*given, **options, alpha=share)

        return dict(zip(RECTIFIED, found[:4], strict=True))

    def _maps(self, size: tuple[int, int], poses: Mapping[str, Matrix]) -> Maps:
        if poses is self.matrices and self._is_straight():
            y, x = np.mgrid[: size[1], : size[0]].astype(np.float32)
            return (x, y), (x, y)

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


def _scaling(known: tuple[int, int], size: tuple[int, int]) -> Matrix:
    """Return the matrix that maps pixels of images of one size to those of another."""
    x, y = (new / old for new, old in zip(size, known, strict=True))
    # The center of the first pixel is (0, 0), its corner (-0.5, -0.5).
    return np.array([[x, 0, (x - 1) / 2], [0, y, (y - 1) / 2], [0, 0, 1]])


def _in_words(sizes: tuple[tuple[int, int], ...]) -> str:
    return " and ".join(f"{width} x {height}" for width, height in dict.fromkeys(sizes))


def q_of(left: Matrix, right: Matrix) -> Matrix | None:
    """Return OpenCV's matrix Q of two rectified cameras; None without a baseline.

    Raises
    ------
    ValueError
        If the left one is to the right of the other one, or below it.
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
    # By the focal length along the baseline: fy for a vertical one.
    q[3, 2:] = -focal / baseline, (left[axis, 2] - right[axis, 2]) * focal / baseline
    return q


def is_vertical(left: Matrix, right: Matrix) -> bool:
    """Return whether the projections place one rectified camera above the other."""
    if left.shape != (3, 4) or right.shape != (3, 4):
        return False

    # The last column of P is minus the baseline times the focal length.
    along, down = np.abs(right[:2, 3] - left[:2, 3])
    return bool(down > along)

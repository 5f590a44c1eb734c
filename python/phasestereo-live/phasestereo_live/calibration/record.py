"""A calibration: two cameras, their accuracy, and the views they come from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._extras import require
from phasestereo._numbers import as_number
from phasestereo.io.drafts import replace_text
from phasestereo.io.files import StrPath, suffix
from phasestereo.io.rigs.cameras import Matrix
from phasestereo_live.calibration.solving import (
    Lens,
    from_vector,
    projected_by,
    undistorted_by,
    vector,
)

CELLS = 6, 8
"""Rows and columns of the grid that counts coverage."""

_SUFFIXES = ".yaml", ".yml", ".xml"
_TURNS = "pitch", "yaw", "roll"
_STEP = 1e-3  # standard deviations: a step of the derivatives


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BoardView:
    """One pair of pictures, and its use in the calibration.

    Parameters
    ----------
    names
        The names of the left and the right picture: their files, or frames of a video.
    ids
        Numbers of the corners that both show, (N,), counted along the rows of the board.
    left, right
        Their positions, (N, 2), pixels; (0, 2) without corners.
    used
        Whether the calibration uses it.
    reason
        The reason if it does not, in words; else empty.
    error
        Root mean square distance of its corners from where the cameras see them, pixels. NaN if no
        board was found.
    rows
        Root mean square difference of their rows in the rectified pair, pixels.
    distance
        From the left camera to the middle of the corners, in the unit of T.
    tilt
        Angles between the board and the image plane, degrees: positive if its right edge is farther
        away than its left one, or its lower edge than its upper one.
    """

    names: tuple[str, str]
    ids: NDArray[np.int64]
    left: Matrix
    right: Matrix
    used: bool = False
    reason: str = ""
    error: float = np.nan
    rows: float = np.nan
    distance: float = np.nan
    tilt: tuple[float, float] = (np.nan, np.nan)


class DepthError(NamedTuple):
    """Standard deviations of depths, each (N,), in the unit of the distances.

    Attributes
    ----------
    distance
        The distances.
    disparity
        The part from an error of the disparity.
    focal, baseline, yaw
        The parts from the uncertainty of the calibration: of the focal lengths, of the position of
        the right camera, and of the directions of both (rotation, principal points, distortion).
        The calibration knows them better together than each alone, so `calibration` may be less
        than any of them.
    calibration
        All of these together.
    total
        Disparity and calibration.
    """

    distance: Matrix
    disparity: Matrix
    focal: Matrix
    baseline: Matrix
    yaw: Matrix
    calibration: Matrix
    total: Matrix


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StereoCalibration:
    """Two calibrated cameras, with OpenCV's names; `phasestereo.rectify` takes file or `matrices`.

    Parameters
    ----------
    K1, K2
        Camera matrices (3, 3), pixels.
    D1, D2
        Distortion, (1, 5) or (1, 8): k1, k2, p1, p2, k3 ... as in ``cv2.projectPoints``; for
        fisheyes (1, 4), as in ``cv2.fisheye``.
    R, T
        Rotation (3, 3) and translation (3, 1) from the left camera to the right one.
    size
        Columns and rows of the images.
    unit
        Unit of T and of distances: ``"m"``, or ``"squares"`` of the board if their size is unknown.
    board
        The board, in words.
    views
        All pairs, used and left out.
    error
        Root mean square distance of corners from where the cameras see them, pixels.
    rows
        Root mean square difference of rows of rectified corners, pixels.
    held_out
        The same for views outside the fit: each half with cameras fitted to the other half. None:
        too few views.
    covariance
        Of fx, fy, cx, cy and the distortion of the left camera, those of the right one, the vector
        of the rotation (``cv2.Rodrigues``) and T: 0 for parameters that are not fitted.
    coverage
        Corners in each cell of 6 x 8 of the left and of the right image, int (6, 8).
    advice
        The next pictures to take, a sentence each; empty if nothing is missing.
    fisheye
        Whether the lenses follow the model of ``cv2.fisheye``.

    Examples
    --------
    >>> rig = phasestereo_live.calibrate("boards", board="9x6", square=0.025)
    >>> rig.save("calibration.yaml")
    """

    K1: Matrix
    D1: Matrix
    K2: Matrix
    D2: Matrix
    R: Matrix
    T: Matrix
    size: tuple[int, int]
    unit: str
    board: str
    views: tuple[BoardView, ...]
    error: float
    rows: float
    held_out: float | None
    covariance: Matrix
    coverage: tuple[NDArray[np.int64], NDArray[np.int64]]
    advice: tuple[str, ...]
    fisheye: bool = False

    @property
    def lens(self) -> Lens:
        """The kind of the lenses."""
        return "fisheye" if self.fisheye else 8

    @property
    def matrices(self) -> dict[str, Any]:
        """The matrices under OpenCV's names, and the size."""
        found = {name: getattr(self, name) for name in ("K1", "D1", "K2", "D2", "R", "T")}
        model = {"distortion_model": "equidistant"} if self.fisheye else {}
        return found | {"image_width": self.size[0], "image_height": self.size[1]} | model

    @property
    def baseline(self) -> float:
        """Distance between the cameras, in the unit of T."""
        return float(np.linalg.norm(self.T))

    @property
    def angles(self) -> dict[str, float]:
        """Rotation of the right camera in degrees: ``pitch``, ``yaw``, ``roll`` (x, y, z)."""
        turns = np.degrees(vector(self.matrices)[-6:-3]).tolist()
        return dict(zip(_TURNS, turns, strict=True))

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviations of ``fx1`` ... ``cy2`` (pixels), ``baseline`` and the `angles`."""
        spread = np.sqrt(np.diag(self.covariance))
        one = (len(spread) - 6) // 2
        names = ("fx", "fy", "cx", "cy")
        found = {
            f"{name}{side + 1}": float(spread[side * one + at])
            for side in (0, 1)
            for at, name in enumerate(names)
        }
        along = self.T.ravel() / self.baseline
        found["baseline"] = float(np.sqrt(along @ self.covariance[-3:, -3:] @ along))
        turns = np.degrees(spread[-6:-3]).tolist()
        return found | dict(zip(_TURNS, turns, strict=True))

    def depth_error(self, distances: ArrayLike, disparity_error: float = 0.25) -> DepthError:
        """Return the expected depth errors of these cameras.

        At a depth Z an error e of the disparity causes a depth error of ``Z**2 / (f b) * e``. The
        error of the calibration follows from the covariance of all its numbers, for points in the
        middle half of the image. It does not include an error of the size of a square.

        Parameters
        ----------
        distances
            Depths (N,), above 0, in the unit of T.
        disparity_error
            Standard deviation of disparities, pixels, 0 or more.

        Returns
        -------
        DepthError

        Raises
        ------
        TypeError, ValueError
            If a number is invalid.
        """
        depths = np.atleast_1d(np.asarray(distances, dtype=np.float64)).ravel()
        if not (np.isfinite(depths) & (depths > 0)).all():
            raise ValueError(f"distances: got {distances!r}; accepts finite numbers above 0")
        spread = as_number("disparity_error", disparity_error, least=0)

        by_disparity = depths**2 / (self.K1[0, 0] * self.baseline) * spread
        gradients = self._gradients(depths)
        one = (len(self.covariance) - 6) // 2
        focal = [0, 1, one, one + 1]
        moved = list(range(2 * one + 3, 2 * one + 6))
        rest = sorted(set(range(2 * one + 6)) - {*focal, *moved})

        def part(which: Sequence[int]) -> Matrix:
            slope = gradients[..., which]
            cover = self.covariance[np.ix_(which, which)]
            variance = np.einsum("npi,ij,npj->np", slope, cover, slope)
            return np.sqrt(np.maximum(variance.mean(axis=1), 0))

        calibrated = part(range(2 * one + 6))
        total = np.hypot(by_disparity, calibrated)
        return DepthError(
            depths, by_disparity, part(focal), part(moved), part(rest), calibrated, total
        )

    def _gradients(self, depths: Matrix) -> Matrix:
        """Return the derivatives of depths by the cameras' numbers, (N, points, numbers)."""
        cv2 = require("cv2", extra="rectify")
        numbers = vector(self.matrices)
        steps = _STEP * np.sqrt(np.diag(self.covariance))
        x, y = np.meshgrid(*(np.array([0.25, 0.5, 0.75]) * side for side in self.size))
        pixels = np.stack([x.ravel(), y.ravel()], axis=1)
        rays = undistorted_by(self.lens, pixels, self.K1, self.D1)
        points = (depths[:, None, None] * rays).reshape(-1, 3)

        turn = cv2.Rodrigues(self.R)[0]
        left = np.tile(pixels, (len(depths), 1))
        right = projected_by(self.lens, points, (turn, self.T), self.K2, self.D2)[0]
        found = np.zeros((len(points), len(numbers)))
        for at in np.flatnonzero(steps):
            ends = []
            for sign in (1, -1):
                changed = numbers.copy()
                changed[at] += sign * steps[at]
                ends.append(_triangulated(from_vector(changed), left, right, self.lens))
            found[:, at] = (ends[0] - ends[1]) / (2 * steps[at])
        return found.reshape(len(depths), len(rays), -1)

    def save(self, path: StrPath) -> None:
        """Write the calibration in the format of ``cv2.FileStorage``, for `phasestereo.rectify`.

        Parameters
        ----------
        path
            ``.yaml``, ``.yml`` or ``.xml``.

        Raises
        ------
        ValueError
            If the suffix is different.
        OSError
            If the file cannot be written.
        """
        if suffix(path) not in _SUFFIXES:
            raise ValueError(f"path must end in {', '.join(_SUFFIXES)}, got {suffix(path)!r}")
        cv2 = require("cv2", extra="rectify")
        mode = cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY
        storage = cv2.FileStorage(suffix(path), mode)
        said: dict[str, Any] = {"unit": self.unit, "board": self.board}
        said |= {"reprojection_error": self.error, "row_error": self.rows}
        for name, value in (self.matrices | said).items():
            storage.write(name, value)
        replace_text(path, storage.releaseAndGetString())

    def __repr__(self) -> str:
        """Show the size and the errors, not the arrays."""
        used = sum(view.used for view in self.views)
        return (
            f"<StereoCalibration {self.size[0]}x{self.size[1]} from {used} of {len(self.views)} "
            f"views, corners to {self.error:.2f} px, rows to {self.rows:.2f} px>"
        )


def _triangulated(matrices: dict[str, Matrix], left: Matrix, right: Matrix, lens: Lens) -> Matrix:
    """Return the depths where rays of the left camera pass those of the right one closest."""
    rays = [
        undistorted_by(lens, places, matrices[f"K{side}"], matrices[f"D{side}"])
        for side, places in (("1", left), ("2", right))
    ]

    # Z (R a) + T lies along b: both cross products with b are opposite.
    across = np.cross(rays[0] @ matrices["R"].T, rays[1])
    moved = np.cross(matrices["T"].ravel(), rays[1])
    return -np.sum(moved * across, axis=1) / np.sum(across**2, axis=1)

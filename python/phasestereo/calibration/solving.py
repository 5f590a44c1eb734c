"""Cameras fitted to corners by OpenCV, and how exactly their numbers are known.

OpenCV gives standard deviations of one camera's numbers, not those of both cameras and of how they
stand to each other; so the covariance of them all is worked out here, from the derivatives that
OpenCV has: of the normal equations of all corners the poses of the board are eliminated (Schur's
complement), and the rest is inverted, times the variance of the corners' errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo.io.rigs.cameras import Matrix

_BETTER = 0.95  # of the error that a lens of fewer coefficients leaves, to take one of more


class Sight(NamedTuple):
    """Corners of a board that both cameras saw: on the board (N, 3), in pixels (N, 2)."""

    points: Matrix
    left: Matrix
    right: Matrix


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Fit:
    """Two cameras, and what they leave of the corners.

    Parameters
    ----------
    matrices
        ``K1``, ``D1``, ``K2``, ``D2``, ``R``, ``T``.
    poses
        Of the board before the left camera: a rotation's vector and a translation for each view.
    errors
        Root mean square distance of corners from where the cameras see them, each view, pixels.
    rows
        Root mean square difference of rows of the rectified corners, each view, pixels.
    covariance
        Of the numbers of `vector`.
    coefficients
        Of the distortion, that were fitted.
    """

    matrices: dict[str, Matrix]
    poses: list[tuple[Matrix, Matrix]]
    errors: Matrix
    rows: Matrix
    covariance: Matrix
    coefficients: int


def vector(matrices: dict[str, Matrix]) -> Matrix:
    """Return the numbers of both cameras: fx, fy, cx, cy, D of each, the rotation's vector, T."""
    rotation = require("cv2", extra="rectify").Rodrigues(matrices["R"])[0]
    cameras = [
        part
        for side in "12"
        for part in (
            matrices[f"K{side}"][(0, 1, 0, 1), (0, 1, 2, 2)],
            matrices[f"D{side}"].ravel(),
        )
    ]
    return np.concatenate([*cameras, rotation.ravel(), matrices["T"].ravel()])


def from_vector(numbers: Matrix) -> dict[str, Matrix]:
    """Return the matrices of which `vector` returns these numbers."""
    one = (len(numbers) - 6) // 2
    found = {}
    for side, part in zip("12", (numbers[:one], numbers[one : 2 * one]), strict=True):
        fx, fy, cx, cy = part[:4]
        found[f"K{side}"] = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        found[f"D{side}"] = part[4:].reshape(1, -1)
    rotation = require("cv2", extra="rectify").Rodrigues(numbers[-6:-3])[0]
    return found | {"R": rotation, "T": numbers[-3:].reshape(3, 1)}


def fit(sights: Sequence[Sight], size: tuple[int, int], coefficients: int | None = None) -> Fit:
    """Fit both cameras to what they saw.

    Parameters
    ----------
    sights
        Corners of each view.
    size
        Columns and rows of the images.
    coefficients
        Of the lenses' distortion: 4 (k1, k2, p1, p2), 5 (k3, too) or 8 (a ratio of polynomials).
        None: as few as leave no error that more would take away by a twentieth.

    Raises
    ------
    ValueError
        If OpenCV finds no cameras that saw this.
    """
    cv2 = require("cv2", extra="rectify")
    first, *others = (4, 5, 8) if coefficients is None else (coefficients,)
    try:
        found = _fitted(sights, size, first)
    except (cv2.error, np.linalg.LinAlgError) as error:
        raise ValueError("left: got views of which OpenCV makes no cameras") from error

    for count in others:
        try:
            more = _fitted(sights, size, count)
        except (cv2.error, np.linalg.LinAlgError):
            break
        if not rms(more.errors) < _BETTER * rms(found.errors):
            break
        found = more
    return found


def disagreement(sights: Sequence[Sight], size: tuple[int, int]) -> Matrix:
    """Return how far each view's corners are from where most views put the right camera, pixels.

    Each camera is fitted alone. In each view both then tell how they stand to each other; of all
    views' rotations and translations the medians are taken.
    """
    cv2 = require("cv2", extra="rectify")
    points, left, right = _as_lists(sights)
    known = [cv2.calibrateCamera(points, view, size, None, None)[1:] for view in (left, right)]
    relative = []
    for turn1, move1, turn2, move2 in zip(*known[0][2:4], *known[1][2:4], strict=True):
        between = cv2.Rodrigues(turn2)[0] @ cv2.Rodrigues(turn1)[0].T
        relative.append([*cv2.Rodrigues(between)[0].ravel(), *(move2 - between @ move1).ravel()])

    usual = np.median(relative, axis=0)
    errors = []
    for sight, turn, move in zip(sights, *known[0][2:4], strict=True):
        second = cv2.composeRT(turn.ravel(), move.ravel(), usual[:3], usual[3:])[:2]
        seen = cv2.projectPoints(sight.points, *second, *known[1][:2])[0].reshape(-1, 2)
        errors.append(np.sqrt(2) * rms(seen - sight.right))
    return np.array(errors)


def _as_lists(sights: Sequence[Sight]) -> list[list[NDArray[np.float32]]]:
    """Return points, left and right corners as OpenCV takes them."""
    parts = zip(*sights, strict=True)
    return [[np.asarray(view, dtype=np.float32) for view in part] for part in parts]


def rms(values: Matrix) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def _fitted(sights: Sequence[Sight], size: tuple[int, int], count: int) -> Fit:
    cv2 = require("cv2", extra="rectify")
    flags = {4: cv2.CALIB_FIX_K3, 5: 0, 8: cv2.CALIB_RATIONAL_MODEL}[count]
    points, left, right = _as_lists(sights)
    alone = [
        cv2.calibrateCamera(points, view, size, None, None, flags=flags)[1:3]
        for view in (left, right)
    ]
    (k1, d1), (k2, d2) = alone
    until = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-8)
    _, k1, d1, k2, d2, r, t, _, _, rotations, moves, _ = cv2.stereoCalibrateExtended(
        points, left, right, k1, d1, k2, d2, size, np.eye(3), np.zeros((3, 1)),
        flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS, criteria=until,
    )  # fmt: skip

    # Behind eight coefficients OpenCV has others, which are 0.
    d1, d2 = (np.asarray(d, dtype=np.float64).reshape(1, -1)[:, : max(count, 5)] for d in (d1, d2))
    found = {"K1": k1, "D1": d1, "K2": k2, "D2": d2, "R": r, "T": t}
    poses = list(zip(rotations, moves, strict=True))
    residuals, covariance = _residuals_and_covariance(sights, found, poses, count)
    return Fit(
        matrices=found,
        poses=poses,
        errors=np.array([np.sqrt(2 * np.mean(each**2)) for each in residuals]),
        rows=row_errors(found, sights, size),
        covariance=covariance,
        coefficients=count,
    )


def _residuals_and_covariance(
    sights: Sequence[Sight],
    matrices: dict[str, Matrix],
    poses: Sequence[tuple[Matrix, Matrix]],
    count: int,
) -> tuple[list[Matrix], Matrix]:
    """Return what is left of each view's corners, and the covariance of the cameras' numbers."""
    total = vector(matrices).size
    # OpenCV keeps five coefficients where four are fitted: k3 is 0, and known.
    one = (total - 6) // 2
    free = np.array([i for i in range(total) if i >= 2 * one or i % one < 4 + count])
    normal, residuals, coordinates = np.zeros((total, total)), [], 0

    for sight, pose in zip(sights, poses, strict=True):
        residual, shared, own = _derivatives(sight, matrices, pose)
        cross = shared.T @ own
        normal += shared.T @ shared - cross @ np.linalg.solve(own.T @ own, cross.T)
        residuals.append(residual)
        coordinates += residual.size

    known = normal[np.ix_(free, free)]
    scale = 1 / np.sqrt(np.diag(known))  # pixels and lengths are of different sizes
    inverse = np.linalg.inv(known * np.outer(scale, scale)) * np.outer(scale, scale)
    degrees = coordinates - len(free) - 6 * len(sights)
    variance = sum(float(np.sum(each**2)) for each in residuals) / degrees

    covariance = np.zeros((total, total))
    covariance[np.ix_(free, free)] = variance * inverse
    return residuals, covariance


def _derivatives(
    sight: Sight, matrices: dict[str, Matrix], pose: tuple[Matrix, Matrix]
) -> tuple[Matrix, Matrix, Matrix]:
    """Return a view's errors (4 N), and their derivatives by the cameras' numbers and the pose."""
    cv2 = require("cv2", extra="rectify")
    turn, move = pose
    relative = cv2.Rodrigues(matrices["R"])[0]
    composed = cv2.composeRT(turn, move, relative, matrices["T"])
    # Of the composed rotation and translation, by those of the board and of the right camera.
    by_pose, by_rig = (
        np.block([[composed[2 + at], composed[3 + at]], [composed[6 + at], composed[7 + at]]])
        for at in (0, 2)
    )

    count = matrices["D1"].size
    one, rows = 4 + count, 2 * len(sight.points)
    shared, own = np.zeros((2 * rows, 2 * one + 6)), np.zeros((2 * rows, 6))
    residual = np.zeros(2 * rows)
    seen = (sight.left, turn, move), (sight.right, composed[0], composed[1])
    for side, (places, rotation, translation) in enumerate(seen):
        k, d = matrices[f"K{side + 1}"], matrices[f"D{side + 1}"]
        projected, jacobian = cv2.projectPoints(sight.points, rotation, translation, k, d)
        part = slice(side * rows, (side + 1) * rows)
        residual[part] = projected.ravel() - places.ravel()
        shared[part, side * one : (side + 1) * one] = jacobian[:, 6 : 6 + one]
        own[part] = jacobian[:, :6] @ (by_pose if side else np.eye(6))
        if side:
            shared[part, -6:] = jacobian[:, :6] @ by_rig
    return residual, shared, own


def row_errors(
    matrices: dict[str, Any], sights: Sequence[Sight], size: tuple[int, int]
) -> NDArray[np.float64]:
    """Return by how much rows of rectified corners differ, root mean square, of each view."""
    cv2 = require("cv2", extra="rectify")
    k1, d1, k2, d2, r, t = (matrices[name] for name in ("K1", "D1", "K2", "D2", "R", "T"))
    r1, r2, p1, p2, *_ = cv2.stereoRectify(
        k1, d1, k2, d2, size, r, t, flags=cv2.CALIB_ZERO_DISPARITY
    )
    found = []
    for sight in sights:
        left = cv2.undistortPoints(sight.left.reshape(-1, 1, 2), k1, d1, R=r1, P=p1)
        right = cv2.undistortPoints(sight.right.reshape(-1, 1, 2), k2, d2, R=r2, P=p2)
        found.append(rms((left - right)[:, 0, 1]))
    return np.array(found)

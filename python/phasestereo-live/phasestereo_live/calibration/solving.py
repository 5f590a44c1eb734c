"""Fit cameras to corners with OpenCV, and compute the accuracy of their parameters.

OpenCV gives standard deviations of one camera's parameters, not of both cameras and their relative
pose. So this module computes the covariance of all of them from OpenCV's derivatives: it eliminates
the poses of the board from the normal equations of all corners (Schur's complement), inverts the
rest, and multiplies by the variance of the corners' errors.

Lenses of 120 degrees and more follow the model of `cv2.fisheye`. Its own `calibrate` does not start
if boards are far from the axis (an assertion of OpenCV 5.0 fails in 55 views of up to 70 degrees).
So this module fits them with the same normal equations, damped (Levenberg and Marquardt), and
starts from rays of an equidistant lens.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo.io.rigs.cameras import Matrix

Lens: TypeAlias = Literal[4, 5, 8, "fisheye"]
"""Coefficients of distortion (k1, k2, p1, p2; k3; a ratio of polynomials), or `cv2.fisheye`."""

ROWS_OVER = 3.0
"""Largest error of rows, as a multiple of that of corners: it is about equal if cameras fit."""

FITS = 0.5
"""Pixels: the fit always keeps views whose corners are off by less."""

_STARTS = 0.5, 0.7, 1.0, 1.4  # focal lengths of fisheyes, in multiples of that for 180 degrees
_STEPS, _STILL = 100, 1e-9  # of a fit: steps at most, and the relative change that ends it
_BETTER = 0.95  # of the error with fewer coefficients: the limit for using more


class Sight(NamedTuple):
    """Corners of a board that both cameras saw: on the board (N, 3), in pixels (N, 2)."""

    points: Matrix
    left: Matrix
    right: Matrix


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Fit:
    """Two cameras, and the remaining errors of the corners.

    Parameters
    ----------
    matrices
        ``K1``, ``D1``, ``K2``, ``D2``, ``R``, ``T``.
    poses
        Poses of the board before the left camera: a rotation's vector and a translation for each
        view.
    errors
        Root mean square distance of corners from where the cameras see them, for each view, pixels.
    rows
        Root mean square difference of rows of the rectified corners, for each view, pixels.
    covariance
        Covariance of the numbers of `vector`.
    lens
        The fitted lens.
    """

    matrices: dict[str, Matrix]
    poses: list[tuple[Matrix, Matrix]]
    errors: Matrix
    rows: Matrix
    covariance: Matrix
    lens: Lens


def vector(matrices: dict[str, Matrix]) -> Matrix:
    """Return the numbers of both cameras: fx, fy, cx, cy, D for each, the rotation's vector, T."""
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
    """Return the matrices from these numbers; the inverse of `vector`."""
    one = (len(numbers) - 6) // 2
    found = {}
    for side, part in zip("12", (numbers[:one], numbers[one : 2 * one]), strict=True):
        fx, fy, cx, cy = part[:4]
        found[f"K{side}"] = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        found[f"D{side}"] = part[4:].reshape(1, -1)
    rotation = require("cv2", extra="rectify").Rodrigues(numbers[-6:-3])[0]
    return found | {"R": rotation, "T": numbers[-3:].reshape(3, 1)}


def fit(sights: Sequence[Sight], size: tuple[int, int], lens: Lens | None = None) -> Fit:
    """Fit both cameras to their corners.

    Parameters
    ----------
    sights
        Corners of each view.
    size
        Columns and rows of the images.
    lens
        Coefficients of the lenses' distortion, or "fisheye". None: the fewest, unless more reduce
        the error by a twentieth; a fisheye if these leave corners, or rows of rectified corners,
        far off, and it explains them better.

    Raises
    ------
    ValueError
        If OpenCV finds no cameras for these corners.
    """
    cv2 = require("cv2", extra="rectify")
    lenses: tuple[Lens, ...] = (4, 5, 8) if lens is None else (lens,)
    try:
        found = _fitted(sights, size, lenses[0])
    except (cv2.error, np.linalg.LinAlgError) as error:
        raise ValueError("left: got views of which OpenCV makes no cameras") from error

    for other in lenses[1:]:
        try:
            more = _fitted(sights, size, other)
        except (cv2.error, np.linalg.LinAlgError):
            break
        if not rms(more.errors) < _BETTER * rms(found.errors):
            break
        found = more
    if lens is not None or not is_far_off(found):
        return found
    try:
        wide = _fitted(sights, size, "fisheye")
    except (cv2.error, np.linalg.LinAlgError):
        return found
    return min(found, wide, key=lambda one: max(rms(one.errors), rms(one.rows) / ROWS_OVER))


def is_far_off(found: Fit) -> bool:
    """Return whether the errors of corners or rows are too large for this kind of lens."""
    error, rows = rms(found.errors), rms(found.rows)
    return error > FITS or rows > max(ROWS_OVER * error, FITS)


def disagreement(sights: Sequence[Sight], size: tuple[int, int]) -> Matrix:
    """Return each view's corner error, given the right camera's pose in most views, pixels.

    This function fits each camera alone. Each view then gives their relative pose; the pose used is
    the median of all views' rotations and translations.
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
    """Return points, left and right corners in OpenCV's form."""
    parts = zip(*sights, strict=True)
    return [[np.asarray(view, dtype=np.float32) for view in part] for part in parts]


def rms(values: Matrix) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def _fitted(sights: Sequence[Sight], size: tuple[int, int], lens: Lens) -> Fit:
    found, poses = _fisheyes(sights, size) if lens == "fisheye" else _cameras(sights, size, lens)
    residuals, covariance = _residuals_and_covariance(sights, found, poses, lens)
    return Fit(
        matrices=found,
        poses=poses,
        errors=np.array([np.sqrt(2 * np.mean(each**2)) for each in residuals]),
        rows=row_errors(found, sights, size, lens),
        covariance=covariance,
        lens=lens,
    )


def _cameras(
    sights: Sequence[Sight], size: tuple[int, int], count: int
) -> tuple[dict[str, Matrix], list[tuple[Matrix, Matrix]]]:
    """Return OpenCV's cameras with this number of coefficients, and the board's poses."""
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

    # After eight coefficients OpenCV has more, which are 0.
    d1, d2 = (np.asarray(d, dtype=np.float64).reshape(1, -1)[:, : max(count, 5)] for d in (d1, d2))
    found = {"K1": k1, "D1": d1, "K2": k2, "D2": d2, "R": r, "T": t}
    return found, list(zip(rotations, moves, strict=True))


def _fisheyes(
    sights: Sequence[Sight], size: tuple[int, int]
) -> tuple[dict[str, Matrix], list[tuple[Matrix, Matrix]]]:
    """Return the fisheyes with the smallest sum of squares, and the board's poses."""
    starts = [_start(sights, size, share * size[0] / np.pi) for share in _STARTS]
    numbers, poses = min(starts, key=lambda one: _squares(sights, *one))
    least, damping = _squares(sights, numbers, poses), 1e-3

    for _ in range(_STEPS):
        matrices = from_vector(numbers)
        parts = [_derivatives(*one, matrices, "fisheye") for one in zip(sights, poses, strict=True)]
        while True:
            trial = _stepped(numbers, poses, parts, damping)
            squares = _squares(sights, *trial)
            if squares < least or damping > 1e8:
                break
            damping *= 10
        if not squares < least:
            break
        is_still = least - squares < _STILL * least
        (numbers, poses), least, damping = trial, squares, damping / 10
        if is_still:
            break
    return from_vector(numbers), poses


def _start(
    sights: Sequence[Sight], size: tuple[int, int], focal: float
) -> tuple[Matrix, list[tuple[Matrix, Matrix]]]:
    """Return the numbers and poses of equidistant lenses, from the rays of the corners."""
    cv2 = require("cv2", extra="rectify")
    middle = (np.array(size) - 1) / 2
    relative, poses = [], []
    for sight in sights:
        (turn, move), (second, shift) = (
            _facing(sight.points, places, middle, focal) for places in (sight.left, sight.right)
        )
        between = second @ turn.T
        relative.append([*cv2.Rodrigues(between)[0].ravel(), *(shift - between @ move)])
        poses.append((cv2.Rodrigues(turn)[0], move.reshape(3, 1)))
    camera = [focal, focal, *middle, 0, 0, 0, 0]
    return np.array([*camera, *camera, *np.median(relative, axis=0)]), poses


def _facing(points: Matrix, places: Matrix, middle: Matrix, focal: float) -> tuple[Matrix, Matrix]:
    """Return the rotation and the place of a plane from rays through its points (DLT)."""
    flat = (places - middle) / focal
    angle = np.linalg.norm(flat, axis=1, keepdims=True)
    rays = np.column_stack([flat * np.sinc(angle / np.pi), np.cos(angle)])
    # Each ray is parallel to H (x, y, 1), with H of two columns of the rotation and the place.
    plane = np.column_stack([points[:, :2], np.ones(len(points))])
    skew = np.cross(rays[:, np.newaxis], np.eye(3))  # for a ray r: rows (r x e), so that r x v = 0
    equations = np.einsum("nij,nk->nijk", skew, plane).reshape(-1, 9)
    h = np.linalg.svd(equations, full_matrices=False)[2][-1].reshape(3, 3)
    h *= np.sign(np.einsum("ni,ij,nj->", rays, h, plane)) or 1
    first, second, place = (h / np.linalg.norm(h[:, :2], axis=0).mean()).T
    u, _, v = np.linalg.svd(np.column_stack([first, second, np.cross(first, second)]))
    return u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v, place


def _squares(
    sights: Sequence[Sight], numbers: Matrix, poses: Sequence[tuple[Matrix, Matrix]]
) -> float:
    """Return the sum of squares of fisheyes; infinite if they see nothing."""
    matrices = from_vector(numbers)
    parts = [_derivatives(*one, matrices, "fisheye")[0] for one in zip(sights, poses, strict=True)]
    total = float(sum(np.sum(part**2) for part in parts))
    return total if np.isfinite(total) else np.inf


def _stepped(
    numbers: Matrix,
    poses: Sequence[tuple[Matrix, Matrix]],
    parts: Sequence[tuple[Matrix, Matrix, Matrix]],
    damping: float,
) -> tuple[Matrix, list[tuple[Matrix, Matrix]]]:
    """Return the numbers and poses after a damped least-squares step that eliminates the poses."""
    normal, slope = np.zeros((numbers.size, numbers.size)), np.zeros(numbers.size)
    own = []
    for residual, shared, pose in parts:
        block = pose.T @ pose
        block += damping * np.diag(np.diag(block))
        cross = np.linalg.solve(block, np.column_stack([pose.T @ shared, pose.T @ residual]))
        normal += shared.T @ shared - shared.T @ pose @ cross[:, :-1]
        slope += shared.T @ residual - shared.T @ pose @ cross[:, -1]
        own.append(cross)
    normal += damping * np.diag(np.diag(normal))
    change = -np.linalg.solve(normal, slope)
    moved = []
    for (turn, move), cross in zip(poses, own, strict=True):
        step = (-cross[:, -1] - cross[:, :-1] @ change).reshape(6, 1)
        moved.append((turn + step[:3], move + step[3:]))
    return numbers + change, moved


def _residuals_and_covariance(
    sights: Sequence[Sight],
    matrices: dict[str, Matrix],
    poses: Sequence[tuple[Matrix, Matrix]],
    lens: Lens,
) -> tuple[list[Matrix], Matrix]:
    """Return each view's residuals, and the covariance of the cameras' parameters."""
    total = vector(matrices).size
    # OpenCV keeps five coefficients even if it fits four: k3 is 0, and known.
    one = (total - 6) // 2
    count = 4 if lens == "fisheye" else lens
    free = np.array([i for i in range(total) if i >= 2 * one or i % one < 4 + count])
    normal, residuals, coordinates = np.zeros((total, total)), [], 0

    for sight, pose in zip(sights, poses, strict=True):
        residual, shared, own = _derivatives(sight, pose, matrices, lens)
        cross = shared.T @ own
        normal += shared.T @ shared - cross @ np.linalg.solve(own.T @ own, cross.T)
        residuals.append(residual)
        coordinates += residual.size

    known = normal[np.ix_(free, free)]
    scale = 1 / np.sqrt(np.diag(known))  # pixels and lengths have different magnitudes
    inverse = np.linalg.inv(known * np.outer(scale, scale)) * np.outer(scale, scale)
    degrees = coordinates - len(free) - 6 * len(sights)
    variance = sum(float(np.sum(each**2)) for each in residuals) / degrees

    covariance = np.zeros((total, total))
    covariance[np.ix_(free, free)] = variance * inverse
    return residuals, covariance


def _derivatives(
    sight: Sight, pose: tuple[Matrix, Matrix], matrices: dict[str, Matrix], lens: Lens
) -> tuple[Matrix, Matrix, Matrix]:
    """Return a view's errors (4 N) and their derivatives by the cameras' numbers and the pose."""
    cv2 = require("cv2", extra="rectify")
    turn, move = pose
    relative = cv2.Rodrigues(matrices["R"])[0]
    composed = cv2.composeRT(turn, move, relative, matrices["T"])
    # Derivatives of the composed rotation and translation by the board's and the right camera's.
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
        projected, jacobian = projected_by(lens, sight.points, (rotation, translation), k, d)
        part = slice(side * rows, (side + 1) * rows)
        residual[part] = projected.ravel() - places.ravel()
        shared[part, side * one : (side + 1) * one] = jacobian[:, 6 : 6 + one]
        own[part] = jacobian[:, :6] @ (by_pose if side else np.eye(6))
        if side:
            shared[part, -6:] = jacobian[:, :6] @ by_rig
    return residual, shared, own


def projected_by(
    lens: Lens, points: Matrix, pose: tuple[Matrix, Matrix], k: Matrix, d: Matrix
) -> tuple[Matrix, Matrix]:
    """Return a lens's projections, (N, 2), and derivatives in the order of `cv2.projectPoints`.

    That order is the rotation's vector, the translation, fx, fy, cx, cy and the distortion.
    """
    cv2 = require("cv2", extra="rectify")
    if lens != "fisheye":
        seen, jacobian = cv2.projectPoints(points, *pose, k, d)
        return seen.reshape(-1, 2), jacobian
    shaped = np.reshape(points, (1, -1, 3)).astype(np.float64)
    turn, move = (np.ascontiguousarray(part) for part in pose)
    seen, jacobian = cv2.fisheye.projectPoints(shaped, turn, move, k, d)
    return seen.reshape(-1, 2), jacobian[:, [*range(8, 14), *range(8)]]


def undistorted_by(lens: Lens, places: Matrix, k: Matrix, d: Matrix) -> Matrix:
    """Return a lens's rays at pixels, (N, 3), with 1 as their last number."""
    cv2 = require("cv2", extra="rectify")
    model = cv2.fisheye if lens == "fisheye" else cv2
    flat = model.undistortPoints(np.reshape(places, (-1, 1, 2)), k, d).reshape(-1, 2)
    return np.column_stack([flat, np.ones(len(flat))])


def row_errors(
    matrices: dict[str, Any], sights: Sequence[Sight], size: tuple[int, int], lens: Lens
) -> NDArray[np.float64]:
    """Return the root mean square difference of rows of rectified corners for each view.

    For fisheyes, whose rectified images do not end, it is the angle between the right camera's ray
    and the plane of the left one's ray and the baseline, times the focal length.
    """
    if lens == "fisheye":
        return np.array([_off_plane(matrices, sight) for sight in sights])
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


def _off_plane(matrices: dict[str, Any], sight: Sight) -> float:
    """Return the distances of fisheye rays from each other's epipolar planes, pixels rms."""
    left, right = (
        undistorted_by("fisheye", places, matrices[f"K{side}"], matrices[f"D{side}"])
        for side, places in (("1", sight.left), ("2", sight.right))
    )
    left, right = left @ matrices["R"].T, right / np.linalg.norm(right, axis=1, keepdims=True)
    across = np.cross(matrices["T"].ravel(), left)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    focal = matrices["K1"][1, 1]
    return rms(focal * np.arcsin(np.clip(np.sum(across * right, axis=1), -1, 1)))

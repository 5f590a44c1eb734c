"""Pictures of boards before two cameras that are known, rendered for the tests."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo_live.calibration.solving import Sight
from support import counterpart

cv2 = counterpart("cv2")

SIZE = 640, 480
SQUARE = 0.03  # meters
LARGE = 0.055  # of ChArUco boards: markers have to be seen
RIG: dict[str, NDArray[np.float64]] = {
    "K1": np.array([[600, 0, 322], [0, 601, 235], [0, 0, 1.0]]),
    "D1": np.array([[-0.12, 0.05, 0.0005, -0.0004, 0.0]]),
    "K2": np.array([[606, 0, 316], [0, 607, 243], [0, 0, 1.0]]),
    "D2": np.array([[-0.10, 0.04, -0.0003, 0.0005, 0.0]]),
    "R": cv2.Rodrigues(np.radians([0.4, -0.9, 0.7]))[0],
    "T": np.array([[-0.12], [0.002], [0.001]]),
}
_SHARP = 40  # pixels of a square of the board's own picture


def poses(count: int) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return rotations' vectors and the places of the middle of a board, all over the images."""
    rng = np.random.default_rng(7)
    found = []
    for number in range(count):
        depth = rng.uniform(0.6, 0.95)
        x, y = (number % 4 - 1.5) / 1.5, (number // 4 % 3 - 1)
        middle = np.array([x * 0.17 * depth + 0.06, y * 0.17 * depth, depth])
        turn = np.radians([*rng.uniform(15, 35, 2) * rng.choice([-1, 1], 2), rng.uniform(-10, 10)])
        found.append((turn, middle))
    return found


def sights(
    count: int, rng: np.random.Generator, *, noise: float, columns: int = 9, rows: int = 6
) -> list[Sight]:
    """Return corners as the cameras see them, with errors of this standard deviation."""
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    points: Any = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) * SQUARE
    middle = points.mean(axis=0)
    found = []
    for turn, place in poses(count):
        move = place - cv2.Rodrigues(turn)[0] @ middle
        second = cv2.composeRT(turn, move, cv2.Rodrigues(RIG["R"])[0].ravel(), RIG["T"].ravel())[:2]
        left: Any = cv2.projectPoints(points, turn, move, RIG["K1"], RIG["D1"])[0][:, 0]
        right: Any = cv2.projectPoints(points, *second, RIG["K2"], RIG["D2"])[0][:, 0]
        errors = rng.normal(0, noise, (2, *left.shape))
        found.append(Sight(points, left + errors[0], right + errors[1]))
    return found


FISHEYES: dict[str, NDArray[np.float64]] = {
    "K1": np.array([[200, 0, 321], [0, 201, 238], [0, 0, 1.0]]),
    "D1": np.array([[-0.01, 0.004, -0.002, 0.0005]]),
    "K2": np.array([[203, 0, 317], [0, 204, 243], [0, 0, 1.0]]),
    "D2": np.array([[-0.012, 0.005, -0.0022, 0.0004]]),
    "R": RIG["R"],
    "T": RIG["T"],
}
"""Lenses that see 180 degrees in the width of the image."""


def wide_sights(count: int, rng: np.random.Generator, *, noise: float) -> list[Sight]:
    """Return corners as fisheyes see them, up to 70 degrees off the axis."""
    x, y = np.meshgrid(np.arange(9), np.arange(6))
    points: Any = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) * SQUARE
    found: list[Sight] = []
    while len(found) < count:
        angle, around = np.radians(rng.uniform(0, 70)), rng.uniform(0, 2 * np.pi)
        ahead = np.array([
            np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)
        ])  # fmt: skip
        across = np.cross([0, 1, 0], ahead) / np.hypot(ahead[0], ahead[2])
        facing = np.column_stack([across, np.cross(ahead, across), ahead])
        tilts = np.radians([*rng.uniform(15, 35, 2) * rng.choice([-1, 1], 2), rng.uniform(-10, 10)])
        rotation = facing @ cv2.Rodrigues(tilts)[0]
        move = (ahead * rng.uniform(0.2, 0.45) - rotation @ points.mean(axis=0)).reshape(3, 1)
        turn = cv2.Rodrigues(rotation)[0]
        second = cv2.composeRT(turn, move, cv2.Rodrigues(FISHEYES["R"])[0], FISHEYES["T"])[:2]

        views = []
        for side, pose in (("1", (turn, move)), ("2", second)):
            k, d = FISHEYES[f"K{side}"], FISHEYES[f"D{side}"]
            seen = cv2.fisheye.projectPoints(points[np.newaxis], *pose, k, d)[0][0]
            depth = points @ cv2.Rodrigues(pose[0])[0][2] + pose[1][2]
            if ((seen < 0) | (seen > SIZE)).any() or depth.min() < 0.02:
                break
            views.append(seen + rng.normal(0, noise, seen.shape))
        if len(views) == 2:
            found.append(Sight(points, *views))
    return found


def chessboard(columns: int, rows: int) -> NDArray[np.uint8]:
    """Return the picture of a chessboard with this many inner corners, a white square around it."""
    y, x = np.mgrid[: rows + 3, : columns + 3]
    inside = (x > 0) & (y > 0) & (x < columns + 2) & (y < rows + 2)
    squares = np.where(inside & ((x + y) % 2 == 0), 30, 220).astype(np.uint8)
    return np.kron(squares, np.ones((_SHARP, _SHARP), np.uint8))


def charuco(columns: int, rows: int, dictionary: str) -> NDArray[np.uint8]:
    """Return the picture of a ChArUco board of this many squares, a white square around it."""
    words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    board = cv2.aruco.CharucoBoard((columns, rows), 1.0, 0.75, words)
    made = board.generateImage((columns * _SHARP, rows * _SHARP), marginSize=0)
    return np.asarray(np.pad(made, _SHARP, constant_values=255))


def pairs(
    board: NDArray[np.uint8], count: int, square: float = SQUARE, *, tilted: float = 1
) -> list[tuple[Any, Any]]:
    """Return pictures of a board by both cameras, with a little noise."""
    rng = np.random.default_rng(1)
    extent = np.array([board.shape[1], board.shape[0]]) / _SHARP
    made = []
    for turn, place in poses(count):
        rotation = cv2.Rodrigues(turn * tilted)[0]
        # The corner of the picture, so that its middle is at that place.
        corner = place - rotation @ np.array([*(extent / 2 * square), 0])
        plane = np.column_stack([rotation[:, :2] * square / _SHARP, corner])
        right = RIG["R"] @ plane
        right[:, 2] += RIG["T"][:, 0]
        views = []
        for side, seen in (("1", plane), ("2", right)):
            image = _seen(board, seen, side)
            noisy = image + rng.normal(0, 2, image.shape)
            views.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
        made.append((views[0], views[1]))
    return made


@cache
def _rays(side: str) -> Any:
    """Return the direction that each pixel of a camera sees, (N, 3)."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    pixels = np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float64)
    found = cv2.undistortPoints(pixels.reshape(-1, 1, 2), RIG[f"K{side}"], RIG[f"D{side}"])[:, 0]
    return np.column_stack([found, np.ones(len(found))])


def _seen(board: Any, plane: Any, side: str) -> Any:
    """Return a board's picture as a camera sees it."""
    places = _rays(side) @ np.linalg.inv(plane).T
    at = (places[:, :2] / places[:, 2:] - 0.5).astype(np.float32).reshape(SIZE[1], SIZE[0], 2)
    smooth = cv2.GaussianBlur(board, None, 1.5)  # of two of its pixels one is seen
    return cv2.remap(smooth, at, None, cv2.INTER_LINEAR, borderValue=128).astype(np.float64)

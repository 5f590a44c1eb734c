"""Find chessboards and ChArUco boards in pictures with OpenCV, in one order in both views."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo._numbers import as_integer, as_number

_LEAST, _MOST = 3, 64  # corners along a side
_FEWEST = 8  # corners that both views of a pair must share
_WINDOW = 0.3  # of a square, either way
_MARKER = 0.75  # of a square, if a marker's length is not given


class Corners(NamedTuple):
    """Corners found in one picture: their numbers (N,), and their positions (N, 2), pixels."""

    ids: NDArray[np.int64]
    places: NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """A flat board with corners in a grid.

    Parameters
    ----------
    size
        Corners along and across: for a chessboard the inner ones, for a ChArUco board the ones
        between its squares. None: unknown, for chessboards.
    square
        Side of a square; 1 if unknown.
    marker
        Side of a marker of a ChArUco board, in the same unit.
    dictionary
        Name of the markers' dictionary, as ``"DICT_5X5_100"``; None: a chessboard.
    """

    size: tuple[int, int] | None
    square: float = 1.0
    marker: float = _MARKER
    dictionary: str | None = None

    def __str__(self) -> str:
        """Describe the board as ``--board`` and ``--charuco`` do."""
        if self.size is None:
            return "chessboard"
        cols, rows = self.size
        if self.dictionary is not None:
            return f"ChArUco board of {cols + 1} x {rows + 1} squares, {self.dictionary}"
        return f"chessboard of {cols} x {rows} inner corners"

    def points(self, ids: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the corners' positions on the board, (N, 3), in the unit of `square`."""
        cols = 1 if self.size is None else self.size[0]
        grid = np.stack([ids % cols, ids // cols, np.zeros_like(ids)], axis=1)
        return grid * self.square

    def find(self, image: NDArray[np.uint8]) -> Corners | None:
        """Return the corners in a gray picture after a quick search, or None if it shows no board.

        For a chessboard of unknown size, ids count along rows of the detected size.
        """
        if self.dictionary is not None:
            return self._find_charuco(image)

        grid = self.grid(image, thorough=False)
        return None if grid is None else as_ordered(grid, self)

    def grid(
        self, image: NDArray[np.uint8], *, thorough: bool = True
    ) -> NDArray[np.float64] | None:
        """Return the corners of a chessboard, (rows, columns, 2), as if it faced us."""
        cv2 = require("cv2", extra="rectify")
        size, larger = self.size or (_LEAST, _LEAST), 0 if self.size else cv2.CALIB_CB_LARGER
        for more in (0, cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE)[: 1 + thorough]:
            found, places, kinds = cv2.findChessboardCornersSBWithMeta(image, size, larger | more)
            if found:
                return _right_handed(places.reshape(*kinds.shape[:2], 2).astype(np.float64))
        return None

    def measure(self, image: NDArray[np.uint8]) -> list[Corners]:
        """Return the corners in a gray picture, once for each way to measure them.

        OpenCV's finder measures corners of real prints, a little out of focus, better than the
        gradients around them do, but it measures corners of small squares worse.
        """
        if self.dictionary is not None:
            found = self._find_charuco(image)
            return [] if found is None else [found]

        # Without a size, the thorough search takes textures for boards, of any size.
        grid = None if self.size is None else self.grid(image)
        if grid is None:
            return []
        return [as_ordered(each, self) for each in (grid, self._refined(image, grid))]

    def _refined(self, image: NDArray[np.uint8], grid: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a chessboard's corners, placed by the gradients around them."""
        cv2 = require("cv2", extra="rectify")
        steps = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)]
        half = max(int(_WINDOW * min(steps)), 2)
        until = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-4)
        start = grid.reshape(-1, 1, 2).astype(np.float32)
        found = cv2.cornerSubPix(image, start, (half, half), (-1, -1), until)
        return found.reshape(grid.shape).astype(np.float64)

    def is_mirrored(self, image: NDArray[np.uint8]) -> bool:
        """Return whether a picture shows a mirrored board, which only markers reveal."""
        return self.dictionary is not None and self.find(image[:, ::-1].copy()) is not None

    def _find_charuco(self, image: NDArray[np.uint8]) -> Corners | None:
        cv2 = require("cv2", extra="rectify")
        cols, rows = self.size or (0, 0)
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, str(self.dictionary)))

        # Boards printed by OpenCV before 4.6 begin with another square if the number of rows is
        # even.
        for is_old in (False, True) if rows % 2 else (False,):
            board = cv2.aruco.CharucoBoard(
                (cols + 1, rows + 1), float(self.square), float(self.marker), dictionary
            )
            board.setLegacyPattern(is_old)
            places, ids, *_ = cv2.aruco.CharucoDetector(board).detectBoard(image)
            if ids is not None and len(ids) >= _FEWEST:
                return Corners(ids.ravel().astype(np.int64), places.reshape(-1, 2).astype(float))
        return None


def as_board(
    board: str | tuple[int, int] | None,
    square: float | None,
    charuco: str | None,
    marker: float | None,
) -> Board:
    """Return the requested board.

    Raises
    ------
    TypeError, ValueError
        If no such board exists; the message begins with the argument.
    """
    side = 1.0 if square is None else as_number("square", square, positive=True)
    size = None if board is None else _as_size(board)
    if charuco is None:
        if marker is not None:
            raise ValueError("marker: has no effect without charuco; accepts None then")
        return Board(size=size, square=side)

    aruco = require("cv2", extra="rectify").aruco
    names = [name for name in dir(aruco) if name.startswith("DICT_")]
    if charuco not in names:
        raise ValueError(f"charuco: got {charuco!r}; accepts {', '.join(names)}")
    if size is None:
        raise ValueError("board: got None; accepts the squares of a ChArUco board, such as '8x5'")

    length = _MARKER * side if marker is None else as_number("marker", marker, positive=True)
    if square is None and marker is not None:
        raise ValueError("square: got None beside marker; accepts the side of a square")
    if not length < side:
        raise ValueError(f"marker: got {length:g}; accepts less than the square's {side:g}")
    inner = size[0] - 1, size[1] - 1
    return Board(size=inner, square=side, marker=length, dictionary=charuco)


def _as_size(board: str | tuple[int, int]) -> tuple[int, int]:
    if isinstance(board, str):
        match = re.fullmatch(r"\s*([0-9]{1,3})\s*[xX]\s*([0-9]{1,3})\s*", board)
        if match is None:
            raise ValueError(f"board: got {board!r}; accepts corners as '9x6', or None to look")
        board = int(match[1]), int(match[2])

    if not isinstance(board, tuple) or len(board) != 2:
        raise TypeError(f"board: got {board!r}; accepts '9x6', (9, 6) or None")
    cols, rows = (as_integer("board", side, least=_LEAST, most=_MOST) for side in board)
    return cols, rows


def common_size(
    grids: Iterable[NDArray[np.float64] | None], least: int = 1
) -> tuple[int, int] | None:
    """Return the columns and rows that most pictures of one chessboard show, longer side first.

    Return None if fewer pictures than `least` show one size.
    """
    shapes = [tuple(sorted(grid.shape[:2])) for grid in grids if grid is not None]
    counts = Counter(shapes)
    # For equal counts, take the larger size: a hidden row makes a board smaller.
    shape = max(counts, key=lambda shape: (counts[shape], shape), default=None)
    return None if shape is None or counts[shape] < least else (shape[1], shape[0])


def as_ordered(grid: NDArray[np.float64], board: Board) -> Corners:
    """Return a grid's corners by their numbers on a board, or on the grid if no size is known."""
    if board.size is not None and grid.shape[1::-1] != board.size:
        grid = _right_handed(grid.swapaxes(0, 1))
    return Corners(np.arange(grid[..., 0].size), grid.reshape(-1, 2))


def matched(board: Board, left: Corners, right: Corners) -> tuple[Corners, Corners] | None:
    """Return the corners that both views show, in the same order, or None if there are too few.

    A chessboard looks the same after half a turn, a square one after a quarter, and a finder may
    begin anywhere. This function takes the order that turns the board least between both views.
    That is right for cameras turned by less than 90 (45) degrees to each other.
    """
    if board.dictionary is None:
        return left, _turned_like(board, left, right)

    ids, first, second = np.intersect1d(left.ids, right.ids, return_indices=True)
    points = board.points(ids)
    if len(ids) < _FEWEST or np.linalg.matrix_rank(points - points[0]) < 2:
        return None
    return Corners(ids, left.places[first]), Corners(ids, right.places[second])


def _turned_like(board: Board, left: Corners, right: Corners) -> Corners:
    cols, rows = board.size or (0, 0)
    grid = right.places.reshape(rows, cols, 2)
    turns = range(4) if rows == cols else (0, 2)
    orders = [np.rot90(grid, turn).reshape(-1, 2) for turn in turns]

    middle = left.places - left.places.mean(axis=0)
    alike = [float(np.sum(middle * (order - order.mean(axis=0)))) for order in orders]
    return Corners(left.ids, orders[int(np.argmax(alike))])


def flipped(board: Board, view: Corners, like: Corners, ends: NDArray[np.float64]) -> Corners:
    """Return a chessboard's corners as if the picture had been flipped.

    Parameters
    ----------
    board
        The board.
    view
        Its corners.
    like
        The corners in the other view, which set the order.
    ends
        The last column and row if the picture flips these, else 0: (2,).
    """
    cols, rows = board.size or (0, 0)
    places = np.where(ends > 0, ends - view.places, view.places)
    grid = _right_handed(places.reshape(rows, cols, 2))
    return _turned_like(board, like, Corners(view.ids, grid.reshape(-1, 2)))


def _right_handed(grid: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a grid whose columns run to the right of its rows, as on a board that faces us."""
    along = grid[0, -1] - grid[0, 0] + grid[-1, -1] - grid[-1, 0]
    down = grid[-1, 0] - grid[0, 0] + grid[-1, -1] - grid[0, -1]
    return grid if along[0] * down[1] - along[1] * down[0] > 0 else grid[:, ::-1]

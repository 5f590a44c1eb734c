"""Make a calibration from pictures of a board: find it, check it, fit cameras, drop misfits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo.io.files import StrPath
from phasestereo.io.pair import Layout
from phasestereo.io.rigs.cameras import Matrix
from phasestereo_live.calibration.advising import advice, coverage
from phasestereo_live.calibration.boards import (
    Board,
    Corners,
    as_board,
    common_size,
    flipped,
    matched,
)
from phasestereo_live.calibration.record import BoardView, StereoCalibration
from phasestereo_live.calibration.solving import (
    FITS,
    ROWS_OVER,
    Fit,
    Lens,
    Sight,
    disagreement,
    fit,
    rms,
    row_errors,
)
from phasestereo_live.calibration.sources import BoardPaths, Gray, Shot, shots

LEAST_VIEWS = 6
_HALVES = 12  # views: with this many, test each half against the other
_OUTLIER = 3.0  # of the median error of views
_UNFIT = 2.0  # pixels: corners of a rig are never off by this much
_SAME = 0.5  # pixels: corners of one picture differ by less if it is compressed again
_AGREEING, _EARLY = 4, 16  # pictures that show one size of board; pairs to search for it
_NAMED = 5  # views to name in a message


def calibrate(
    left: BoardPaths,
    right: StrPath | None = None,
    *,
    board: str | tuple[int, int] | None = None,
    square: float | None = None,
    charuco: str | None = None,
    marker: float | None = None,
    layout: Layout | None = None,
) -> StereoCalibration:
    """Calibrate two cameras from pictures of a board that both see.

    Parameters
    ----------
    left
        One of these:

        - A folder of pairs: with folders ``left`` and ``right`` (or ``cam0`` and ``cam1``), or with
          files whose names say ``left`` and ``right`` or ``L`` and ``R``.
        - A folder of the left camera's pictures, with `right`.
        - A video of both views beside each other, or of the left camera, with `right`.
        - A list of pairs of images, as in `phasestereo.match`.
    right
        The right camera's folder or video: the same number of pictures, or the same names; frames
        of the same moments.
    board
        For a chessboard, its inner corners, ``"9x6"`` or ``(9, 6)``; for a ChArUco board, its
        squares. None: a chessboard of the size that most pictures show.
    square
        Side of a square in meters; all lengths are then in meters. None: lengths are in squares.
    charuco
        Dictionary of a ChArUco board's markers, such as ``"DICT_5X5_100"``. None: a chessboard.
    marker
        Side of a marker of a ChArUco board, meters. None: three quarters of a square.
    layout
        How each picture of a folder, or of a video, holds both views: ``"side-by-side"`` or
        ``"top-bottom"``. None: a picture of a folder holds one view, and a single video holds both
        side by side.

    Returns
    -------
    StereoCalibration

    Raises
    ------
    TypeError
        If an argument has the wrong type.
    ValueError
        If fewer than 6 pairs show the board in both views (the message names some of the others),
        pictures differ in size, both views come from the same camera, left and right are swapped,
        one is mirrored, no two cameras could see what the pictures show, or the error in rows of
        the rectified pair would be three times the error of corners.
    OSError
        If a folder or a video cannot be read.
    ImportError
        If the extra ``rectify`` is not installed.

    Notes
    -----
    OpenCV's ``findChessboardCornersSB`` [1]_, or its ChArUco detector, finds the board. Its
    ``stereoCalibrate`` fits the cameras, all numbers together, after Zhang [2]_; if that leaves
    errors in rows, the lenses are fitted with the model of ``cv2.fisheye``. Views whose error is
    more than three times the median are left out, one at a time.

    References
    ----------
    .. [1] A. Duda and U. Frese, *Accurate Detection and Localization of Checkerboard Corners for
       Calibration*, BMVC 2018.
    .. [2] Z. Zhang, *A Flexible New Technique for Camera Calibration*, PAMI 2000.

    Examples
    --------
    >>> rig = phasestereo_live.calibrate("boards", board="9x6", square=0.025)
    >>> rig.save("calibration.yaml")
    """
    wanted = as_board(board, square, charuco, marker)
    taken = shots(left, right, layout, lambda image: _places(wanted, image))
    known, ways, size = _look(taken, wanted)
    _check_same(ways[0])

    # Take the way to measure corners that leaves the smaller error.
    fits = [_fit_without_outliers(known, views, size) for views in ways]
    views, fitted = min(fits, key=lambda found: float(np.median(found[1].errors)))
    _check_rig(fitted, known, views, size)
    return _record(known, views, size, fitted, unit="squares" if square is None else "m")


def _places(board: Board, image: Gray) -> NDArray[np.float64] | None:
    found = board.find(image)
    return None if found is None else found.places


class _Look(NamedTuple):
    """The corners of a pair of pictures, for each way to measure them, or why it shows none."""

    names: tuple[str, str]
    found: tuple[tuple[Corners, Corners], ...] = ()
    reason: str = ""


def _look(
    taken: Iterator[Shot], board: Board
) -> tuple[Board, list[list[BoardView]], tuple[int, int]]:
    """Find the board in all pictures.

    Returns the board with its size, the views for each way to measure corners, and the columns and
    rows of the pictures.
    """
    size, looks = None, []
    board, taken = _sized(board, taken)
    for shot in taken:
        if shot.images is None:
            looks.append(_Look(shot.names, reason=shot.reason))
        else:
            size = _checked_size(shot.names, shot.images, size)
            looks.append(_looked(shot.names, shot.images, board))

    count = 1 if board.dictionary else 2
    ways = [[_view(look, board, way) for look in looks] for way in range(count)]

    views = ways[0]
    good = sum(len(view.left) > 0 for view in views)
    if good < LEAST_VIEWS or size is None:
        reasons = [view.reason for view in views if len(view.left) == 0]
        more = f"and {len(reasons) - _NAMED} more" if len(reasons) > _NAMED else ""
        why = "; ".join(filter(None, [*reasons[:_NAMED], more]))
        hint = "; without a given board its size is found"
        if board.size is None:
            hint = f"; give its inner corners, as 9x6, if the first {_EARLY} pairs do not show it"
        raise ValueError(
            f"left: the {board} is found in both views of {good} of {len(views)} pairs; accepts "
            f"{LEAST_VIEWS} or more"
            + ("" if good or board.dictionary else hint)
            + (f": {why}" if why else "")
        )
    return board, ways, size


def _sized(board: Board, taken: Iterator[Shot]) -> tuple[Board, Iterator[Shot]]:
    """Return a board with the size of the first ones found, and all pictures."""
    early: list[Shot] = []
    size, grids = board.size, []
    while size is None and len(early) < _EARLY:
        shot = next(taken, None)
        if shot is None:
            break
        early.append(shot)
        grids += [board.grid(image, thorough=False) for image in shot.images or ()]
        size = common_size(grids, least=_AGREEING)
    return replace(board, size=size or common_size(grids)), chain(early, taken)


def _checked_size(
    names: tuple[str, str], images: tuple[Gray, Gray], size: tuple[int, int] | None
) -> tuple[int, int]:
    """Return the columns and rows of both pictures; refuse a size unlike the earlier ones."""
    cols, rows = size or images[0].shape[::-1]
    for name, image in zip(names, images, strict=True):
        if image.shape != (rows, cols):
            raise ValueError(
                f"{name}: got {image.shape[1]} x {image.shape[0]} pixels; accepts {cols} x {rows}, "
                "as of the pictures before it"
            )
    return cols, rows


def _looked(names: tuple[str, str], images: tuple[Gray, Gray], board: Board) -> _Look:
    left, right = (board.measure(image) for image in images)
    if left and right:
        return _Look(names, tuple(zip(left, right, strict=True)))

    at = 1 if left else 0
    said = f"no board is found in {names[at]}"
    if board.is_mirrored(images[at]):
        said = f"{names[at]} is mirrored: its markers are found in a mirror"
    return _Look(names, reason=said)


def _view(look: _Look, board: Board, way: int) -> BoardView:
    """Return a view with the corners that both pictures show, or the reason why it has none."""
    none = np.zeros((0, 2))
    empty = BoardView(names=look.names, ids=np.zeros(0, np.int64), left=none, right=none)
    if not look.found:
        return replace(empty, reason=look.reason)

    corners = look.found[way]
    both = matched(board, *corners)
    if both is None:
        said = f"{look.names[0]} and {look.names[1]} show too few corners in common"
        return replace(empty, reason=said)
    return replace(empty, ids=both[0].ids, left=both[0].places, right=both[1].places, used=True)


def _check_same(views: Sequence[BoardView]) -> None:
    """Refuse views from one camera: two cameras never have all corners on the same pixels."""
    apart = [np.median(np.abs(view.left - view.right)) for view in views if view.used]
    if np.median(apart) < _SAME:
        names = next(view.names for view in views if view.used)
        raise ValueError(
            f"{names[0]} and {names[1]}: both views are the same camera's, with corners on the "
            "same pixels; accepts those of two cameras"
        )


def _sights(board: Board, views: Sequence[BoardView]) -> list[Sight]:
    return [Sight(board.points(view.ids), view.left, view.right) for view in views]


def _fit_without_outliers(
    board: Board, views: Sequence[BoardView], size: tuple[int, int]
) -> tuple[list[BoardView], Fit]:
    """Fit the cameras; leave out the worst view while it is far worse than the others."""
    kept = list(views)
    fitted, lens = None, None
    while True:
        used = [at for at, view in enumerate(kept) if view.used]
        sights = _sights(board, [kept[at] for at in used])
        fitted = fit(sights, size, lens)

        # False pairs distort the fit of all cameras; the pose of most views resists them. Views
        # that are a little off bend the fit, too: leave out only the worst one at a time.
        fits = rms(fitted.errors) < _UNFIT
        errors = fitted.errors if fits else disagreement(sights, size)
        usual = float(np.median(errors))
        far = errors > max(_OUTLIER * usual, FITS)
        if fits:
            far &= errors == errors.max()
        if not far.any() or len(used) - far.sum() < LEAST_VIEWS:
            return kept, fitted

        lens = fitted.lens if fits else None
        for at, error in zip(np.array(used)[far].tolist(), errors[far].tolist(), strict=True):
            said = f"{' and '.join(kept[at].names)} are off by {error:.2f} px, others by "
            said += f"{usual:.2f} px"
            kept[at] = replace(kept[at], used=False, reason=said, error=error)


def _check_rig(
    fitted: Fit, board: Board, views: Sequence[BoardView], size: tuple[int, int]
) -> None:
    """Refuse cameras that cannot be a rig, and say what is wrong with the pictures."""
    used = [view for view in views if view.used]
    files = f"{used[0].names[0]} and {used[0].names[1]}, for example"
    error = rms(fitted.errors)
    if error > _UNFIT:
        if flip := _flips(board, used, size, error):
            raise ValueError(f"{files}: one camera's pictures are {flip}; turn that off")
        raise ValueError(
            f"{files}: no two cameras see this, corners are off by {error:.1f} px: pairs are not "
            "of the same moment, files are not in the same order, or the cameras moved"
        )
    rows = rms(fitted.rows)
    if rows > max(ROWS_OVER * error, FITS):
        raise ValueError(
            f"{files}: rows of the rectified pair would be off by {rows:.2f} px, where corners are "
            f"off by {error:.2f} px: no lens that OpenCV knows fits; show the board up to the "
            "edges of both images"
        )

    x, y, z = (float(part) for part in fitted.matrices["T"].ravel())
    if np.linalg.norm((x, y, z)) < 3 * np.sqrt(np.trace(fitted.covariance[-3:, -3:])):
        raise ValueError(
            f"{files}: these views do not show how far apart the cameras are: tilt the board, and "
            "move it, between them (or both views are one camera's)"
        )
    if abs(y) > abs(x):
        raise ValueError(
            f"{files}: one camera is above the other; accepts cameras side by side: turn the "
            "pictures by 90 degrees"
        )
    if x > 0:
        raise ValueError(
            f"{files}: the left camera is on the right of the other one: exchange left and right "
            "(or both are mirrored)"
        )


def _flips(board: Board, used: Sequence[BoardView], size: tuple[int, int], error: float) -> str:
    """Return the fault of one camera's pictures, if corners fit far better without that fault."""
    if board.dictionary is not None:  # the finder misses such markers, or they show the fault
        return ""

    found = {}
    for word, sides in (("mirrored", (1, 0)), ("upside down", (1, 1))):
        ends = (np.array(size) - 1.0) * sides
        views = [
            replace(
                view,
                right=flipped(
                    board, Corners(view.ids, view.right), Corners(view.ids, view.left), ends
                ).places,
            )
            for view in used
        ]
        found[word] = rms(fit(_sights(board, views), size, 4).errors)
    best = min(found, key=lambda word: found[word])
    return best if found[best] < error / 3 else ""


def _record(
    board: Board, views: Sequence[BoardView], size: tuple[int, int], fitted: Fit, *, unit: str
) -> StereoCalibration:
    used = [view for view in views if view.used]
    sights = _sights(board, used)
    poses, errors = iter(fitted.poses), iter(fitted.errors.tolist())
    rows = iter(fitted.rows.tolist())
    done = tuple(
        _posed(replace(view, error=next(errors), rows=next(rows)), board, next(poses))
        if view.used
        else view
        for view in views
    )

    covered = (
        coverage((view.left for view in used), size),
        coverage((view.right for view in used), size),
    )
    one = (len(fitted.covariance) - 6) // 2
    focal = max(
        float(np.sqrt(fitted.covariance[at, at]) / fitted.matrices[name][0, 0])
        for at, name in ((0, "K1"), (one, "K2"))
    )
    far = max(view.distance for view in done if view.used)
    baseline = float(np.linalg.norm(fitted.matrices["T"]))
    said = advice(
        done,
        covered,
        error=rms(fitted.errors),
        focal=focal,
        parallax=float(fitted.matrices["K1"][0, 0]) * baseline / far / size[0],
        unit=unit,
    )
    return StereoCalibration(
        **fitted.matrices,
        size=size,
        unit=unit,
        board=str(board),
        views=done,
        error=rms(fitted.errors),
        rows=rms(fitted.rows),
        fisheye=fitted.lens == "fisheye",
        held_out=_held_out(sights, size, fitted.lens),
        covariance=fitted.covariance,
        coverage=covered,
        advice=said,
    )


def _posed(view: BoardView, board: Board, pose: tuple[Matrix, Matrix]) -> BoardView:
    """Return a view with the distance and the tilt of its board."""
    rotation = require("cv2", extra="rectify").Rodrigues(pose[0])[0]
    middle = rotation @ board.points(view.ids).mean(axis=0) + pose[1].ravel()
    normal = rotation[:, 2] * np.sign(rotation[2, 2])
    across, down = np.degrees(np.arctan2(-normal[:2], normal[2])).tolist()
    return replace(view, distance=float(np.linalg.norm(middle)), tilt=(across, down))


def _held_out(sights: Sequence[Sight], size: tuple[int, int], lens: Lens) -> float | None:
    """Return the difference of rows in views, for cameras fitted to the other views."""
    if len(sights) < _HALVES:
        return None
    halves = sights[::2], sights[1::2]
    rows = [
        row_errors(fit(halves[at], size, lens).matrices, halves[1 - at], size, lens)
        for at in (0, 1)
    ]
    return rms(np.concatenate(rows))

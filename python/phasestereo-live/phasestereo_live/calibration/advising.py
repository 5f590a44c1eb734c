"""The coverage of views of a board, and the next pictures to take."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from phasestereo_live.calibration.record import CELLS, BoardView

_ENOUGH = 12  # views
_TILTED = 15.0  # degrees that some views should be tilted each way
_NEARER = 1.5  # times the nearest distance: the farthest one should reach it
_KNOWN = 0.003  # of the focal length: its standard deviation
_SHARP = 0.5  # pixels: the fit of corners in good pictures
_THIN = 1 / 2  # of the cells of a part of the image should have corners
_MARGIN = 1.5  # disparities: a board ends some way beyond its corners

_PARTS = {"upper": slice(0, 2), "middle": slice(2, 4), "lower": slice(4, 6)}
_SIDES = {"left": slice(0, 3), "middle": slice(3, 5), "right": slice(5, 8)}


def coverage(places: Iterable[NDArray[np.float64]], size: tuple[int, int]) -> NDArray[np.int64]:
    """Count the corners in each of 6 x 8 cells of an image of this size."""
    every = np.concatenate([np.zeros((0, 2)), *places])
    counted = np.histogram2d(
        every[:, 1], every[:, 0], bins=CELLS, range=((0, size[1]), (0, size[0]))
    )[0]
    return counted.astype(np.int64)


def advice(
    views: Sequence[BoardView],
    covered: Sequence[NDArray[np.int64]],
    *,
    error: float,
    focal: float,
    parallax: float,
    unit: str,
) -> tuple[str, ...]:
    """Return advice on the next pictures, a sentence each.

    Parameters
    ----------
    views
        The views to judge.
    covered
        The `coverage` of each image.
    error
        Root mean square error of corners, pixels.
    focal
        Standard deviation of the worse focal length, as a share of it.
    parallax
        Disparity of the farthest board, as a share of the width: the right image does not show a
        strip this wide at the left of the left image, and vice versa.
    unit
        Unit of distances: "m", or "squares" if the size of a square is unknown.
    """
    used = [view for view in views if view.used]
    said = []
    if len(used) < _ENOUGH:
        said.append(f"take more pairs: {len(used)} were used, {_ENOUGH} to 20 do")
    center = (np.arange(CELLS[1]) + 0.5) / CELLS[1]
    for cells, name in zip(covered, ("left", "right"), strict=True):
        inward = center if name == "left" else 1 - center
        if empty := _empty(cells, inward > _MARGIN * parallax):
            where = ", ".join(empty[:-1]) + (" and " if empty[:-1] else "") + empty[-1]
            said.append(f"take views with the board {where} of the {name} image")
    said += _poses(used, unit)
    if focal > _KNOWN:
        said.append(
            f"the focal length is known to {100 * focal:.1f} % only: take views with the board "
            "tilted by 30 to 45 degrees, near enough to fill half of the image"
        )
    if error > _SHARP:
        said.append(
            f"corners fit to {error:.2f} px only: the board must be flat, the pictures sharp, and "
            "both taken at the same moment; lenses that see more than 120 degrees need another "
            "model (Kalibr's equi)"
        )
    if unit == "squares":
        said.append("give the side of a square, or lengths are known in squares alone")
    return tuple(said)


def _empty(cells: NDArray[np.int64], shared: NDArray[np.bool_]) -> list[str]:
    """Return the parts of an image with corners in few cells of the columns that both show."""
    found = []
    for part, rows in _PARTS.items():
        for side, columns in _SIDES.items():
            there = cells[rows, columns][:, shared[columns]] > 0
            if there.size == 0 or there.mean() >= _THIN:
                continue
            if part != "middle" and side != "middle":
                found.append(f"in the {part} {side} corner")
            elif part == side:
                found.append("in the middle")
            else:
                found.append(f"at the {part if side == 'middle' else side} edge")
    return found


def _poses(used: Sequence[BoardView], unit: str) -> list[str]:
    said = []
    tilts = np.abs([view.tilt for view in used]).max(axis=0)
    for tilt, one, other in zip(tilts, ("left", "upper"), ("right", "lower"), strict=True):
        if tilt < _TILTED:
            said.append(
                f"tilt the board by about 30 degrees, its {one} edge nearer, then its {other} one "
                f"(so far {tilt:.0f} degrees at most)"
            )

    near, far = (end(view.distance for view in used) for end in (min, max))
    if far < _NEARER * near:
        said.append(
            "take some views from nearer and some from farther away (so far from "
            f"{near:.3g} to {far:.3g} {unit})"
        )
    return said

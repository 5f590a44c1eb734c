"""Two cameras of which nothing is known but that they look about the same way.

Thirteen numbers, each with what it usually is::

    focal length, and the ratio of both       around 0.85 widths, within a third or so
    radial distortion k1, k2; difference in k1
    principal points                          the center, within 1.5 % of the width
    rotations: yaw and roll of both cameras, pitch of one against the other

The pitch that both share moves all rows alike: it is left at 0. Small numbers that the images
do not determine, as the focal length where the view is narrow, stay what they usually are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from phasestereo._extras import require
from phasestereo.rectification.cameras import Maps, Matrix
from phasestereo.rectification.features import Matches, Points

Shifts = tuple[tuple[float, float], tuple[float, float]]

_FOCAL = 0.85  # of the width
_ITERATIONS = 15  # to undo a distortion
_USUAL = {
    "focal": 0.35,
    "ratio": 0.03,
    "k1": 0.2,
    "k2": 0.08,
    "k1 differs": 0.02,
    "column left": 0.015,
    "row left": 0.015,
    "column right": 0.015,
    "row right": 0.015,
    "yaw left": 0.07,
    "roll left": 0.07,
    "pitch": 0.1,
    "yaw right": 0.07,
    "roll right": 0.07,
}
"""Standard deviations: of logarithms for focal lengths, of widths, of radians."""

SIZE = len(_USUAL)
DISTORTION = list(_USUAL).index("k1")
_SPREADS = np.array(list(_USUAL.values()))


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A camera pair by its numbers, each as a multiple of its usual deviation.

    Parameters
    ----------
    numbers
        (SIZE,), all 0 for the usual pair.
    size
        Columns and rows of the images.
    """

    numbers: Points
    size: tuple[int, int]

    def rows(self, matches: Matches) -> Points:
        """Return by how many rows matches of raw images differ once they are rectified."""
        left, right = self.rectified(matches)
        difference: Points = left[:, 1] - right[:, 1]
        return difference

    def rectified(self, matches: Matches) -> Matches:
        """Return where things of the raw images are in the rectified ones."""
        cv2 = require("cv2", extra="rectify")
        options = {"criteria": (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, _ITERATIONS, 1e-7)}
        undo = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)  # its name before OpenCV 5

        left, right = (
            undo(points[:, np.newaxis], k, d, R=r, P=self.target, **options)[:, 0]
            for points, (k, d, r) in zip(matches, self.cameras(), strict=True)
        )
        return left, right

    def maps(self, shifts: Shifts = ((0, 0), (0, 0))) -> Maps:
        """Return maps that rectify the images.

        Parameters
        ----------
        shifts
            Columns and rows by which the left and the right image are moved after that.
        """
        cv2 = require("cv2", extra="rectify")
        left, right = (
            cv2.initUndistortRectifyMap(k, d, r, _moved(self.target, by), self.size, cv2.CV_32FC1)
            for by, (k, d, r) in zip(shifts, self.cameras(), strict=True)
        )
        return left, right

    def shifts(self, matches: Matches) -> Shifts:
        """Return the shifts that leave things where they were, at the median of these matches.

        Rows are moved alike. Columns are moved each by themselves: what moves all disparities, as
        toed-in cameras do, is hardly known from rows, so disparities stay about as they are.
        """
        (left, right), rectified = matches, self.rectified(matches)

        columns = [
            float(np.median((old - new)[:, 0])) for old, new in zip(matches, rectified, strict=True)
        ]
        rows = float(np.median((left + right - rectified[0] - rectified[1])[:, 1])) / 2
        return (columns[0], rows), (columns[1], rows)

    @property
    def folds(self) -> bool:
        """Whether the distortion shows some things twice, as that of no lens does."""
        # The distorted radius r (1 + k1 r^2 + k2 r^4) must grow with r: its slope is positive.
        radius = np.hypot(*self.size) / 2 / self._focal * np.linspace(0, 1, 20)
        return any(
            bool((1 + 3 * d[0] * radius**2 + 5 * d[1] * radius**4 <= 0).any())
            for _, d, _ in self.cameras()
        )

    @property
    def target(self) -> Matrix:
        """Intrinsics of both rectified cameras."""
        cols, rows = self.size
        focal = self._focal
        return np.array([[focal, 0, (cols - 1) / 2], [0, focal, (rows - 1) / 2], [0, 0, 1]])

    @property
    def _focal(self) -> float:
        return float(_FOCAL * self.size[0] * np.exp(_SPREADS[0] * self.numbers[0]))

    def cameras(self) -> list[tuple[Matrix, Matrix, Matrix]]:
        """Return intrinsics, distortion and rotation of the left and of the right camera."""
        values = dict(zip(_USUAL, _SPREADS * self.numbers, strict=True))
        return [self._camera(values, "left", -0.5), self._camera(values, "right", 0.5)]

    def _camera(
        self, values: dict[str, Any], side: str, sign: float
    ) -> tuple[Matrix, Matrix, Matrix]:
        turn = require("cv2", extra="rectify").Rodrigues
        cols, rows = self.size
        focal = self._focal * np.exp(sign * values["ratio"])
        column = (cols - 1) / 2 + cols * values[f"column {side}"]
        row = (rows - 1) / 2 + cols * values[f"row {side}"]
        intrinsics = np.array([[focal, 0, column], [0, focal, row], [0, 0, 1]])
        distortion = np.array([values["k1"] + sign * values["k1 differs"], values["k2"], 0, 0])

        angles = sign * values["pitch"], values[f"yaw {side}"], values[f"roll {side}"]
        pitch, yaw, roll = (
            turn(angle * axis)[0] for angle, axis in zip(angles, np.eye(3), strict=True)
        )
        return intrinsics, distortion, pitch @ yaw @ roll


def _moved(target: Matrix, shift: tuple[float, float]) -> Matrix:
    moved = target.copy()
    moved[:2, 2] += shift
    return moved

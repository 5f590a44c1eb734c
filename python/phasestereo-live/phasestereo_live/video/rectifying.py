"""Rectify the frames of a stream one after another, all in the same way as the first."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike, NDArray

from phasestereo._images import ImageOrPath
from phasestereo.io.rigs.cameras import Cameras, Matrix
from phasestereo.io.rigs.reading import CalibrationSource
from phasestereo.rectification.record import Rectification, read_calibration
from phasestereo.rectification.rectifying import rectify

AUTO = "auto"


class Rectifier:
    """Rectifies pairs of the same cameras.

    Parameters
    ----------
    calibration
        A calibration for `rectify`, or `Cameras`; "auto": the first pair with enough detail in its
        images.
    masks
        Masks of the raw images, left and right.

    Raises
    ------
    OSError, TypeError, ValueError
        If the calibration does not exist or is invalid.
    """

    def __init__(
        self,
        calibration: CalibrationSource | Rectification | Cameras,
        masks: tuple[ArrayLike | None, ArrayLike | None],
    ) -> None:
        self._masks = masks
        self._calibration = None if calibration == AUTO else read_calibration(calibration)
        self._found: Rectification | None = None

    def pair(self, left: ImageOrPath, right: ImageOrPath) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return the rectified pair.

        Raises
        ------
        TypeError, ValueError
            As in `rectify`.
        """
        if self._found is not None:
            return self._found.apply(left, right)

        left_mask, right_mask = self._masks
        self._found = rectify(
            left, right, self._calibration, left_mask=left_mask, right_mask=right_mask
        )
        return self._found.left, self._found.right

    @property
    def found(self) -> Rectification | None:
        """The rectification, once a pair is good enough for one."""
        return self._found

    @property
    def q(self) -> Matrix | None:
        """OpenCV's matrix Q of the rectified pairs, if known."""
        return None if self._found is None else self._found.Q

    @property
    def vertical(self) -> bool | None:
        """Whether the right camera is below the left one; None: before the first rectified pair."""
        return None if self._found is None else self._found.vertical

    @property
    def masks(self) -> dict[str, Any]:
        """The valid pixels of the rectified pairs, for `phasestereo.match`."""
        if self._found is None:
            return {}
        return {"left_mask": self._found.left_mask, "right_mask": self._found.right_mask}

"""What is done to the left image: motion, Gaussian blur, and areas of different degradations."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from phasestereo_bench.degradation import Degradation, areas, disk_psf, gaussian_psf, motion_psf

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Kernel = NDArray[np.float64]
    Image = NDArray[Any]

__all__ = ["CONTRAST", "GRID", "Blur", "Kind", "box_psf"]

Kind = Literal["motion x", "motion y", "gauss", "areas"]

CONTRAST = Degradation(gain=0.6, offset=20)
"""The contrast change of some of the areas of the third experiment."""

GRID = np.add.outer(np.arange(4), np.arange(4)) % 4
"""Which areas: contrast changed, in motion, as it was, out of focus."""

_ANGLES = {"motion x": 0, "motion y": 90}


@dataclass(frozen=True, slots=True)
class Blur:
    """A degradation of the left image.

    Parameters
    ----------
    kind
        Motion along a row or a column, Gaussian blur, or areas of different degradations.
    amount
        Length in pixels, standard deviation in pixels, or the blur factor: motion of that length
        along x, and a disk of that diameter. Motion of 1 and a Gaussian of 0 change nothing.
    recipe
        ``"paper"``: motion is a box of `amount` pixels and there is no noise. ``"suite"``: as the
        one-sided-blur suite has it, motion of n being a path of n - 1 pixels between the centres
        of pixels, a disk's radius (n - 1) / 2, and noise of 1 gray level being added.
    """

    kind: Kind
    amount: float
    recipe: Literal["paper", "suite"] = "paper"

    def __call__(self, image: Image) -> Image:
        """Return the degraded image, of the same shape and type."""
        noise = 1.0 if self.recipe == "suite" else 0.0
        if self.kind != "areas":
            return Degradation(self._psf(), noise=noise)(image)
        versions: list[Callable[[Image], Image]] = [
            CONTRAST,
            Degradation(self._motion(0)),
            Degradation(),
            Degradation(self._disk()),
        ]
        return areas(image, GRID, versions, noise=noise)

    def _psf(self) -> Kernel:
        return (
            gaussian_psf(self.amount) if self.kind == "gauss" else self._motion(_ANGLES[self.kind])
        )

    def _motion(self, angle: int) -> Kernel:
        path: Callable[[float], Kernel] = partial(motion_psf, angle=angle)
        if self.recipe == "suite":
            return path(self.amount)
        box = box_psf(self.amount)
        return box.T if angle else box

    def _disk(self) -> Kernel:
        return disk_psf((self.amount - (self.recipe == "suite")) / 2)


def box_psf(length: float) -> Kernel:
    """Point-spread function of a motion along x over exactly `length` pixels.

    Each tap is the share of the path over its pixel: for an odd whole number of pixels, as many
    equal taps. Its transform has its first zero at the frequency 1 / length.

    Parameters
    ----------
    length
        Pixels, at least 1.

    Returns
    -------
    ndarray
        float64 (1, odd), sum 1.
    """
    reach = int(np.ceil((length - 1) / 2))
    distance = np.abs(np.arange(-reach, reach + 1))
    taps = np.clip(length / 2 - (distance - 0.5), 0, 1)
    return np.asarray(taps / taps.sum())[np.newaxis]

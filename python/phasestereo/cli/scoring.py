"""The ground truth that ``phasestereo match`` scores against."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter, validators
from numpy.typing import NDArray

from phasestereo._images import Map
from phasestereo.cli.errors import option, wrong
from phasestereo.io import read_disparity, read_truth
from phasestereo.io.image import read_mask
from phasestereo.metrics import Score, bad_pixels, score

_FLOATS = {".pfm", ".npy"}  # never gray-coded


@dataclass(frozen=True, slots=True, kw_only=True)
class Scoring:
    """The options that give the ground truth.

    Parameters
    ----------
    truth
        Disparities to score against: .pfm, .npy, .tif, KITTI's .png. Or any gray image, with
        ``--truth-scale``.
    truth_scale
        Gray levels per pixel of disparity; 0 is unknown. 4 for Middlebury's cones and teddy.
    truth_mask
        Image of the pixels to score. Default: all with known truth.
    truth_mask_level
        Lowest gray level of the mask that counts: 255 for Middlebury's mask0nocc.png. Default 1.
    """

    truth: Path | None = None
    truth_scale: Annotated[float | None, Parameter(validator=validators.Number(gt=0))] = None
    truth_mask: Path | None = None
    truth_mask_level: Annotated[int | None, Parameter(validator=validators.Number(gte=1))] = None

    def check(self) -> None:
        """Refuse options that have no effect."""
        needed = {"truth_mask_level": "truth_mask"}
        for field in fields(self):
            other = needed.get(field.name, "truth")
            if getattr(self, field.name) is not None and getattr(self, other) is None:
                raise wrong(field.name, f"has no effect without {option(other)}")

    def sources(self) -> list[Path | None]:
        """Return the files to read."""
        return [self.truth, self.truth_mask]

    def read(self, size: tuple[int, ...]) -> "Truth | None":
        """Read the truth of images of this size, and the mask of pixels to score.

        Raises
        ------
        OSError, ValueError
            If a file is invalid or has another size, or no pixel is left to score.
        """
        if self.truth is None:
            return None

        truth = self._read_truth(self.truth)
        mask = read_mask(self.truth_mask, level=self.truth_mask_level or 1)

        for path, array in ((self.truth, truth), (self.truth_mask, mask)):
            if array is not None and array.shape != size:
                raise ValueError(f"{path}: got {array.shape} pixels; accepts the images' {size}")

        bad_pixels(truth, truth, 0, mask)  # raises if there is nothing to score
        return Truth(truth, mask)

    def _read_truth(self, path: Path) -> Map:
        if self.truth_scale is not None:
            return read_truth(path, scale=self.truth_scale)
        try:
            return read_disparity(path)
        except ValueError as error:
            if path.suffix.lower() in _FLOATS:
                raise
            raise ValueError(f"{error}: does it need --truth-scale?") from error


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """True disparities, NaN where unknown, and the pixels to score (None: all)."""

    disparity: Map
    mask: NDArray[np.bool_] | None

    def score(self, estimate: Map) -> Score:
        """Return all scores of an estimate."""
        return score(estimate, self.disparity, mask=self.mask)

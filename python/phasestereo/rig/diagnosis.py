"""The diagnosis of a pair: what keeps it from being matched well, before it is matched.

Here belongs the order of the measurements and the record of their results. Each is made elsewhere:
`phasestereo.rig.estimation` and `phasestereo.rig.photometry`; what they mean is put into words in
`phasestereo.rig.findings`.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from phasestereo._core import LEAST_SIZE, packed_pair
from phasestereo._images import opened_pair
from phasestereo._numbers import as_json
from phasestereo.rig import findings
from phasestereo.rig.estimation import estimate_pair
from phasestereo.rig.photometry import fractions, low_texture, saturation

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from phasestereo._images import ImageOrPath, Pixels
    from phasestereo.rig.alignment import Alignment
    from phasestereo.rig.blur import BlurEstimate
    from phasestereo.rig.findings import Finding
    from phasestereo.rig.photometry import Saturation
    from phasestereo.rig.search_range import SearchRange

__all__ = ["Contrast", "Diagnosis", "check"]

_GRAYS = 0.02, 0.98  # between them, the typical gray is looked for


@dataclass(frozen=True, slots=True)
class Contrast:
    """How the gray levels of the images correspond: ``left = gain * right ** gamma``.

    Parameters
    ----------
    gain, gamma
        Of intensities as fractions of their range.
    ratio
        The left image's gray level over the right one's, at the right image's median.
    """

    gain: float
    gamma: float
    ratio: float


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """What `check` found out about a pair; printing it prints its sentences.

    Parameters
    ----------
    size
        Rows and columns of the images.
    search
        Disparities to search, and whether the images are swapped; None: unknown.
    alignment
        How the rows correspond; None: unknown.
    blur
        The relative blur, with a map of it; None: unknown.
    contrast
        Gain and gamma; None: unknown.
    noise
        Standard deviations in gray levels of the images' own unit, left and right, or None.
    saturation
        Shares of the pixels at the ends of the scale, left and right.
    low_texture
        Shares of the images, 0 to 1, with nothing but noise, left and right, or None.
    intensity_range
        Length of the range of intensities, in the images' own unit.
    """

    size: tuple[int, int]
    search: SearchRange | None
    alignment: Alignment | None
    blur: BlurEstimate | None
    contrast: Contrast | None
    noise: tuple[float, float] | None
    saturation: tuple[Saturation, Saturation]
    low_texture: tuple[float, float] | None
    intensity_range: float

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What there is to say, in a fixed order of topics."""
        return findings.pair_findings(self)

    @property
    def _sure(self) -> float:
        """The confidence to so many digits that the type of the pixels makes no difference."""
        return math.nan if self.search is None else round(self.search.confidence, 2)

    def __str__(self) -> str:
        """Return one line a finding: its severity, and a sentence."""
        return "\n".join(f"{found.severity}: {found.sentence}" for found in self.findings)

    def _repr_html_(self) -> str:
        """Show the findings as a table in notebooks."""
        shown: str = import_module("phasestereo.views.notebook").diagnosis_html(self)
        return shown

    def as_dict(self) -> dict[str, Any]:
        """Return everything as JSON has it; numbers that JSON does not have are None."""
        record: dict[str, Any] = {
            "width": self.size[1],
            "height": self.size[0],
            "findings": [asdict(found) for found in self.findings],
            "search": _fields(self.search and replace(self.search, confidence=self._sure)),
            "alignment": None,
            "blur": None if self.blur is None else _blur(self.blur),
            "contrast": _fields(self.contrast),
            "noise": _sides(self.noise),
            "saturation": _sides([asdict(side) for side in self.saturation]),
            "low_texture": _sides(self.low_texture),
        }

        if self.alignment is not None:
            record["alignment"] = {
                name: getattr(self.alignment, name)
                for name in ("vertical", "rotation", "scale", "rms", "error", "blocks")
            }

        plain: dict[str, Any] = as_json(record)
        return plain


def check(left: ImageOrPath, right: ImageOrPath) -> Diagnosis:
    """Diagnose a stereo pair, from the images alone.

    Parameters
    ----------
    left, right
        The images, as `phasestereo.match` takes them. They should be rectified, but need not be.

    Returns
    -------
    Diagnosis
        Relative blur, gain and gamma, noise, saturation, texture, vertical misalignment, whether
        the images are swapped, and the range of disparities to search, with a sentence on each.
        What cannot be estimated, of images too small or too uniform, is None, and a sentence says
        so. The result depends on the images alone.

    Raises
    ------
    TypeError
        For a wrong type or dtype.
    ValueError
        For a wrong shape, different sizes, NaN or infinite pixels.
    OSError, ImportError
        If a file cannot be read.
    """
    pair = opened_pair(left, right)
    # The values are diagnosed, whatever type they come in.
    packed, unit = packed_pair(pair)
    gray_left, gray_right, length = fractions(*packed)
    length *= unit
    search, alignment, blur = _estimated(gray_left, gray_right, pair)

    noise = (0.0, 0.0) if blur is None else blur.noise
    texture = low_texture(gray_left, noise[0] / length), low_texture(gray_right, noise[1] / length)

    return Diagnosis(
        size=(gray_left.shape[0], gray_left.shape[1]),
        search=search,
        alignment=alignment,
        blur=blur,
        contrast=None if blur is None else _contrast(blur, gray_right),
        noise=None if blur is None else blur.noise,
        saturation=(saturation(pair[0]), saturation(pair[1])),
        low_texture=None if texture[0] is None or texture[1] is None else (texture[0], texture[1]),
        intensity_range=length,
    )


def _estimated(
    gray_left: NDArray[np.float32], gray_right: NDArray[np.float32], pair: tuple[Pixels, Pixels]
) -> tuple[SearchRange | None, Alignment | None, BlurEstimate | None]:
    """Estimate what there is to estimate of images that are large enough and not of one gray."""
    if min(gray_left.shape) < LEAST_SIZE or 0 in (np.ptp(gray_left), np.ptp(gray_right)):
        return None, None, None

    found = estimate_pair(pair, (None, None), (0, None), None)
    search = found.search if found.search.origin == "found" else None
    return search, found.alignment, found.blur


def _contrast(blur: BlurEstimate, right: NDArray[np.float32]) -> Contrast:
    typical = float(np.clip(np.median(right), *_GRAYS))
    return Contrast(blur.gain, blur.gamma, blur.gain * typical ** (blur.gamma - 1))


def _blur(estimate: BlurEstimate) -> dict[str, Any]:
    return {
        "certainty": estimate.certainty,
        "blurs": estimate.as_dicts(),
        "tile": estimate.tile,
        "labels": estimate.labels.tolist(),
    }


def _fields(record: SearchRange | Contrast | None) -> dict[str, Any] | None:
    return None if record is None else asdict(record)


def _sides(values: Any) -> Mapping[str, Any] | None:
    return None if values is None else {"left": values[0], "right": values[1]}

"""The diagnosis of a pair: faults that spoil a match.

This module holds the record of the core's measurements and sentences.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, cast

from phasestereo._core import LEAST_SIZE
from phasestereo._images import ImageOrPath
from phasestereo._numbers import as_json
from phasestereo._opening import opened_valid
from phasestereo._tables import as_html
from phasestereo.rig.alignment import Alignment
from phasestereo.rig.blur import BlurEstimate
from phasestereo.rig.estimation import estimate_pair
from phasestereo.rig.findings import Finding
from phasestereo.rig.photometry import Contrast, Photometry, Saturation
from phasestereo.rig.search_range import SearchRange


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """The results of `check` for a pair; printing it prints its sentences.

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
        Shares of the images, 0 to 1, with only noise, left and right, or None.
    intensity_range
        Length of the range of intensities, in the images' own unit.
    findings
        The findings, in a fixed order of topics.

    Examples
    --------
    >>> found = ps.check(left, right)
    >>> [one.sentence for one in found.findings if one.severity == "warning"]
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
    findings: tuple[Finding, ...]

    def __str__(self) -> str:
        """Return one line per finding: its severity, and a sentence."""
        return "\n".join(f"{found.severity}: {found.sentence}" for found in self.findings)

    def __repr__(self) -> str:
        """Return the size, and the numbers of warnings and notes."""
        rows, cols = self.size
        found = [finding.severity for finding in self.findings]
        counts = f"{found.count('warning')} warnings, {found.count('note')} notes"
        return f"<Diagnosis {cols}x{rows}, {counts}>"

    def _repr_html_(self) -> str:
        """Show the findings as a table in notebooks."""
        rows, cols = self.size
        found = [(one.topic, one.severity, one.sentence) for one in self.findings]
        heads = "Topic", "severity", "finding"
        return as_html("Diagnosis", f"{cols} x {rows} pixels", heads, found, bold="warning")

    def as_dict(self) -> dict[str, Any]:
        """Return everything for JSON; numbers that JSON does not have become None."""
        search, alignment = self.search, self.alignment
        names = "vertical", "rotation", "scale", "rms", "error", "blocks"
        record = {
            "width": self.size[1],
            "height": self.size[0],
            "findings": [asdict(found) for found in self.findings],
            # Rounded so that the type of the pixels makes no difference.
            "search": None
            if search is None
            else asdict(replace(search, confidence=round(search.confidence, 2))),
            "alignment": None
            if alignment is None
            else {name: getattr(alignment, name) for name in names},
            "blur": None
            if self.blur is None
            else {
                "certainty": self.blur.certainty,
                "blurs": self.blur.as_dicts(),
                "tile": self.blur.tile,
                "labels": self.blur.labels.tolist(),
            },
            "contrast": None if self.contrast is None else asdict(self.contrast),
            "noise": _sides(self.noise),
            "saturation": _sides([asdict(side) for side in self.saturation]),
            "low_texture": _sides(self.low_texture),
        }
        return as_json(record)


def check(left: ImageOrPath, right: ImageOrPath, *, self_rectify: bool = True) -> Diagnosis:
    """Diagnose a stereo pair, from the images alone.

    Parameters
    ----------
    left, right
        The images, as `phasestereo.match` takes them; rectified or not. NaN is masked.
    self_rectify
        Whether to rectify a pair that is far from rectified first, as `match` does; this takes
        seconds, and a finding reports it. False: the pair is diagnosed as it is.

    Returns
    -------
    Diagnosis
        Relative blur, gain and gamma, noise, saturation, texture, vertical misalignment, whether
        the images are swapped, and the range of disparities to search, with a sentence on each.
        With ``self_rectify``, a copy of at most 0.4 megapixels is matched as well, and the first
        finding warns if that match fails: estimates alone do not show the quality of a match.
        Values that cannot be estimated, for images too small or too uniform, are None, and a
        sentence reports this. The result depends only on the images.

    Raises
    ------
    TypeError
        For a wrong type or dtype.
    ValueError
        For a wrong shape, or infinite pixels.
    OSError, ImportError
        If a file cannot be read.

    Examples
    --------
    >>> found = ps.check("left.png", "right.png")
    >>> print(found)
    >>> found.search.num_disparities
    """
    _, pair, masks = opened_valid((left, right))
    size = pair[0].shape[0], pair[0].shape[1]
    found = estimate_pair(pair, masks, (0, None), None, self_rectify=self_rectify)
    light = cast("Photometry", found.photometry)  # the preset asks for estimates

    is_uniform = any(side.dark == 1 for side in light.saturation)
    blur = None if is_uniform or min(size) < LEAST_SIZE else found.blur
    return Diagnosis(
        size=size,
        search=found.search if found.search.origin == "found" else None,
        alignment=found.alignment,
        blur=blur,
        contrast=light.contrast,
        noise=None if blur is None else blur.noise,
        saturation=light.saturation,
        low_texture=None if math.isnan(light.low_texture[0]) else light.low_texture,
        intensity_range=light.intensity_range,
        findings=found.findings,
    )


def _sides(values: Any) -> Mapping[str, Any] | None:
    return None if values is None else {"left": values[0], "right": values[1]}

"""The core's estimates of a pair before a match."""

from __future__ import annotations

from dataclasses import dataclass

from phasestereo.rig.alignment import Alignment
from phasestereo.rig.blur import BlurEstimate
from phasestereo.rig.compensation import BlurCompensation
from phasestereo.rig.findings import Finding
from phasestereo.rig.photometry import Photometry
from phasestereo.rig.search_range import SearchRange
from phasestereo.settings import Settings


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Estimates:
    """The estimates of a pair, and the settings and the compensation that suit it."""

    settings: Settings
    search: SearchRange
    alignment: Alignment | None
    blur: BlurEstimate | None
    blur_compensation: BlurCompensation | None
    photometry: Photometry | None
    findings: tuple[Finding, ...]

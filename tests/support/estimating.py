"""What is estimated of a pair for a match, without its blur, which takes most of the time."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from phasestereo import _core
from phasestereo._images import as_pair
from phasestereo.settings import PRESETS

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from phasestereo.rig.estimates import Estimates


def estimated(left: ArrayLike, right: ArrayLike) -> Estimates:
    """Return the rows and the range of a pair, of which nothing is known."""
    asked = replace(PRESETS["robust"], compensate_blur=False, noise_threshold=0.0)
    return _core.estimate_pair(
        as_pair(left, right), (None, None), (0, None), asked, None, self_rectify=False
    )

"""Rectify raw pairs: by a calibration, or by the images alone.

    import phasestereo as ps

    rig = ps.rectify(left, right, "stereo.yml")
    ps.match(rig.left, rig.right, left_mask=rig.left_mask, right_mask=rig.right_mask, ...)

This package reads calibrations (`reading`, with `documents`, `names` and `rigs`), builds OpenCV's
maps from them (`cameras`), estimates the cameras otherwise (`estimating`, with `features`), and
records the result (`record`). All of it needs the extra ``rectify``.
"""

from __future__ import annotations

from phasestereo.rectification.record import Rectification
from phasestereo.rectification.rectifying import rectify

__all__ = ["Rectification", "rectify"]

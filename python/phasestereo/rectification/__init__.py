"""Raw pairs made such as can be matched: by a calibration, or by what the images show.

    import phasestereo as ps

    rig = ps.rectify(left, right, "stereo.yml")
    ps.match(rig.left, rig.right, left_mask=rig.left_mask, right_mask=rig.right_mask, ...)

Here belongs what reads calibrations (`reading`, with `documents`, `names` and `rigs`), what OpenCV
makes of them (`cameras`), the estimation elsewhere (`estimating`, with `features`), and
the record of what was done (`record`). All of it needs the extra ``rectify``.
"""

from __future__ import annotations

from phasestereo.rectification.record import Rectification
from phasestereo.rectification.rectifying import rectify

__all__ = ["Rectification", "rectify"]

"""The suite "rigs": pairs as real rigs deliver them, one image worse or the rig not perfect.

`fault` says what a fault is and how faults are put together, `geometry`, `sensor`, `optics` and
`depth` what is done to images, and `suite` which faults there are and how strong.
"""

from phasestereo_bench.rigs.fault import ALTERNATING, Fault, side_of
from phasestereo_bench.rigs.suite import FAULTS, GROUPS, QUICK_SCENES

__all__ = ["ALTERNATING", "FAULTS", "GROUPS", "QUICK_SCENES", "Fault", "side_of"]

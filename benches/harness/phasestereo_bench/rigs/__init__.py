"""The suites "rigs" and "rigs-2": pairs as real rigs deliver them.

`fault` says what a fault is and how faults are put together, `geometry`, `sensor`, `optics`,
`capture`, `depth` and `corruptions` what is done to images, and `suite` which faults there are and
how strong.
"""

from phasestereo_bench.rigs.fault import ALTERNATING, Fault, side_of
from phasestereo_bench.rigs.suite import FAULTS, QUICK_SCENES, RIGS

__all__ = ["ALTERNATING", "FAULTS", "QUICK_SCENES", "RIGS", "Fault", "side_of"]

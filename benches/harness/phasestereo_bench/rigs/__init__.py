"""The suites "rigs" and "rigs-2" make pairs as real rigs deliver them.

`fault` defines a fault and combines faults; `geometry`, `sensor`, `optics`, `capture`, `depth` and
`corruptions` change images; `suite` lists the faults and their strengths.
"""

from phasestereo_bench.rigs.fault import ALTERNATING, SCENES, Fault, side_of
from phasestereo_bench.rigs.suite import FAULTS, QUICK_SCENES, RIGS

__all__ = ["ALTERNATING", "FAULTS", "QUICK_SCENES", "RIGS", "SCENES", "Fault", "side_of"]

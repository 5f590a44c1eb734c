"""The demonstration: what one blurred, dim image does to stereo, and what phase codes do about it.

A rendered scene, exact truth included, is matched by phase codes and by what they are meant to
replace: once with both images sharp, once with the left one degraded (`trials`). What came of it
becomes a folder of maps, pictures and a page that explains them (`exhibit`).
"""

from phasestereo_bench.demo.exhibit import write_demo
from phasestereo_bench.demo.trials import (
    METHODS,
    ROBUST,
    SGBM,
    Comparison,
    Demo,
    DemoMethod,
    ScoredMap,
    run_demo,
    verdict,
)

__all__ = [
    "METHODS",
    "ROBUST",
    "SGBM",
    "Comparison",
    "Demo",
    "DemoMethod",
    "ScoredMap",
    "run_demo",
    "verdict",
    "write_demo",
]

"""Demonstrates how one blurred, dim image hurts stereo, and how phase codes help.

`trials` matches a rendered scene, whose truth is exact, by phase codes and by the methods they are
meant to replace: once with both images sharp, once with the left one degraded. `exhibit` writes the
results to a folder of maps, pictures and a page that explains them.
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

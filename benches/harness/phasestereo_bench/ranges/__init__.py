"""Makes pairs with known disparities, and checks the range that a match finds by itself."""

from phasestereo_bench.ranges.constructions import KINDS, Construction, constructions
from phasestereo_bench.ranges.trials import (
    Comparison,
    Trial,
    compare,
    compared_table,
    found_table,
    search,
)

__all__ = [
    "KINDS",
    "Comparison",
    "Construction",
    "Trial",
    "compare",
    "compared_table",
    "constructions",
    "found_table",
    "search",
]

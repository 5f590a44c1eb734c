"""Match pairs larger than memory, and many pairs: in bands, from file to file, on clusters.

    from phasestereo_large import outofcore

    outofcore.match("left.tif", "right.tif", "out.tif", num_disparities=256, max_memory="2GB")

This module matches a pair in bands; `outofcore`, `batch`, `dask`, `geotiff` and `xarray` are
separate modules, and each names the extra it needs.
"""

from __future__ import annotations

from phasestereo_large.bands import halo, match_rows, pair_statistics
from phasestereo_large.statistics import PairStatistics

__all__ = ["PairStatistics", "halo", "match_rows", "pair_statistics"]

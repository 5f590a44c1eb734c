"""Match many pairs of image files in many processes, on this machine or a Dask cluster.

`read_pairs` finds the pairs, `run` matches them. The process that matches a pair writes its result,
completely or not at all. A manifest records the outcome of every pair, so that a rerun does only
the missing ones. Needs the extra ``batch``; with a cluster ``dask``, which it imports on first use.
"""

from __future__ import annotations

from phasestereo_large.batch.cluster import encryption
from phasestereo_large.batch.manifest import Record, read_manifest
from phasestereo_large.batch.pairs import PairFiles, read_pairs
from phasestereo_large.batch.running import BatchReport, run

__all__ = ["BatchReport", "PairFiles", "Record", "encryption", "read_manifest", "read_pairs", "run"]

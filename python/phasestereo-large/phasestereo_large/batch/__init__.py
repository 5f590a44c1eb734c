"""Many pairs of image files, matched by many processes: of this machine, or of a Dask cluster.

`read_pairs` finds the pairs, `run` matches them. Each result is written by the process that found
it, whole or not at all; what has become of every pair is in a manifest, by which a rerun does only
what is missing. Needs the extra ``batch``; with a cluster ``dask``, which is imported when it is
first needed.
"""

from __future__ import annotations

from phasestereo_large.batch.cluster import encryption
from phasestereo_large.batch.manifest import Record, read_manifest
from phasestereo_large.batch.pairs import PairFiles, read_pairs
from phasestereo_large.batch.running import BatchReport, run

__all__ = ["BatchReport", "PairFiles", "Record", "encryption", "read_manifest", "read_pairs", "run"]

"""Scores matchers on pairs, sharp and degraded, and repeats the paper's experiments.

    from pathlib import Path

    import phasestereo_bench as bench
    from phasestereo_bench.datasets import find_scenes

    scenes, methods = find_scenes("middlebury"), ["paper", "opencv:sgbm", my_matcher]
    records = bench.run_jobs(bench.middlebury_jobs(scenes, methods), Path("results.jsonl"))

`methods` defines the methods to compare, `cases` the cases to compare them on, and `middlebury`
combines them; `runner` spreads the work over processes and remembers finished jobs.
"""

from phasestereo_bench.cases import SUITES
from phasestereo_bench.methods import Method, available, method
from phasestereo_bench.middlebury import default_methods, middlebury_jobs
from phasestereo_bench.runner import Job, run_jobs
from phasestereo_bench.store import read_store

__all__ = [
    "SUITES",
    "Job",
    "Method",
    "available",
    "default_methods",
    "method",
    "middlebury_jobs",
    "read_store",
    "run_jobs",
]

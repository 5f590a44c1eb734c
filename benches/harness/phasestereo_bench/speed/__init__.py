"""The speed benchmark measures the time and memory of our matcher and OpenCV's for a pair.

    from pathlib import Path

    from phasestereo_bench import run_jobs
    from phasestereo_bench.speed import find_pairs, speed_jobs

    pairs, left_out = find_pairs(Path("data"), cache=Path("."))
    records = run_jobs(speed_jobs(pairs), Path("speed.jsonl"), workers=0)

Data flow: `pairs` -> `contenders`, which `rounds` times in turn and `memory` weighs -> `records`,
in a store -> the tables of `results`.
"""

from phasestereo_bench.speed.contenders import CONTENDERS, OURS
from phasestereo_bench.speed.pairs import PAIRS, GrayPair, find_pairs
from phasestereo_bench.speed.records import speed_jobs
from phasestereo_bench.speed.results import (
    KIND,
    explain_speed,
    memory_table,
    time_table,
)

__all__ = [
    "CONTENDERS",
    "KIND",
    "OURS",
    "PAIRS",
    "GrayPair",
    "explain_speed",
    "find_pairs",
    "memory_table",
    "speed_jobs",
    "time_table",
]

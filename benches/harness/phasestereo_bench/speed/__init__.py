"""The speed benchmark: what a pair takes us and OpenCV's matchers, in time and in memory.

    from pathlib import Path

    from phasestereo_bench.speed import find_pairs, run_speed

    pairs, left_out = find_pairs(Path("data"), cache=Path("."))
    records = run_speed(pairs, Path("speed.jsonl"))

Data flow: `pairs` -> `contenders`, timed in turn by `rounds` and weighed by `memory` -> `records`,
in a store -> `results` and their tables, in a `document`.
"""

from phasestereo_bench.speed.contenders import CONTENDERS, OURS
from phasestereo_bench.speed.pairs import PAIRS, GrayPair, find_pairs
from phasestereo_bench.speed.records import run_speed, speed_jobs
from phasestereo_bench.speed.results import (
    KIND,
    SpeedResults,
    explain_speed,
    memory_table,
    read_speed,
    time_table,
)

__all__ = [
    "CONTENDERS",
    "KIND",
    "OURS",
    "PAIRS",
    "GrayPair",
    "SpeedResults",
    "explain_speed",
    "find_pairs",
    "memory_table",
    "read_speed",
    "run_speed",
    "speed_jobs",
    "time_table",
]

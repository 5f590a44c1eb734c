"""Scores plain, slanted and curved surfaces, edges and thin things, at many sizes.

    from pathlib import Path

    from phasestereo_bench import run_jobs
    from phasestereo_bench.surfaces import surface_cases, surface_jobs, surface_table

    jobs = surface_jobs(surface_cases([Path("middlebury")]))
    table = surface_table(run_jobs(jobs, Path("surfaces.jsonl")))

Data flow: `cases` -> `trials`, which count by `measures` -> records, in a store -> `results`.
"""

from phasestereo_bench.surfaces.cases import (
    FACTORS,
    MEGAPIXELS,
    SEEDS,
    UPSAMPLED,
    RoomCase,
    SceneCase,
    SurfaceCase,
    TableCase,
    Task,
    View,
    surface_cases,
)
from phasestereo_bench.surfaces.measures import (
    KINDS,
    count_bad,
    gray_of,
    kinds_of_pixels,
    stripes,
)
from phasestereo_bench.surfaces.results import surface_table, upsampled_table
from phasestereo_bench.surfaces.trials import (
    KIND,
    OURS,
    default_methods,
    surface_jobs,
    try_out,
)

__all__ = [
    "FACTORS",
    "KIND",
    "KINDS",
    "MEGAPIXELS",
    "OURS",
    "SEEDS",
    "UPSAMPLED",
    "RoomCase",
    "SceneCase",
    "SurfaceCase",
    "TableCase",
    "Task",
    "View",
    "count_bad",
    "default_methods",
    "gray_of",
    "kinds_of_pixels",
    "stripes",
    "surface_cases",
    "surface_jobs",
    "surface_table",
    "try_out",
    "upsampled_table",
]

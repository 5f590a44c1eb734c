"""The benchmark of the estimation of blur: scenes blurred by what is known, and what is found.

    from pathlib import Path

    from phasestereo_bench import run_jobs
    from phasestereo_bench.blur import blur_jobs
    from phasestereo_bench.datasets import find_scenes

    records = run_jobs(blur_jobs(find_scenes("middlebury")), Path("blur.jsonl"))

Data flow: `trials` -> records, in a store -> `verdicts` -> the table of `results`.
"""

from phasestereo_bench.blur.results import blur_table, explain_blur
from phasestereo_bench.blur.trials import KIND, BlurTrial, blur_jobs, try_out
from phasestereo_bench.blur.verdicts import BlurVerdict, verdict

__all__ = [
    "KIND",
    "BlurTrial",
    "BlurVerdict",
    "blur_jobs",
    "blur_table",
    "explain_blur",
    "try_out",
    "verdict",
]

"""The benchmark of the estimation of blur: scenes blurred by what is known, and what is found.

    from pathlib import Path

    from phasestereo_bench.blur import run_blur
    from phasestereo_bench.datasets import find_scenes

    records = run_blur(find_scenes("middlebury"), Path("blur.jsonl"))

Data flow: `trials` -> records, in a store -> `verdicts` -> the table of `results`, in a `document`.
"""

from phasestereo_bench.blur.results import BlurResults, blur_table, explain_blur, read_blur
from phasestereo_bench.blur.trials import KIND, BlurTrial, blur_jobs, run_blur, try_out
from phasestereo_bench.blur.verdicts import BlurVerdict, verdict

__all__ = [
    "KIND",
    "BlurResults",
    "BlurTrial",
    "BlurVerdict",
    "blur_jobs",
    "blur_table",
    "explain_blur",
    "read_blur",
    "run_blur",
    "try_out",
    "verdict",
]

"""What functions of the harness refuse, by the name of the argument."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_bench_cases import plant
from test_bench_report import store

from phasestereo_bench import blur, ranges, run_jobs
from phasestereo_bench.confidence import learned_weights
from phasestereo_bench.degradation import motion_psf
from phasestereo_bench.real import find_recording
from phasestereo_bench.rendering.sequences import render_sequence
from phasestereo_bench.rigs import FAULTS
from phasestereo_bench.surfaces import surface_cases, surface_jobs
from phasestereo_bench.tables.comparison import read_numbers
from phasestereo_bench.tables.plan import job_groups

ANY: Any = "rotation"

REFUSALS: list[tuple[Callable[[Path], object], type[Exception], str]] = [
    (lambda _: learned_weights([]), ValueError, "^records: got no match"),
    (lambda _: list(ranges.constructions([ANY])), ValueError, "scenes: got 1; accepts two or more"),
    (lambda _: surface_jobs(surface_cases(seeds=1), []), ValueError, "there is nothing to match"),
    (lambda _: next(render_sequence(ANY)), ValueError, "motion: got 'rotation'; accepts static"),
    (lambda _: blur.blur_jobs([]), ValueError, "there is no scene to blur"),
    (lambda _: blur.blur_jobs([ANY], every=0), ValueError, "every: got 0; accepts 1 and more"),
    (lambda _: FAULTS["noise 2"](ANY, "middle"), ValueError, "^side: got 'middle'"),
    (lambda _: motion_psf(0.5), ValueError, "length"),
    (lambda _: motion_psf(3, np.nan), ValueError, "angle"),
    (lambda folder: read_numbers(store(folder / "a", [])), ValueError, "are not the numbers"),
    (lambda folder: run_jobs([], folder / "a", workers=-1), ValueError, "^workers: got -1"),
    (lambda folder: run_jobs([], folder / "a", workers=ANY), TypeError, "^workers"),
    (lambda folder: run_jobs([], folder / "a", workers=True), TypeError, "^workers"),
    (lambda folder: run_jobs([], folder / "b" / "a", workers=0), OSError, "No such file"),
    (find_recording, ValueError, "no frames; accepts cam0 and cam1"),
    (lambda folder: find_recording(folder / "none"), NotADirectoryError, "no such folder"),
    (
        lambda folder: job_groups(plant(folder / "middlebury", "x").parent, []),
        ValueError,
        "it has none of",
    ),
]


@pytest.mark.parametrize(("call", "error", "message"), REFUSALS)
def test_bad_arguments_are_refused(
    tmp_path: Path, call: Callable[[Path], object], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        call(tmp_path)

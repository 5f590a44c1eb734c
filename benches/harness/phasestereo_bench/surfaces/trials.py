"""Matches cases by methods, and records the errors."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo_bench.methods import Method, available, method
from phasestereo_bench.middlebury import matched
from phasestereo_bench.runner import Job
from phasestereo_bench.surfaces import cases
from phasestereo_bench.surfaces.cases import SurfaceCase, View
from phasestereo_bench.surfaces.measures import count_bad, stripes

KIND = "surfaces"
"""The kind of the records."""

OURS = "robust:num_disparities=auto"


def default_methods() -> list[str]:
    """Return our method without a range, and OpenCV's if it is installed."""
    return [name for name in (OURS, "opencv:sgbm") if name == OURS or name in available()]


def surface_jobs(chosen: Sequence[SurfaceCase], methods: Sequence[str] | None = None) -> list[Job]:
    """Return the jobs that match cases, one for each case and method.

    Parameters
    ----------
    chosen
        As `phasestereo_bench.surfaces.surface_cases` returns them.
    methods
        Names for `phasestereo_bench.method`. Default: ours without a range, and StereoSGBM, which
        gets the range.

    Returns
    -------
    list of Job
        In their records, "kind", "row", "scene" and "method" identify a map. Good records have
        "views", by the row of the table: "pixels", "bad_1" and "bad_2" by kind of pixel (the number
        that count, and that are off by more than 1 and 2 px or missing), "stripes" and
        "truth_stripes" (0 to 1); "num_disparities", "width" and "height"; "seconds" and
        "peak_bytes" of the match on one thread.

    Raises
    ------
    TypeError, ValueError
        If there is no such method, or no case.
    ImportError
        If a package that a method needs is not installed.
    """
    specs = list(dict.fromkeys(default_methods() if methods is None else methods))
    if not chosen or not specs:
        raise ValueError("there is nothing to match: give cases and methods")

    # Files may have changed since an earlier call in this process.
    cases.load.cache_clear()
    names = {spec: str(method(spec)) for spec in specs}
    return [
        Job(
            {"kind": KIND, "row": case.row, "scene": case.name, "method": names[spec]},
            try_out,
            {"case": case, "spec": spec},
        )
        for case in chosen
        for spec in specs
    ]


def try_out(case: SurfaceCase, spec: str | Method) -> dict[str, Any]:
    """Match a case and return its record."""
    entrant, task = method(spec), cases.load(case)
    left, right = task.left.copy(), task.right.copy()
    found = matched(entrant, left, right, task.num_disparities)
    disparity = found.disparity.astype(np.float64)
    height, width = left.shape[:2]

    return {
        "views": {view.row: _counted(view, disparity) for view in task.views},
        "num_disparities": task.num_disparities,
        "width": width,
        "height": height,
        "seconds": found.seconds,
        "peak_bytes": found.peak_bytes,
    }


def _counted(view: View, disparity: NDArray[np.float64]) -> dict[str, Any]:
    seen = view.seen(disparity)
    return {
        **count_bad(seen, view.truth, view.kinds),
        "stripes": stripes(seen),
        "truth_stripes": stripes(view.truth),
    }

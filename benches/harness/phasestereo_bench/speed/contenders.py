"""Contenders: ours and OpenCV's matchers, each made once for a pair and then called as it is.

OpenCV's get the raw images, and what they return is left as it is: no borders are continued, and no
float map with unknown pixels is made, so they do less than ours, which flatters them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np

from phasestereo._extras import require
from phasestereo.matchers.opencv import create_bm, create_sgbm
from phasestereo.matching import Matcher, match
from phasestereo.settings import PRESETS

MATCH = "+match"
"""Ending of ours that make a matcher for each pair, and give its memory back."""

Call: TypeAlias = Callable[..., Any]
"""Takes the two images."""

OURS: Mapping[str, str] = MappingProxyType(
    {preset: f"phasestereo:{preset}" for preset in ("fast", "robust")}
)
"""What ours are called, by preset. Each is timed against all rivals."""


def _ours(preset: str, num_disparities: int, threads: int | None) -> Call:
    matcher = Matcher(settings=PRESETS[preset], threads=threads)
    return partial(matcher.match, num_disparities=num_disparities)


def _ours_once(preset: str, num_disparities: int, threads: int | None) -> Call:
    return partial(
        match, settings=PRESETS[preset], num_disparities=num_disparities, threads=threads
    )


def _bm_unchecked(num_disparities: int, _threads: int | None) -> Call:
    matcher = create_bm(num_disparities)
    matcher.setUniquenessRatio(0)
    matcher.setTextureThreshold(0)
    return matcher.compute


CONTENDERS: Mapping[str, Callable[[int, int | None], Call]] = MappingProxyType(
    {
        **{name: partial(_ours, preset) for preset, name in OURS.items()},
        **{name + MATCH: partial(_ours_once, preset) for preset, name in OURS.items()},
        "opencv:bm": lambda count, _: create_bm(count).compute,
        "opencv:bm-unchecked": _bm_unchecked,
        "opencv:sgbm-3way": lambda count, _: (
            create_sgbm(count, "STEREO_SGBM_MODE_SGBM_3WAY", channels=1).compute
        ),
    }
)
"""What makes each of them for a number of disparities and threads, None being all there are.

OpenCV's matchers take theirs from `set_opencv_threads` instead.
"""


def set_opencv_threads(count: int) -> None:
    """Let OpenCV use a number of threads, and start them at once, not while it is timed."""
    cv2 = require("cv2", extra="opencv")
    if cv2.getNumThreads() != count:
        cv2.setNumThreads(count)
        blank = np.zeros((64, 64), np.uint8)
        create_bm(16).compute(blank, blank)


def opencv_build() -> str:
    """Return the instruction sets that OpenCV was compiled for, as it reports them.

    Such as "baseline: SSE SSE2 SSE3; dispatched: SSE4_1 AVX2": the latter are used where there is
    code that was written for them, which StereoBM has none of.
    """
    report = require("cv2", extra="opencv").getBuildInformation()
    names = {"Baseline": "baseline", "Dispatched code generation": "dispatched"}
    found = {
        name: re.search(rf"^\s*{line}:[ \t]*(.*?)\s*$", report, re.MULTILINE)
        for line, name in names.items()
    }

    return "; ".join(f"{name}: {match[1] or 'none'}" for name, match in found.items() if match)

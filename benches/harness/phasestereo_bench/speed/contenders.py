"""Makes our matchers and OpenCV's, each once for a pair; rounds then call them as they are.

OpenCV's matchers get the raw images, and their results stay as they are: nothing continues borders
or makes a float map with unknown pixels. So they do less than ours, which flatters them.
"""

import re
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from phasestereo._extras import require
from phasestereo.matchers.opencv import create_bm, create_sgbm
from phasestereo.matching import Matcher, match
from phasestereo.settings import PRESETS

MATCH = "+match"
"""Ending for those of our contenders that make a matcher for each pair, and free its memory."""

Call: TypeAlias = Callable[..., Any]
"""A function that takes the two images."""

OURS: Mapping[str, str] = {preset: f"phasestereo:{preset}" for preset in ("fast", "robust")}
"""The names of our contenders, by preset. Each is timed against all rivals."""


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


CONTENDERS: Mapping[str, Callable[[int, int | None], Call]] = {
    **{name: partial(_ours, preset) for preset, name in OURS.items()},
    **{name + MATCH: partial(_ours_once, preset) for preset, name in OURS.items()},
    "opencv:bm": lambda count, _: create_bm(count).compute,
    "opencv:bm-unchecked": _bm_unchecked,
    "opencv:sgbm-3way": lambda count, _: (
        create_sgbm(count, "STEREO_SGBM_MODE_SGBM_3WAY", channels=1).compute
    ),
}
"""The makers of the contenders, for a number of disparities and threads; None means all threads.

OpenCV's matchers take their threads from `set_opencv_threads` instead.
"""


def set_opencv_threads(count: int) -> None:
    """Let OpenCV use a number of threads, and start them now, before the timing."""
    cv2 = require("cv2", extra="opencv")
    if cv2.getNumThreads() != count:
        cv2.setNumThreads(count)
        blank = np.zeros((64, 64), np.uint8)
        create_bm(16).compute(blank, blank)


def opencv_build() -> str:
    """Return the instruction sets that OpenCV was compiled for, as it reports them.

    An example is "baseline: SSE SSE2 SSE3; dispatched: SSE4_1 AVX2": OpenCV uses the dispatched
    sets where it has code for them. StereoBM has no such code.
    """
    report = require("cv2", extra="opencv").getBuildInformation()
    names = {"Baseline": "baseline", "Dispatched code generation": "dispatched"}
    found = {
        name: re.search(rf"^\s*{line}:[ \t]*(.*?)\s*$", report, re.MULTILINE)
        for line, name in names.items()
    }

    return "; ".join(f"{name}: {match[1] or 'none'}" for name, match in found.items() if match)

"""Spoiled pairs and maps of other matchers -> pixels from which the core learns to judge maps.

Several methods match every scene, unchanged and under faults of the suites; the truth is one more
map. For each map this keeps the traits of some pixels that both images see, as the core computes
them, and the errors of the claim and our own disparity.
"""

import base64
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo._core import observe_maps
from phasestereo._images import as_pair
from phasestereo.settings import PRESETS
from phasestereo_bench.cases import SUITES, Case, usual_side
from phasestereo_bench.datasets import Scene
from phasestereo_bench.methods import method
from phasestereo_bench.middlebury import matched_pair
from phasestereo_bench.runner import Job

OFTEN = "sharp", "disk 6", "noise 20", "jpeg 70", "both disk 3"
"""Conditions of every scene."""
TRUTH = "truth"
"""Method of true maps."""
_OTHERS_PER_SCENE = 5
_PIXELS = 500  # of each map
_SEED = 7


def claim_jobs(scenes: Sequence[Scene], methods: Sequence[str], *, every: int = 1) -> list[Job]:
    """Return the pairs to match by all methods: which faults of which scene is drawn, always alike.

    Parameters
    ----------
    scenes
        Scenes with a truth.
    methods
        Names of methods.
    every
        Only every N-th pair.
    """
    rng = np.random.default_rng(_SEED)
    others = [
        (suite, name)
        for suite in ("one-sided-blur", "rigs", "rigs-2")
        for name in SUITES[suite]
        if name not in OFTEN
    ]
    cases = []
    for scene in scenes:
        drawn = rng.choice(len(others), _OTHERS_PER_SCENE, replace=False)
        often = [(next(s for s in SUITES if name in SUITES[s]), name) for name in OFTEN]
        cases += [(scene, *case) for case in [*often, *(others[k] for k in drawn)]]

    return [
        Job(
            key={"suite": "claims", "scene": str(scene), "faults": name},
            work=observe_claims,
            arguments={
                "scene": scene,
                "suite": suite,
                "fault": name,
                "methods": tuple(methods),
                "seed": number,
            },
        )
        for number, (scene, suite, name) in enumerate(cases)
    ][::every]


def observe_claims(
    scene: Scene, suite: str, fault: str, methods: Sequence[str], seed: int
) -> dict[str, Any]:
    """Match a spoiled pair by all methods, and return traits and errors of some pixels."""
    pair = Case(scene, suite, fault, usual_side(suite)).pair(true_blur=False)
    truth = np.asarray(pair.truth, np.float32)
    rng = np.random.default_rng(seed)

    chosen = [method(each) for each in methods]
    names = [*map(str, chosen), TRUTH]
    maps = [matched_pair(each, pair).disparity.astype(np.float32) for each in chosen]
    maps.append(truth)
    seen = pair.masks["nonocc"] & np.isfinite(truth)
    seen &= np.arange(truth.shape[1]) >= truth

    images = as_pair(np.ascontiguousarray(pair.left), np.ascontiguousarray(pair.right))
    own, traits = observe_maps(images, maps, PRESETS["robust"], 1)

    found = {}
    for index, (name, claims, values) in enumerate(zip(names, maps, traits, strict=True)):
        if any(np.array_equal(claims, other, equal_nan=True) for other in maps[:index]):
            continue  # nothing had to be prepared
        places = np.flatnonzero(seen & np.isfinite(values[..., 0]))
        if places.size == 0:
            continue
        places = rng.choice(places, min(_PIXELS, places.size), replace=False)
        errors = [np.abs(each - truth).ravel()[places] for each in (claims, own.disparity)]
        flags = own.flags.ravel()[places].astype(np.float32)
        columns = [*errors, flags, *values.reshape(-1, values.shape[2])[places].T]
        found[name] = packed(np.stack(columns, axis=1))
    return {"maps": found}


def packed(values: NDArray[np.float32]) -> str:
    """Return an array as text: half precision, compressed."""
    narrow = np.nan_to_num(values, nan=np.inf).clip(-6e4, 6e4).astype("<f2")
    return base64.b64encode(zlib.compress(narrow.tobytes())).decode()


def unpacked(text: str, columns: int) -> NDArray[np.float64]:
    """Return the array that a text holds."""
    values = np.frombuffer(zlib.decompress(base64.b64decode(text)), "<f2")
    return values.reshape(-1, columns).astype(np.float64)

"""Instruction-set levels: whichever is used, the bits are the same."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from functools import cache

import pytest

from phasestereo import _core

LEVELS = ["sse2", "avx2", "avx512", "avx512bitalg"]
"""From the lowest."""

on_x86 = pytest.mark.skipif(
    platform.machine().lower() not in {"x86_64", "amd64"}, reason="the levels are those of x86-64"
)

CODE = """
import hashlib, json
import numpy as np, phasestereo as ps
from phasestereo import _core
from phasestereo.rig.compensation import BlurCompensation
rng = np.random.default_rng(0)
pairs = [rng.integers(0, 256, (2, 70, 90), np.uint8), rng.random((2, 40, 50, 3), np.float32)]
cases = [{"preset": "fast"}, {"preset": "robust"}, {},
         {"preset": "robust", "fill": False, "min_confidence": .5, "precision": "full"},
         {"preset": "robust", "optimizer": "so", "speckle_size": 9},
         {"bits": 3, "neighborhood": 9, "frequencies": (2, 2)},
         {"noise_threshold": 1, "known": ps.Known(noise=9.0)}, {"noise_threshold": 2, "power": 2,
          "known": ps.Known(noise=(0.1, 0.2))},
         {"known": ps.Known(blur_compensation=BlurCompensation(
             noise=(1.0, 1.0), labels=np.array([[0, 1], [2, 0]], np.uint8), tile=17,
             kernels=[(None, None), (np.eye(3) / 3, None), (None, np.full((1, 5), 0.2))]))},
         {"cost": "nsad", "p1": .5, "p2": .5, "optimizer": "so"}, {"optimizer": "wta", "window": 3}]
digest = hashlib.sha256()
for pair in pairs:
    for case in cases:
        masks = {"left_mask": rng.random(pair.shape[1:3]) > 0.1}
        for options in (case, case | masks):
            result = ps.match(*pair, num_disparities=30, **{"preset": "paper"} | options)
            for field in (result.disparity, result.flags, result.confidence):
                digest.update(b"" if field is None else field.tobytes())
print(json.dumps([_core.simd_level(), digest.hexdigest()]))
"""


@cache
def matched(level: str | None) -> tuple[str, str]:
    """Match in a process of its own; return the level it used and a digest of all results."""
    environment = {name: value for name, value in os.environ.items() if name != "PHASESTEREO_SIMD"}

    if level is not None:
        environment["PHASESTEREO_SIMD"] = level

    finished = subprocess.run(  # noqa: S603  # our own interpreter on our own code
        [sys.executable, "-c", CODE],
        capture_output=True,
        text=True,
        env=environment,
        timeout=60,
        check=False,
    )

    assert finished.returncode == 0, finished.stderr
    used, digest = json.loads(finished.stdout)

    return used, digest


@on_x86
@pytest.mark.parametrize("level", LEVELS)
def test_a_level_is_only_ever_lowered_and_changes_no_bit(level: str) -> None:
    best, expected = matched(None)
    used, found = matched(level)
    assert used == LEVELS[min(LEVELS.index(level), LEVELS.index(best))]
    assert found == expected


def test_a_level_that_is_not_known_changes_nothing() -> None:
    assert matched("mmx") == matched(None)


def test_the_level_of_this_process_has_a_name() -> None:
    assert _core.simd_level() in {*LEVELS, "baseline"}

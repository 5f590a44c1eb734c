"""Runs librealsense in processes of its own, since it ends a process as it likes."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from support import ENVIRONMENT, ROOT, counterpart


def record(scene: NDArray[np.uint8], path: Path) -> Path:
    """Make a recording of a scene, whose right view is 20 columns to the right; return its path."""
    np.save(path.with_suffix(".npy"), scene)
    _run("record", str(path.with_suffix(".npy")), str(path))
    return path


def play(path: Path) -> Any:
    """Run the lines of the documentation on a recording; return sizes and median disparities."""
    return json.loads(_run("play", str(path)))


def _run(*words: str) -> str:
    counterpart("pyrealsense2")
    program = str(ROOT / "tests/live/realsense.py")
    done = subprocess.run(  # noqa: S603 -- our own interpreter and program
        [sys.executable, program, *words],
        env=ENVIRONMENT, check=False, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout

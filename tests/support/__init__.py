"""What tests share: where things are, what is installed, helpers, oracles, and made-up data."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import pytest

Item = TypeVar("Item")

Run = tuple[int, str, str]

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = (
    ROOT / "python",
    *(ROOT / "python" / name for name in ("phasestereo-live", "phasestereo-large")),
    ROOT / "benches/harness",
)
"""The folders that hold our packages."""

# "CI" would have pytest compare and show whole what differs: megabytes, in minutes.
os.environ.setdefault("PHASESTEREO_CI", os.environ.pop("CI", ""))
ON_CI = os.environ["PHASESTEREO_CI"] == "true"

LACKING = {
    "this Python has a GIL": "a job of the workflow runs a Python that has none",
    "only root becomes another user": "who runs the tests is not always root",
    "could not import 'open3d'": "it has wheels for Linux on x86-64 and Python up to 3.12 alone",
    "could not import 'pyrealsense2'": "it has no wheels for other processors than x86-64",
    "no headers of ROS 1": "Debian 12 is the last that has them, and CI runs elsewhere",
    "could not import 'phasestereo_gpu'": "`make test-gpu`, which compiles it, tests it",
    "could not import 'mc_cnn'": "its OpenCV would replace the one that others are tested with",
}
"""What a machine of CI cannot have, by how its skip begins, and why: no other may skip there."""

if os.environ.get("PHASESTEREO_DATA") == "none":  # said, and so not forgotten
    LACKING["no real data"] = "the pairs are not there to be copied"

ENVIRONMENT = os.environ | {
    "PYTHONPATH": os.pathsep.join(
        [*map(str, PACKAGES), str(ROOT / "tests"), os.environ.get("PYTHONPATH", "")]
    )
}
"""Of processes that import our packages, and this one, from the tree."""

NIGHTLY = "PHASESTEREO_NIGHTLY" in os.environ
"""Whether tests in the folder ``nightly`` run whole: `make nightly`; else they take a sample."""


def sampled(items: Sequence[Item], every: int = 8) -> Sequence[Item]:
    """Return all items at night, else one of this many."""
    return items if NIGHTLY else items[::every]


class EndingError(Exception):
    """What the progress callback of a test raises to end a run."""


def real_data() -> Path:
    """Return the folder of real pairs, if there is one."""
    return Path(os.environ.get("PHASESTEREO_DATA", ROOT / "../shared"))


def counterpart(module: str) -> Any:
    """Return a module that tests hold ours against; skip them where it is missing.

    Elsewhere than in CI, they are also skipped where a library of the system is missing that it
    needs, as libusb.
    """
    return pytest.importorskip(module, exc_type=ModuleNotFoundError if ON_CI else ImportError)

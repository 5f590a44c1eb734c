"""What a figure was measured with: processor, versions, commit."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import shutil
import subprocess
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import phasestereo

# One module, four wheels, of which any may be the one that is installed.
_OPENCV = (
    "opencv-contrib-python-headless",
    "opencv-contrib-python",
    "opencv-python-headless",
    "opencv-python",
)


def describe_environment() -> dict[str, Any]:
    """Describe this machine and the software that figures depend on.

    Returns
    -------
    dict
        ``"kind"``: ``"environment"``; ``"id"``: 12 hexadecimal digits, equal for equal
        environments; ``"cpu"``: name of the processor; ``"cores"``: how many of them this process
        may use; ``"platform"``; ``"versions"``: of Python and of the packages by name, None where
        one is not installed; ``"commit"``: of the checkout that this package is part of, ending in
        ``-dirty`` where files have changed since, None outside of one; ``"date"``: of today, UTC,
        which is not a part of the id.
    """
    facts = {
        "cpu": _cpu(),
        "cores": usable_cpus(),
        "platform": platform.platform(),
        "versions": {
            "python": platform.python_version(),
            "phasestereo": phasestereo.__version__,
            "numpy": _version("numpy"),
            "scipy": _version("scipy"),
            "opencv": _version(*_OPENCV),
        },
        "commit": _commit(Path(phasestereo.__file__)),
    }

    digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()
    today = datetime.now(UTC).date().isoformat()
    return {"kind": "environment", "id": digest[:12], **facts, "date": today}


def usable_cpus() -> int:
    """Return the number of processors of this process."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _cpu() -> str:
    """Return the processor's name; on Linux `platform` knows no more than its architecture."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except OSError:
        lines = []

    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _version(*distributions: str) -> str | None:
    """Return the version of the first of these that is installed."""
    for distribution in distributions:
        try:
            return version(distribution)
        except PackageNotFoundError:
            continue
    return None


def _commit(file: Path) -> str | None:
    """Return the commit of the checkout which a file is part of, None if it is of none.

    A package installed somewhere below another project's checkout is not part of it: git has to
    know the file itself.
    """
    git = shutil.which("git")
    if git is None or _ask(git, file, "ls-files", "--error-unmatch", file.name) is None:
        return None
    return _ask(git, file, "describe", "--always", "--dirty", "--abbrev=40", "--exclude", "*")


def _ask(git: str, file: Path, *arguments: str) -> str | None:
    answer = subprocess.run(  # noqa: S603 - found by which
        [git, "-C", str(file.parent), *arguments],
        env={**os.environ, "GIT_OPTIONAL_LOCKS": "0"},  # somebody may be at work in the checkout
        capture_output=True,
        text=True,
        check=False,
    )
    return answer.stdout.strip() if answer.returncode == 0 else None

"""Describes the processor, the versions and the commit behind a figure."""

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

# Four wheels have the same module; any of them may be installed.
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
        environments; ``"cpu"``: name of the processor; ``"cores"``: number of processors that this
        process may use; ``"platform"``; ``"versions"``: of Python and of the packages by name, None
        if one is not installed; ``"commit"``: of the checkout that this package is part of, ending
        in ``-dirty`` if files have changed since, None outside of one; ``"date"``: today's, UTC,
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
    """Return the processor's name; on Linux `platform` knows only its architecture."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except OSError:
        lines = []

    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _version(*distributions: str) -> str | None:
    """Return the version of the first installed distribution."""
    for distribution in distributions:
        try:
            return version(distribution)
        except PackageNotFoundError:
            continue
    return None


def _commit(file: Path) -> str | None:
    """Return the commit of the checkout that a file is part of; None outside of a checkout.

    A package installed somewhere below another project's checkout is not part of it, so git must
    know the file itself.
    """
    git = shutil.which("git")
    if git is None or _ask(git, file, "ls-files", "--error-unmatch", file.name) is None:
        return None
    return _ask(git, file, "describe", "--always", "--dirty", "--abbrev=40", "--exclude", "*")


def _ask(git: str, file: Path, *arguments: str) -> str | None:
    answer = subprocess.run(  # noqa: S603 - which found git
        [git, "-C", str(file.parent), *arguments],
        env={**os.environ, "GIT_OPTIONAL_LOCKS": "0"},  # somebody may be at work in the checkout
        capture_output=True,
        text=True,
        check=False,
    )
    return answer.stdout.strip() if answer.returncode == 0 else None

"""Code that runs in a process of its own."""

import subprocess
import sys

import pytest

WARNINGS = "-W", "error", "-W", "ignore::UserWarning"
"""Noise is matched; that is warned of, and not what these are about."""


def run(code: str, *, timeout: float = 60) -> subprocess.CompletedProcess[str]:
    """Run Python code in a process of its own."""
    return subprocess.run(  # noqa: S603  # our own interpreter on our own code
        [sys.executable, *WARNINGS, "-c", code],
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )


FORKING = """
import os, signal, warnings
warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 advises against it
import numpy as np, phasestereo as ps
{begin}
child = os.fork()
if child == 0:
    signal.alarm(30)
    os._exit(0 if same() else 3)
_, status = os.waitpid(child, 0)
assert os.waitstatus_to_exitcode(status) == 0, status
assert same()
"""


def run_forking(begin: str) -> subprocess.CompletedProcess[str]:
    """Run code that defines `same`; hold that to be true in a forked child, and then here."""
    return run(FORKING.format(begin=begin))


def return_memory_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make what a process frees go back to the system, whichever thread frees it."""
    monkeypatch.setenv("MALLOC_MMAP_THRESHOLD_", "65536")
    monkeypatch.setenv("MALLOC_TRIM_THRESHOLD_", "65536")

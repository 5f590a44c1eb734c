"""Tests can fail: saying little, not by skipping unseen; and changes of the core are noticed."""

import subprocess
import sys
from pathlib import Path

import pytest

import mutants
from support import ENVIRONMENT, ROOT

FAILING = """
import numpy as np
A = np.random.default_rng(0).random((300, 400))
def test_maps(): assert (A == A + 1).all()
def test_arrays(): np.testing.assert_array_equal(A, A + 1)
def test_lists(): assert A.tolist() == (A + 1).tolist()
def test_bytes(): assert A.tobytes() == (A + 1).tobytes()
def test_words(): raise ValueError("a word " * 5000)
"""


SKIPPING = """
import pytest
def test_what_is_missing(): pytest.skip("no browser")
def test_a_package(): pytest.importorskip("nowhere_to_be_found")
@pytest.mark.skipif(True, reason="no such signals")
def test_a_system(): pass
def test_what_no_machine_has(): pytest.skip("this Python has a GIL; another one has none")
"""
SKIPPING_WHOLE = 'import pytest\npytest.importorskip("nowhere_to_be_found")\n'


def _said(folder: Path, **files: str) -> str:
    """Return the output of pytest on CI for files in a folder."""
    for name, text in files.items():
        (folder / f"{name}.py").write_text(text)
    finished = subprocess.run(  # our own interpreter on our own code
        [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-p",
            "conftest",
            "-p",
            "no:cacheprovider",
            "-p",
            "no:dash",
            ".",
        ],
        env=ENVIRONMENT
        | {"PHASESTEREO_CI": "true", "PYTHONPATH": f"{ENVIRONMENT['PYTHONPATH']}:{ROOT}/tests"},
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    return finished.stdout


def test_a_failure_says_little_also_on_ci(tmp_path: Path) -> None:
    said = _said(tmp_path, test_failing=FAILING)
    assert "5 failed" in said
    assert len(said) < 5 * 1000


def test_nothing_skips_on_ci_but_what_no_machine_of_it_has(tmp_path: Path) -> None:
    said = _said(tmp_path, test_skipping=SKIPPING)
    assert "2 failed, 1 skipped, 1 error" in said
    for reason in "no browser", "could not import 'nowhere_to_be_found'", "no such signals":
        assert f"nothing may skip on CI: {reason}" in said

    assert "1 error" in _said(tmp_path, test_skipping="", test_whole=SKIPPING_WHOLE)


def test_changes_of_the_core_that_no_test_notices_are_counted_and_named() -> None:
    outcomes = [
        {"scenario": "Baseline", "summary": "Success"},
        {"scenario": {"Mutant": {"name": "a.rs:1: replace + with -"}}, "summary": "MissedMutant"},
        {"scenario": {"Mutant": {"name": "b.rs:2: replace + with -"}}, "summary": "CaughtMutant"},
    ]
    found = {"caught": 17, "timeout": 2, "missed": 1, "unviable": 5, "outcomes": outcomes}
    assert mutants.judged(found) == (0.95, ["a.rs:1: replace + with -"])
    with pytest.raises(SystemExit, match="^nothing was changed$"):
        mutants.judged(found | {"caught": 0, "timeout": 0, "missed": 0})

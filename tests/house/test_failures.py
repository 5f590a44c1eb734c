"""What a failing test says: about a line, however large what it compares."""

import subprocess
import sys
from pathlib import Path

from conftest import ENVIRONMENT, ROOT

FAILING = """
import numpy as np
A = np.random.default_rng(0).random((300, 400))
def test_maps(): assert (A == A + 1).all()
def test_arrays(): np.testing.assert_array_equal(A, A + 1)
def test_lists(): assert A.tolist() == (A + 1).tolist()
def test_bytes(): assert A.tobytes() == (A + 1).tobytes()
def test_words(): raise ValueError("a word " * 5000)
"""


def test_a_failure_says_little_also_on_ci(tmp_path: Path) -> None:
    (tmp_path / "test_failing.py").write_text(FAILING)
    finished = subprocess.run(  # our own interpreter on our own code
        [sys.executable, "-m", "pytest", "-q", "-p", "conftest", "-p", "no:cacheprovider", "."],
        env=ENVIRONMENT | {"CI": "true", "PYTHONPATH": f"{ENVIRONMENT['PYTHONPATH']}:{ROOT}/tests"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "5 failed" in finished.stdout
    assert len(finished.stdout) < 5 * 1000

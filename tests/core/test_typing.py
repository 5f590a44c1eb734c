"""The types of the interface: mypy accepts a script that uses all of it and refuses wrong ones."""

import ast
import re
import shutil
import subprocess
import sys

import pytest

import phasestereo as ps
from support import ENVIRONMENT, ROOT, counterpart

WRONG = """

import numpy as np

import phasestereo as ps
import phasestereo_live as live

image = np.zeros((40, 60), np.uint8)
ps.match(image)  # wrong: no right image
result = ps.match(image, image, num_disparities=16)
print(result.disparities)  # wrong: no such field
result.disparity = result.disparity  # wrong: it is frozen
ps.Matcher(preset="robost")  # wrong: no such preset
ps.match(image, image, num_disparites=16)  # wrong: no such argument
ps.match(image, image, window="5")  # wrong: a window is a number
ps.Settings(optimizer="best")  # wrong: no such optimizer
ps.io.read_picture("left.png")  # wrong: no such function
text: str = ps.estimate_blur(image, image, num_disparities=16)  # wrong: it is an estimate
"""
"""What a type checker must not let pass: each line marked so."""


@pytest.fixture(scope="module")
def complaints(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Return the complaints of mypy about the scripts of a user who has installed the package."""
    counterpart("mypy")
    folder = tmp_path_factory.mktemp("user")

    shutil.copy(ROOT / "tests/user_script.py", folder / "right.py")
    (folder / "wrong.py").write_text(WRONG)

    options = "--strict", "--no-error-summary", "--config-file=", f"--cache-dir={folder / 'cache'}"
    finished = subprocess.run(  # noqa: S603  # our own interpreter
        [sys.executable, "-m", "mypy", *options, "right.py", "wrong.py"],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env=ENVIRONMENT,
    )

    assert finished.stderr == ""
    return finished.stdout.splitlines()


def test_a_script_that_uses_all_of_the_interface_type_checks(complaints: list[str]) -> None:
    assert [line for line in complaints if not line.startswith("wrong.py")] == []


def test_a_script_that_is_wrong_does_not(complaints: list[str]) -> None:
    wanted = [n for n, line in enumerate(WRONG.splitlines(), 1) if "# wrong" in line]
    errors = [re.match(r"wrong\.py:(\d+): error", line) for line in complaints]
    assert [int(found[1]) for found in errors if found] == wanted


def test_the_script_names_all_of_the_interface() -> None:
    tree = ast.parse((ROOT / "tests/user_script.py").read_text())
    used = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "ps"
    }
    assert set(ps.__all__) <= used

"""Examples of docstrings: every name at the root has some, and they run."""

import doctest
import inspect
import io
import warnings
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.io import write_disparity, write_image
from phasestereo_bench.rendering import render_pair
from support import counterpart

NAMES = [name for name in ps.__all__ if callable(getattr(ps, name))]
NEEDS_MORE = {"rectify", "register"}
"""Calibrations of cameras that rendered pairs do not have."""

NEEDS = {"Mesh": "PIL", "surface_mesh": "PIL", "Rectification": "cv2"}


@pytest.fixture(scope="module")
def known() -> dict[str, Any]:
    """Return the names that the examples may use."""
    pair = render_pair(2, height=120, width=160, num_disparities=36)
    result = ps.match(pair.left, pair.right, num_disparities=40)
    costs = ps.cost_volume(pair.left, pair.right, num_disparities=40)
    return {
        "ps": ps,
        "np": np,
        "left": pair.left,
        "right": pair.right,
        "image": pair.left,
        "frames": [(pair.left, pair.right)] * 2,
        "truth": pair.truth,
        "calibration": pair.calibration,
        "costs": costs,
        "sums": ps.aggregate(costs, window=9),
        "result": result,
        "disparity": result.disparity,
    }


@pytest.mark.parametrize("name", NAMES)
def test_examples_run(
    name: str, known: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = inspect.getdoc(getattr(ps, name)) or ""
    assert "\nExamples\n--------\n" in text
    examples = doctest.DocTestParser().get_examples(text)
    assert examples
    if name in NEEDS_MORE:
        return
    if name in NEEDS:
        counterpart(NEEDS[name])

    monkeypatch.chdir(tmp_path)
    write_image("left.png", known["left"])
    write_image("right.png", known["right"])
    write_disparity("truth.pfm", known["truth"])
    own = dict(known)
    with warnings.catch_warnings(), redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        for example in examples:
            exec(compile(example.source, name, "single"), own)  # noqa: S102 -- our own docstrings

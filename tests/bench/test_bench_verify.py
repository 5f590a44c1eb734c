"""``phasestereo bench verify``: what it counts, and that it runs on a folder of scenes."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import phasestereo as ps
from phasestereo_bench import verification
from phasestereo_bench.datasets import Pair
from phasestereo_bench.methods import Method
from support import Run


class _Scene:
    """A scene of known pixels: 8 visible ones in the first row, hidden ones in the second."""

    truth = np.array([[0.0] * 8, [2.0] * 8], np.float32)

    def load(self) -> Pair:
        image = np.zeros((2, 8), np.uint8)
        visible = np.array([[True] * 8, [False] * 8])
        masks = {"nonocc": visible, "all": np.ones((2, 8), bool)}
        return Pair("made up", image, image, self.truth, None, masks, 4, None)

    def __str__(self) -> str:
        return "made/up"


def test_shares_are_those_of_the_pixels(monkeypatch: pytest.MonkeyPatch) -> None:
    # Of the visible ones the last four are 3 px off, and all hidden ones are right.
    claims = _Scene.truth.copy()
    claims[0, 4:] = 3

    verdict = np.array([[2, 2, 2, 3, 3, 3, 2, 1], [3, 1, 1, 1, 1, 1, 1, 1]], np.uint8)
    better = np.where(verdict == ps.Verdict.REFUTED, np.float32(0.5), np.float32(np.nan))
    monkeypatch.setattr(ps, "verify", lambda *_, **__: _Said(verdict, better))

    method = Method("made up", lambda *_: claims)
    rows = list(verification.opinions([_Scene()], [method], ["sharp"]))  # type: ignore[list-item]

    ((condition, name, found),) = rows
    assert (condition, name) == ("sharp", "made up")
    assert (found.wrong, found.refuted_wrong, found.refuted_right) == (0.5, 0.5, 0.25)
    assert (found.supported, found.supported_wrong) == (0.5, 0.25)
    assert (found.better, found.refuted_hidden) == (1.0, 0.125)
    # The match has 0 everywhere, and is sure of the first six columns.
    assert (found.differ_wrong, found.differ_right) == (0.5, 0.0)


class _Said:
    """What `verify` returns, as far as it is counted."""

    def __init__(self, verdict: np.ndarray, better: np.ndarray) -> None:
        self.verdict, self.better, self.result = verdict, better, self
        self.disparity = np.zeros((2, 8), np.float32)
        self.confidence = np.repeat([[0.9] * 6 + [0.5] * 2], 2, axis=0)


def test_the_command_prints_a_table(run_bench: Callable[..., Run], data: Path) -> None:
    folder = data / "middlebury/scenes2001/tsukuba"
    code, out, err = run_bench("verify", folder, "--condition", "sharp", "--method", "fast")
    assert code == 0, err
    assert "wrong refuted" in " ".join(out.split())
    assert "tsukuba" not in out
    assert "sharp" in out


def test_the_command_names_conditions_that_there_are(run_bench: Callable[..., Run]) -> None:
    code, _, err = run_bench("verify", "nowhere", "--condition", "fog")
    assert code == 2
    assert "--condition: got 'fog'; accepts sharp, disk 6" in err

"""``phasestereo rig test``: go or no-go."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest

from phasestereo import io
from phasestereo_bench.rendering import render_pair

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from conftest import Run

WRONG, NO_GO = 2, 3


@pytest.fixture(autouse=True)
def recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder: three good pairs in a folder, and one whose rows are off."""
    monkeypatch.chdir(tmp_path)
    pair = render_pair(3, height=240, width=320, num_disparities=32)
    (tmp_path / "pairs").mkdir()
    for index in range(3):
        rng = np.random.default_rng(index)
        for side in ("left", "right"):
            noisy = getattr(pair, side) + rng.normal(0, 2, pair.left.shape)
            image = np.clip(noisy, 0, 255).astype(np.uint8)
            io.write_image(tmp_path / "pairs" / f"{side}{index}.png", image)
    io.write_image("off.png", np.roll(pair.right, 2, axis=0))
    return tmp_path


def test_a_good_rig_is_a_go_and_stays_one_in_its_file(run: Callable[..., Run]) -> None:
    code, out, err = run("rig", "test", "pairs", "--save", "rig.txt")
    assert code == 0, err
    lines = out.splitlines()
    assert [line.split()[0] for line in lines[:3]] == ["go:", "go:", "unknown:"]
    assert lines[0].endswith("at most 0.75 px (rows that do not correspond, root mean square)")

    said = json.loads(run("rig", "test", "--rig", "rig.txt", "--json")[1])
    assert said["go"] is True
    assert said["frames"] == 3
    checks = {one["quantity"]: one for one in said["checks"]}
    assert len(checks) == 9
    assert checks["drift"]["value"] is None
    assert 0 < checks["noise"]["value"] < 0.02


def test_limits_decide(run: Callable[..., Run]) -> None:
    code, out, err = run("rig", "test", "pairs/left0.png", "off.png")
    assert code == NO_GO
    assert "no-go: rows 2" in out
    assert "no-go: rows" in err

    assert run("rig", "test", "pairs", "--noise", "0.001")[0] == NO_GO
    assert run("rig", "test", "pairs", "--rotation", "0.1")[0] == NO_GO  # not told


@pytest.mark.parametrize(
    ("words", "said", "code"),
    [
        ((), "nothing to test: give pairs, or --rig FILE", WRONG),
        (("pairs", "--rows", "-1"), "--rows: got -1; accepts a finite number", WRONG),
        (("--rig", "off.png"), "off.png: ", 1),
        (("--rig", "gone.txt", "--save", "a.txt"), "--calibration, --save: have no effect", WRONG),
        (("pairs", "--calibration", "off.png"), "--calibration: got off.png, which is a", WRONG),
    ],
)
def test_mistakes_are_one_line(
    run: Callable[..., Run], words: tuple[str, ...], said: str, code: int
) -> None:
    got, _, err = run("rig", "test", *words)
    assert got == code
    assert err.startswith(f"phasestereo: error: {said}")
    assert err.count("\n") == 1

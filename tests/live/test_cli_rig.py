"""``phasestereo rig test``: what frames show of two cameras, against limits."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest

import phasestereo as ps
from support import counterpart

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from support import Run

counterpart("cyclopts")
UNTRUSTED = 3


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of frames of one rendered scene, with noise of their own."""
    from phasestereo_bench.rendering import render_pair  # noqa: PLC0415 -- with the counterpart

    pair = render_pair(3, height=200, width=320, num_disparities=32)
    folder, rng = tmp_path_factory.mktemp("frames"), np.random.default_rng(0)
    for number in range(5):
        for side, image in (("left", pair.left), ("right", pair.right)):
            noisy = np.clip(image + rng.normal(0, 1, image.shape), 0, 255).astype(np.uint8)
            ps.io.write_image(folder / f"{side}_{number}.png", noisy)
    return folder


def test_sound_frames_pass_and_a_limit_that_is_not_kept_is_named(
    frames: Path, tmp_path: Path, run: Callable[..., Run]
) -> None:
    code, out, _ = run("rig", "test", frames, "--save", tmp_path / "rig.txt", "--json")
    told = json.loads(out)
    assert (code, told["go"], told["frames"]) == (0, True, 5)
    values = {check["name"]: check["value"] for check in told["checks"]}
    assert values["rows"] < 0.2
    assert 0.004 < values["noise"] < 0.02  # of the gray levels that there are
    assert values["rotation"] is None

    code, out, err = run("rig", "test", tmp_path / "rig.txt", "--limit", "noise=0.001")
    assert code == UNTRUSTED
    assert "no-go: noise" in err
    assert "FAILED: noise" in out
    assert "ok: rows" in out


def test_rows_that_are_off_are_a_rotation(frames: Path) -> None:
    rig = ps.Rig(threads=1)
    for _ in range(3):
        left = ps.io.read_image(frames / "left_0.png")
        rig.match(left, np.roll(ps.io.read_image(frames / "right_0.png"), 3, axis=0))

    checks = {check.name: check for check in rig.test({"rotation": 0.1}, focal=320)}
    assert checks["rows"].passed is False
    assert checks["rows"].value == pytest.approx(3, abs=0.2)
    assert checks["rotation"].value == pytest.approx(np.rad2deg(np.arctan(3 / 320)), abs=0.05)
    assert checks["rotation"].passed is False
    assert checks["drift"].passed is None
    assert "FAILED: rows 3" in str(checks["rows"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--limit", "row=1"), "limits: got 'row'; accepts limits of rows, error"),
        (("--limit", "rows"), "got rows; accepts NAME=NUMBER"),
        (("--limit", "rows=-1"), "rows: got -1"),
        (("--focal", "0"), "focal: got 0"),
    ],
)
def test_limits_that_are_none_are_refused(
    tmp_path: Path, run: Callable[..., Run], words: tuple[str, ...], message: str
) -> None:
    ps.Rig().save(tmp_path / "rig.txt")
    code, out, err = run("rig", "test", tmp_path / "rig.txt", *words)
    assert (code in (1, 2), out) == (True, "")
    assert message in err


def test_a_rig_that_has_seen_nothing_does_not_pass(tmp_path: Path, run: Callable[..., Run]) -> None:
    ps.Rig().save(tmp_path / "rig.txt")
    code, _, err = run("rig", "test", tmp_path / "rig.txt")
    assert code == UNTRUSTED
    assert "no-go: rows, error, wrong" in err

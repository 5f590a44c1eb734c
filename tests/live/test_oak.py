"""The node for DepthAI, in pipelines of DepthAI that need no device."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import pytest

from support import ENVIRONMENT, ROOT, counterpart

counterpart("depthai")
FRAMES = 200


def run(job: str) -> tuple[Any, str]:
    """Run a pipeline in a process of its own, which DepthAI ends where a thread fails."""
    program = ROOT / "tests/live/oak_pipeline.py"
    done = subprocess.run(  # noqa: S603 -- our own program
        [sys.executable, program, job],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    text = done.stdout + done.stderr
    assert done.returncode == 0, text[-2000:]
    return json.loads(done.stdout.splitlines()[-1]), text


def test_200_frames_with_lost_ones_among_them() -> None:
    found, _ = run("frames")
    numbers = [number for number in range(FRAMES) if number not in (50, 60)]
    assert found["frames"] == len(numbers)
    assert found["events"] == 0
    assert len(found["seen"]) == len(numbers)
    for number, outputs in zip(numbers, found["seen"], strict=True):
        assert {each["number"] for each in outputs.values()} == {number}
        assert outputs["disparity"]["median"] == 20 * 32
        assert outputs["depth"]["median"] == 400 * 50 / 20
        assert outputs["confidenceMap"]["median"] == 255
        assert outputs["disparity"]["none"] < 0.05
        assert [outputs[name]["type"] for name in ("disparity", "depth", "confidenceMap")] == [
            "RAW16",
            "RAW16",
            "RAW8",
        ]
        for name in ("disparity", "depth", "confidenceMap", "syncedLeft"):
            assert outputs[name]["seconds"] == pytest.approx(number / 30, abs=1e-5)
            assert outputs[name]["socket"] == 1
        assert outputs["syncedRight"]["seconds"] == pytest.approx(number / 30 + 0.004, abs=1e-5)
        assert outputs["syncedRight"]["socket"] == 2


def test_raw_frames_are_rectified_by_the_calibration_of_the_device() -> None:
    found, _ = run("raw")
    seen = found["seen"]
    assert seen["disparity"]["median"] == pytest.approx(20 * 32, abs=3)
    assert seen["depth"]["median"] == pytest.approx(1000, abs=5)
    assert seen["rectifiedRight"]["type"] == "BGR888i"


def test_a_pair_that_fails_is_logged_and_the_next_one_matched() -> None:
    found, text = run("failures")
    assert "[error] frame 0: right: got 1 x 1 pixels" in text
    assert found["seen"]["disparity"]["number"] == 1
    assert found["seen"]["disparity"]["median"] == 20 * 32
    starts = "calibration: got int", "keep: got 'most'", "preset: got 'best'"
    for message, start in zip(found["refused"], starts, strict=True):
        assert message.startswith(start)

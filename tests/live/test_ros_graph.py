"""The node in a graph of ROS 2: rclpy, its messages and its middleware, in two processes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from support import ENVIRONMENT, ROOT, counterpart

counterpart("rclpy")
PROGRAM = str(ROOT / "tests/live/ros_graph.py")
PAIRS = 5


def test_pairs_that_are_sent_come_back_as_maps_depths_and_points(tmp_path: Path) -> None:
    environment = ENVIRONMENT | {
        "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),  # of tests that run at the same time
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(tmp_path),
    }
    options = "--ros-args", "-p", "preset:=fast", "-p", "disparity_range:=16"
    node = subprocess.Popen(  # noqa: S603  # our own program
        [sys.executable, PROGRAM, "node", *options],
        env=environment, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    with node:
        try:
            done = subprocess.run(  # noqa: S603  # likewise
                [sys.executable, PROGRAM, "pairs"],
                env=environment, capture_output=True, text=True, check=False, timeout=300,
            )  # fmt: skip
        finally:
            node.send_signal(signal.SIGINT)
            said = node.communicate()[1]

    assert node.returncode == 0, said
    assert "Traceback" not in said
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout.splitlines()[-1])
    for stamps in found["stamps"].values():
        assert len(stamps) >= PAIRS
        assert stamps == sorted(set(stamps))
    assert found["frames"] == ["left_optical"]
    assert all(one == [80, pytest.approx(0.12)] for one in found["geometry"])
    assert set(found["disparity"]) == {5}
    assert found["depth"] == [pytest.approx(80 * 0.12 / 5)] * len(found["depth"])
    assert found["points"] == [pytest.approx(80 * 0.12 / 5)] * len(found["points"])
    assert "phasestereo: alignment" in found["statuses"]

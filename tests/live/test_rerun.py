"""What is logged to rerun, read back from a file by rerun itself."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
import phasestereo_live as live
from phasestereo_live.rerun import log_failure, log_frame, saving
from support import counterpart
from support.footage import COLS, COUNT, ROWS, pair, shift

rerun = counterpart("rerun")

if TYPE_CHECKING:
    from phasestereo_live.video.streaming import Failure


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def frames(count: int, failures: list[Failure] | None = None) -> live.Stream:
    pairs: list[Any] = [pair(index) for index in range(count)]
    if failures is not None:
        pairs[1] = None
    on_error = None if failures is None else failures.append
    return live.stream(pairs, num_disparities=COUNT, preset="fast", on_error=on_error)


def rows(path: str, entity: str) -> list[dict[str, Any]]:
    """Return the records of one place, a row for each time."""
    found = []
    for chunk in counterpart("rerun.chunk").RrdReader(path).stream():
        if chunk.entity_path == f"/{entity}":
            batch = chunk.to_record_batch()
            found += batch.to_pylist()
    return sorted(found, key=lambda row: row.get("frame", -1))


def column(row: dict[str, Any], name: str) -> Any:
    (value,) = [value for key, value in row.items() if key.endswith(name)]
    return value[0]


def test_frames_are_on_the_timeline_as_they_were_matched() -> None:
    expected = list(frames(3))

    with saving("a.rrd") as recording:
        for frame in expected:
            log_frame(frame, low=0, high=COUNT, recording=recording)
    assert [path.name for path in Path().iterdir()] == ["a.rrd"]

    for view in ("left", "right"):
        images = rows("a.rrd", f"stereo/{view}")
        assert [row["frame"] for row in images] == [0, 1, 2]
        for row, frame in zip(images, expected, strict=True):
            data = np.array(column(row, ":buffer"), np.uint8)
            np.testing.assert_array_equal(data.reshape(ROWS, COLS, 3), getattr(frame, view))

    for row, frame in zip(rows("a.rrd", "stereo/disparity"), expected, strict=True):
        data = np.array(column(row, ":buffer"), np.uint8).view(np.float32)
        np.testing.assert_array_equal(data.reshape(ROWS, COLS), frame.result.disparity)
        assert column(row, ":depth_range") == [0, COUNT]
        assert column(row, ":meter") == 1


def test_points_are_those_of_the_library() -> None:
    camera = ((100.0, 0.0, 48.0), (0.0, 100.0, 32.0), (0.0, 0.0, 1.0))
    calibration = ps.io.Calibration(
        cam0=camera, cam1=camera, doffs=0.0, baseline=60.0, width=COLS, height=ROWS, unit="mm"
    )

    (frame,) = frames(1)
    with saving("a.rrd") as recording:
        log_frame(frame, entity="rig", calibration=calibration, recording=recording)

    (row,) = rows("a.rrd", "rig/points")
    (points,) = [value for key, value in row.items() if key.endswith(":positions")]
    cloud = ps.point_cloud(frame.result, calibration, image=frame.left)
    np.testing.assert_allclose(np.array(points, np.float32), cloud.points / 1000, rtol=1e-6)
    assert np.median(np.array(points)[:, 2]) == pytest.approx(6 / shift(0), rel=1e-3)

    # The camera is where the left image is, and its depths, in m, are below it.
    (pinhole,) = [row for row in rows("a.rrd", "rig/left") if any("image_from" in k for k in row)]
    np.testing.assert_array_equal(column(pinhole, ":image_from_camera"), np.ravel(camera, "F"))
    assert column(pinhole, ":resolution") == [COLS, ROWS]
    (below,) = rows("a.rrd", "rig/left/depth")
    depth = np.array(column(below, ":buffer"), np.uint8).view(np.float32)
    assert column(below, ":meter") == 1
    np.testing.assert_allclose(depth[depth > 0], cloud.points[:, 2] / 1000, rtol=1e-6)

    (colors,) = [value for key, value in row.items() if key.endswith(":colors")]
    assert cloud.colors is not None
    np.testing.assert_array_equal(
        np.array(colors, np.uint32) >> 8, cloud.colors.astype(np.uint32) @ [65536, 256, 1]
    )


def test_time_and_failures_are_logged() -> None:
    failures: list[Failure] = []
    for _ in frames(3, failures):
        pass

    with saving("a.rrd") as recording:
        log_failure(live.Failure(7, 1.5, failures[0].error), recording=recording)

    (row,) = rows("a.rrd", "stereo/failures")
    assert row["frame"] == 7
    assert row["time"].total_seconds() == 1.5
    assert column(row, ":text").startswith("frame 7: source: got NoneType")
    assert column(row, ":level") == "WARN"


def test_error_half_way_leaves_what_was_logged() -> None:
    (frame,) = frames(1)
    with pytest.raises(RuntimeError), saving("a.rrd") as recording, recording:  # noqa: PT012 - the block is what is tested
        log_frame(frame)  # to the current recording
        raise RuntimeError
    assert len(rows("a.rrd", "stereo/left")) == 1


def test_what_cannot_be_logged_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    (frame,) = frames(1)

    with pytest.raises(ValueError, match="^low: got 3 and high None"):
        log_frame(frame, low=3)

    with pytest.raises(ValueError, match=r"must end in .rrd, got 'a.mp4'"), saving("a.mp4"):
        pass

    monkeypatch.setitem(__import__("sys").modules, "rerun", None)
    with pytest.raises(ImportError, match=r"pip install 'phasestereo\[rerun\]'"):
        log_frame(frame)

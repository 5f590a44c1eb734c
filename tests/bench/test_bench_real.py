"""Recordings of real rigs, and real pairs: what is found in them, and what is scored."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from phasestereo.io import write_image
from phasestereo_bench.real import find_recording, real_jobs, recording_jobs
from phasestereo_bench.real.agreement import confirmed, score_frame
from phasestereo_bench.real.frames import read_frame
from phasestereo_bench.real.pairs import find_pairs, load_pair, score_pair
from phasestereo_bench.real.rows import corresponding, score_rows
from phasestereo_bench.store import read_store
from support import counterpart

Run = Callable[..., tuple[int, str, str]]

for module in ("cv2", "yaml"):
    counterpart(module)

GRAY = np.arange(600, dtype=np.uint16).reshape(20, 30).astype(np.uint8)


# Frames


def test_frames_are_found_by_their_names(tmp_path: Path) -> None:
    for name in ("cam0/a.png", "cam0/b.png", "cam1/b.png"):
        (tmp_path / "rig" / name).parent.mkdir(exist_ok=True, parents=True)
        write_image(tmp_path / "rig" / name, GRAY)
    (files,) = find_recording(tmp_path / "rig").frames
    assert [path.name for path in files] == ["b.png", "b.png"]

    for name in ("left_1.png", "right_1.png"):
        write_image(tmp_path / name, GRAY)
    write_image(tmp_path / "left_2.png", GRAY)  # without its right one
    write_image(tmp_path / "wide.png", np.hstack([GRAY, 255 - GRAY]))
    write_image(tmp_path / "other.png", GRAY)

    recording = find_recording(tmp_path)
    names = [tuple(path.name for path in files) for files in recording.frames]
    assert names == [("left_1.png", "right_1.png"), ("wide.png",)]

    left, right = read_frame(recording.frames[1])
    np.testing.assert_array_equal(left, GRAY)
    np.testing.assert_array_equal(right, 255 - GRAY)


def test_the_recordings_that_there_are(data: Path) -> None:
    euroc = find_recording(data / "rigs/euroc")
    assert [len(files) for files in euroc.frames] == [2] * 6

    cheap = find_recording(data / "rigs/stereopi")
    assert [len(files) for files in cheap.frames] == [2] * 4 + [1] * 3
    left, right = read_frame(cheap.frames[-1])
    assert left.shape == right.shape == (240, 320, 3)

    jobs = recording_jobs(euroc, ["fast"])
    assert len(jobs) == 6 * 3
    assert len({tuple(job.key.items()) for job in jobs}) == len(jobs)


# Rows


class Rig:
    """A rectification that only moves columns, and the right rows by 3."""

    def __init__(self) -> None:
        y, x = np.mgrid[0:40, 0:60].astype(np.float32)
        self.maps = (x + 2, y), (x - 1, y + 3)


def test_places_show_the_same_by_the_calibration() -> None:
    rig: Any = Rig()
    places = corresponding(rig, np.array([0.0, 4.0]), (40, 60))
    np.testing.assert_array_equal(places.right_y - places.left_y, 3)
    assert set(places.left_x - places.right_x) == {3, 7}
    assert min(places.right_x) >= 0
    assert max(places.right_y) <= 39


def test_rows_of_raw_frames_are_found_as_the_calibration_has_them(data: Path) -> None:
    recording = find_recording(data / "rigs/euroc")
    scores = score_rows(recording.folder, recording.frames[0])
    assert scores["delivered"] == pytest.approx(13.1, abs=0.2)
    assert scores["rectify"] < 0.4
    assert scores["match"] < 1.5
    assert scores["calibrated"] < 0.1


def test_disparities_are_confirmed_within_a_pixel() -> None:
    left = np.array([[0.0, 1, 1, 2.6, np.nan, 9]])
    right = np.array([[1.0, 3.0, np.nan, 0, 0, 0]])
    #  0: right 0 says 1; 1: right 0 says 1; 2: right 1 says 3; 3: right 0 says 1; 5: outside
    expected = [[True, True, False, False, False, False]]
    np.testing.assert_array_equal(confirmed(left, right), expected)


# Agreement


def shifted(left: NDArray[np.uint8], _right: Any, _count: int) -> NDArray[np.float32]:
    """Match a pair whose disparity is 6 everywhere."""
    return np.full(left.shape[:2], 6, np.float32)


def test_a_right_map_agrees_with_itself(data: Path) -> None:
    recording = find_recording(data / "rigs/euroc")
    spec = f"{__name__}:shifted"
    scores = score_frame(recording.folder, recording.frames[0], spec, rectified=False)
    assert scores["agreement"] == pytest.approx((752 - 6) / 752)
    assert scores["trusted"] is None


def test_rectified_frames_agree_more_than_raw_ones(data: Path) -> None:
    recording = find_recording(data / "rigs/euroc")
    frame = recording.folder, recording.frames[0]
    raw, good = (score_frame(*frame, "robust", rectified=state) for state in (False, True))
    assert 0.8 < good["agreement"] < 0.95
    assert raw["agreement"] < good["agreement"] - 0.05
    assert 0.8 < good["trusted"] <= 1


# Pairs


def test_real_pairs_are_matched(data: Path) -> None:
    there = find_pairs(data)
    assert list(there) == ["exposure", "focus"]

    pair = load_pair("focus", there["focus"])
    assert (pair.left.shape, set(np.unique(pair.truth))) == (pair.right.shape, {16})

    assert score_pair("focus", there["focus"], "robust")["bad_1"] < 0.5
    assert score_pair("exposure", there["exposure"], "robust")["bad_1"] < 6

    assert (len(real_jobs(data, ["fast", "robust"])), find_pairs(there["focus"])) == (4, {})


# The command


def test_the_command_shows_what_was_scored(data: Path, tmp_path: Path, run: Run) -> None:
    name = find_recording(data / "rigs/euroc").frames[0][0].name
    for camera in ("cam0", "cam1"):
        (tmp_path / "rig" / camera).mkdir(parents=True)
        for file in (name, "sensor.yaml"):
            shutil.copy(data / "rigs/euroc" / camera / file, tmp_path / "rig" / camera / file)

    store = tmp_path / "recordings.jsonl"
    command = ["bench", "recordings", tmp_path / "rig", "--method", "fast", "-o", store]

    code, out, err = run(*command, "--workers", 0)
    assert code == 0, err
    assert "rig, rectified" in out
    assert re.search(r"rig +1 +13\.\d\d", out)

    kinds = [line["kind"] for line in read_store(store)]
    assert kinds == ["environment", "recording-rows", "recording-frame", "recording-frame"]

    code, _, err = run("bench", "recordings")
    assert (code, "where are the frames?" in err) == (1, True)

"""Files under construction: every writer beside every other one, and beside a batch that begins."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from phasestereo import PointCloud
from phasestereo.io import read_disparity, write_disparity, write_image, write_ply
from phasestereo.io.drafts import publish, remove_abandoned, replacing
from phasestereo_large import outofcore
from phasestereo_large.batch import PairFiles, Record, read_manifest, run
from phasestereo_large.batch.manifest import Manifest
from phasestereo_large.geotiff import write_geotiff
from support import ENVIRONMENT, counterpart

if TYPE_CHECKING:
    from collections.abc import Callable

MAP = np.arange(12.0, dtype=np.float32).reshape(3, 4)
on_posix = pytest.mark.skipif(os.name != "posix", reason="no modes, and no locks of this kind")


def write_video(path: Path) -> None:
    counterpart("av")
    video = counterpart("phasestereo_live.video")
    with video.VideoWriter(path) as writer:
        for _ in range(3):
            writer.write(np.zeros((16, 16, 3), np.uint8))


def write_recording(path: Path) -> None:
    counterpart("rosbags")
    bags = counterpart("phasestereo_live.ros.bags")
    with bags.RecordingWriter(path) as writer:
        for stamp in range(3):
            writer.write("/a", stamp, writer.make("std_msgs/msg/String", data="text"))


def write_manifest(path: Path) -> None:
    manifest = Manifest(path.parent)
    manifest.add(Record(name="a", state="failed", left="l", right="r", num_disparities=1,
                        min_disparity=0, recipe="x"))  # fmt: skip
    manifest.save(["a"])


def write_map(path: Path) -> None:
    views = path.with_name("left.npy"), path.with_name("right.npy")
    outofcore.match(*views, path, num_disparities=4, max_memory="8GB", preset="fast", threads=1)


WRITERS: dict[str, Callable[[Path], object]] = {
    "a.pfm": lambda path: write_disparity(path, MAP),
    "a.tif": lambda path: write_disparity(path, MAP),
    "a.png": lambda path: write_image(path, MAP.astype(np.uint8)),
    "a.ply": lambda path: write_ply(path, PointCloud(np.ones((2, 3), np.float32), None)),
    "geo.tif": lambda path: write_geotiff(path, MAP),
    "a.mp4": write_video,
    "a.mcap": write_recording,
    "a.bag": write_recording,
    "large.npy": write_map,
    "manifest.jsonl": write_manifest,
}


def write_often(path: Path) -> None:
    for _ in range(4):
        WRITERS[path.name](path)


def test_writers_in_one_folder_leave_the_drafts_of_each_other(tmp_path: Path) -> None:
    view = np.random.default_rng(0).integers(0, 256, (40, 50), np.uint8)
    for side in ("left", "right"):
        np.save(tmp_path / f"{side}.npy", view)
    is_over = threading.Event()

    def clean() -> None:
        while not is_over.is_set():
            remove_abandoned(tmp_path)

    cleaner = threading.Thread(target=clean)
    cleaner.start()
    try:
        with ThreadPoolExecutor(len(WRITERS)) as threads:
            tasks = [threads.submit(write_often, tmp_path / name) for name in WRITERS]
        for task in tasks:
            task.result()
    finally:
        is_over.set()
        cleaner.join()

    found = {path.name for path in tmp_path.iterdir()}
    assert found == {"left.npy", "right.npy", *WRITERS}
    np.testing.assert_array_equal(read_disparity(tmp_path / "a.pfm"), MAP)
    assert list(read_manifest(tmp_path / "manifest.jsonl")) == ["a"]


KILLED = """
import os, signal, sys
from phasestereo.io.drafts import replacing
with replacing(sys.argv[1]) as file:
    file.write(b"half")
    print("open", flush=True)
    sys.stdin.read()
    os.kill(os.getpid(), signal.SIGKILL)
"""


@on_posix
def test_a_batch_removes_the_drafts_of_the_dead_alone(tmp_path: Path) -> None:
    process = subprocess.Popen(  # noqa: S603  # our own interpreter on our own code
        [sys.executable, "-c", KILLED, str(tmp_path / "a")],
        env=ENVIRONMENT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline() == "open\n"

    others = [tmp_path / name for name in (".0123456789abcdef.part", "b.1234.part.mp4")]
    for other in others:
        other.touch()
    (tmp_path / ".phasestereo-recording.part").mkdir()
    pair = PairFiles(name="pair", left=Path("missing"), right=Path("missing"))
    batch: Any = partial(run, [pair], tmp_path, workers=1, retries=0)

    def drafts() -> list[Path]:
        return [path for path in tmp_path.glob(".phasestereo-*.part") if path.is_file()]

    with replacing(tmp_path / "c") as ours:
        ours.write(b"whole")
        batch()
        assert len(drafts()) == 2
        process.communicate()
        batch()
        assert len(drafts()) == 1

    assert drafts() == []
    assert all(other.exists() for other in others)
    assert (tmp_path / "c").read_bytes() == b"whole"
    assert not (tmp_path / "a").exists()


@on_posix
def test_a_file_that_is_replaced_keeps_its_mode_and_a_new_one_follows_the_mask(
    tmp_path: Path,
) -> None:
    path, draft, plain = tmp_path / "a", tmp_path / "draft", tmp_path / "plain"
    plain.touch()
    path.touch(0o600)
    with replacing(path) as file:
        (hidden,) = tmp_path.glob(".phasestereo-*.part")
        assert hidden.stat().st_mode & 0o777 == 0o600  # from the beginning
        file.write(b"b")
    assert (path.read_bytes(), path.stat().st_mode & 0o777) == (b"b", 0o600)

    draft.touch()
    publish(draft, path)
    assert path.stat().st_mode & 0o777 == 0o600

    with replacing(tmp_path / "new"):
        pass
    assert (tmp_path / "new").stat().st_mode == plain.stat().st_mode

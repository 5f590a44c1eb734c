"""Our messages in the code of ROS 1's own consumers, as Debian has them: no node, no master.

``apt-get install libdepth-image-proc-dev libstereo-image-proc-dev libopencv-dev`` on Debian 12; or
these packages, and what they depend on, unpacked to a folder that PHASESTEREO_ROS1 names.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from phasestereo_bench.rendering import render_pair
from support import robots
from support.robots import INFOS, ROS1, START, TOPICS, Bag, rosbag1

if TYPE_CHECKING:
    from collections.abc import Callable

    from support import Run

ROOT = Path(os.environ.get("PHASESTEREO_ROS1", "/"))
SIZE = COLS, ROWS = 160, 120
FOCAL, BASELINE, COUNT = 150.0, 0.12, 32
LIBRARIES = (
    "stereo_image_proc", "image_proc", "image_geometry", "roscpp_serialization", "rostime",
    "cpp_common", "rosconsole", "opencv_calib3d", "opencv_imgproc", "opencv_core",
)  # fmt: skip


@pytest.fixture(scope="module")
def consumers(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., None]:
    """Return a function that runs the program."""
    headers, machine = ROOT / "usr/include", "x86_64-linux-gnu"
    compiler = shutil.which("c++")
    if not (headers / "depth_image_proc").is_dir() or compiler is None:
        pytest.skip("no headers of ROS 1: apt-get install libdepth-image-proc-dev")
    libraries = ROOT / "usr/lib" / machine
    places = "", "opencv4", machine, f"{machine}/opencv4"
    program = tmp_path_factory.mktemp("ros") / "ros_points"
    words: list[Any] = [
        compiler, "-std=c++17", "-w", *(f"-I{headers / place}" for place in places),
        Path(__file__).with_name("ros_points.cpp"), "-o", program, f"-L{libraries}",
        f"-Wl,-rpath-link,{libraries}", "-Wl,--allow-shlib-undefined",
        *(f"-l{name}" for name in LIBRARIES),
    ]  # fmt: skip
    subprocess.run(words, check=True, timeout=300)  # noqa: S603  # our own program
    found = ":".join(str(libraries / place) for place in ("", "blas", "lapack"))

    def run(*paths: Path) -> None:
        environment = os.environ | {"LD_LIBRARY_PATH": found}
        subprocess.run([program, *paths], check=True, env=environment, timeout=60)  # noqa: S603

    return run


def unpacked(path: Path, folder: Path) -> Path:
    """Write the first message of each topic of a recording as it is, to files named by topics."""
    folder.mkdir()
    with rosbag1.Reader(path) as reader:
        for connection, _, data in reader.messages():
            file = folder / connection.topic.strip("/").replace("/", "_")
            if not file.exists():
                file.write_bytes(data)
    return folder


@pytest.mark.parametrize("case", [
    ("32FC1", 1e-5, 1), ("16UC1", 1e-3, 1), ("32FC1", 1e-5, 3),
])  # fmt: skip
def test_they_make_our_points(
    run: Callable[..., Run],
    tmp_path: Path,
    consumers: Callable[..., None],
    case: tuple[str, float, int],
) -> None:
    encoding, most, blocks = case
    pair = render_pair(5, height=ROWS, width=COLS, num_disparities=COUNT)
    bag = Bag(ROS1)
    for topic, camera in zip(INFOS, robots.straight(SIZE, FOCAL, BASELINE), strict=True):
        bag.add(topic, START, robots.info(ROS1, SIZE, camera))
    for topic, view in zip(TOPICS, (pair.left, pair.right), strict=True):
        message = robots.image(ROS1, START, np.ascontiguousarray(view[:, :, ::-1]), "bgr8")
        bag.add(topic, START, message)
    source = bag.write(tmp_path / "in.bag")

    kinds = "--messages", "disparity", "depth", "points", "--depth-encoding", encoding
    options: tuple[Any, ...] = *kinds, "--num-disparities", COUNT, "--keep", "all"
    options += "--decimate", blocks
    code, _, err = run("live", source, "-o", tmp_path / "out.bag", *options)
    assert code == 0, err
    given, made = (unpacked(tmp_path / f"{name}.bag", tmp_path / name) for name in ("in", "out"))
    space = "decimated/" if blocks > 1 else ""
    spaced = space.replace("/", "_")
    files = [made / f"rig_{spaced}depth", made / f"rig_{spaced}camera_info"]
    files += [given / f"rig_{side}_camera_info" for side in ("left", "right")]
    files += [made / "rig_disparity", given / "rig_left_image_raw"]
    outputs = tmp_path / "depth", tmp_path / "disparity"
    consumers(*files, *outputs)

    (_, cloud) = robots.read(tmp_path / "out.bag")[f"/rig/{space}points2"][0]
    ours = cloud.data.view("<f4").reshape(-1, 4)[:, :3]
    known = np.isfinite(ours[:, 2])
    assert known.mean() > 0.8
    of_depth, of_disparity = (np.fromfile(path, "<f4").reshape(-1, 3) for path in outputs)
    np.testing.assert_array_equal(np.isfinite(of_depth[:, 2]), known)
    assert np.linalg.norm(of_depth[known] - ours[known], axis=1).max() < most  # m
    if blocks > 1:
        return  # disparities have the size of the image
    # OpenCV, which it asks, takes the least disparity of a map for one that is missing.
    there = known & np.isfinite(of_disparity[:, 2])
    assert there.sum() > 0.99 * known.sum()
    assert np.linalg.norm(of_disparity[there] - ours[there], axis=1).max() < 1e-5

"""What recordings say of their cameras: windows, binning, sizes, and baselines in transforms."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
import phasestereo_live as live
from phasestereo.io import Calibration
from phasestereo_live import ros
from phasestereo_live.ros.transforms import baseline_of, pose_between
from support import counterpart, librealsense, robots
from support.robots import INFOS, ROS1, ROS2, START, TOPICS, Bag, rosbag1

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from support import Run

cv2 = counterpart("cv2")

SIZE = COLS, ROWS = 180, 120
FOCAL, BASELINE, SHIFT = 300.0, 0.1, 20  # 1.5 m
RNG = np.random.default_rng(0)
SCENE = RNG.integers(0, 256, (ROWS, COLS + SHIFT), np.uint8)
VIEWS = SCENE[:, :COLS].copy(), SCENE[:, SHIFT:].copy()


def depths(run: Callable[..., Run], path: Path, out: Path, *more: object) -> tuple[float, str]:
    """Return the median depth of a recording, and what was said of it."""
    code, _, err = run("live", path, "-o", out, "--num-disparities", 48, *more)
    assert code == 0, err
    found = robots.read(out)
    topic = next((one for one in found if one.endswith("depth")), None)
    if topic is None:
        return np.nan, err
    return float(np.nanmedian(found[topic][0][1].data.view("<f4"))), err


def matrices(factor: float, baseline: float = BASELINE) -> list[dict[str, Any]]:
    """Return K, D, R, P of cameras whose images are this many times as large."""
    size = round(factor * COLS), round(factor * ROWS)
    return robots.straight(size, factor * FOCAL, baseline)


WINDOWS = [
    (SIZE, 1, {}, {}, 1.5),
    ((360, 240), 2, {"binning": 2}, {"binning": 2}, 1.5),
    ((360, 240), 2, {}, {}, 1.5),  # the driver forgot to say that it halves
    ((640, 480), 1, {"window": (140, 120, 180, 120)}, {"window": (140, 120, 180, 120)}, 1.5),
    ((640, 480), 1, {"window": (140, 120, 180, 120)}, {"window": (130, 120, 180, 120)}, 1.0),
    ((800, 600), 2, {"window": (9, 8, 360, 240), "binning": 2},
     {"window": (9, 8, 360, 240), "binning": 2}, 1.5),
]  # fmt: skip
"""Size of the sensor, times the usual focal length, left and right camera_info, depth."""


@pytest.mark.parametrize("case", WINDOWS)
def test_binning_windows_and_sizes_change_the_geometry(
    run: Callable[..., Run], tmp_path: Path, case: Any
) -> None:
    size, factor, *more, depth = case
    bag = Bag()
    for info, one, how in zip(INFOS, matrices(factor), more, strict=True):
        bag.add(info, START, robots.info(ROS2, size, one, **how))
    for topic, view in zip(TOPICS, VIEWS, strict=True):
        bag.add(topic, START, robots.image(ROS2, START, view, "mono8"))
    found, err = depths(run, bag.write(tmp_path / "in.mcap"), tmp_path / "out.mcap")
    # Cropped 10 columns apart disparities are 10 px less than those of whole images.
    assert found == pytest.approx(depth, rel=1e-3)
    assert ("is scaled to 180 x 120" in err) == (size == (360, 240) and not more[0])


@pytest.mark.parametrize(("size", "more", "message"), [
    ((640, 480), ({}, {}), "calibration: got that of 640 x 480 pixels; accepts"),
    ((640, 480), ({"window": (9, 8, 180, 120)}, {"window": (9, 18, 180, 120)}),
     "rows of rectified images are 10 px apart"),
])  # fmt: skip
def test_windows_that_do_not_fit_are_refused(
    tmp_path: Path, size: Any, more: Any, message: str
) -> None:
    bag = Bag()
    for info, one, how in zip(INFOS, matrices(1), more, strict=True):
        bag.add(info, START, robots.info(ROS2, size, one, **how))
    for topic, view in zip(TOPICS, VIEWS, strict=True):
        bag.add(topic, START, robots.image(ROS2, START, view, "mono8"))
    with pytest.raises(ValueError, match=message):
        ros.open_recording(bag.write(tmp_path / "in.mcap"))


def above(path: Path, *, by_transform: bool = False, turn: float = 0.0) -> Path:
    """Write a recording of cameras one above the other, the lower one the right one.

    By P the distance is known, or else by transforms; turned frames are raw.
    """
    rotation = cv2.Rodrigues(np.array([0, 0, turn]))[0]
    size, bag = (ROWS, COLS), Bag()
    straight = robots.straight(size, FOCAL, 0.0)
    if not by_transform:
        straight[1]["P"][1, 3] = -FOCAL * BASELINE
    for info, one, frame in zip(INFOS, straight, ("left_optical", "right_optical"), strict=True):
        matrices = one | {"R": rotation.ravel()}
        bag.add(info, START, robots.info(ROS2, size, matrices, frame=frame))
    made = ROS2.types
    stamped = made["geometry_msgs/msg/TransformStamped"](
        header=robots.header(ROS2, START, "left_optical"),
        child_frame_id="right_optical",
        transform=transform(ROS2, 0.0, BASELINE),
    )
    bag.add("/tf_static", START, made["tf2_msgs/msg/TFMessage"](transforms=[stamped]))
    k = straight[0]["K"]
    back = k @ rotation.T @ np.linalg.inv(k)  # from rectified pixels to raw ones
    for topic, view in zip(TOPICS, VIEWS, strict=True):
        stood = np.ascontiguousarray(np.rot90(view, -1))
        stood = cv2.warpPerspective(stood, back, size) if turn else stood
        bag.add(topic, START, robots.image(ROS2, START, stood, "mono8"))
    return bag.write(path)


@pytest.mark.parametrize("how", [{}, {"by_transform": True}, {"turn": 0.03}])
def test_cameras_one_above_the_other(
    run: Callable[..., Run], tmp_path: Path, how: dict[str, Any]
) -> None:
    path = above(tmp_path / "in.mcap", **how)
    found, err = depths(run, path, tmp_path / "out.mcap", "--messages", "depth", "points")
    assert found == pytest.approx(1.5, rel=2e-3), err
    _, depth = robots.read(tmp_path / "out.mcap")["/rig/depth"][0]
    assert (depth.height, depth.width) == (COLS, ROWS)
    assert np.isfinite(depth.data.view("<f4")).mean() > 0.7

    recording = ros.open_recording(path)
    with live.stream(recording, rectify=recording.cameras, vertical=recording.vertical) as frames:
        assert next(frames).result.vertical
    assert recording.vertical
    assert (recording.cameras is not None) == ("turn" in how)


# Recordings of RealSense


def test_a_recording_of_librealsense_gives_meters(run: Callable[..., Run], tmp_path: Path) -> None:
    """400 px x 50 mm / 20 px = 1 m, by /tf_static alone: P has no baseline."""
    recorded, place = librealsense.record(SCENE, tmp_path / "new.db3"), "image"
    if recorded.read_bytes().startswith(b"#ROSBAG"):  # SDK 2.56 writes one, whatever its name
        recorded, place = recorded.rename(tmp_path / "old.bag"), "info"
    found, err = depths(run, recorded, tmp_path / "out.mcap")
    assert found == pytest.approx(1.0, abs=1e-3)
    assert f"/device_0/sensor_0/Infrared_1/{place}/camera_info" in err


def transform(types: Any, x: float, y: float = 0.0) -> Any:
    made = types.types
    return made["geometry_msgs/msg/Transform"](
        translation=made["geometry_msgs/msg/Vector3"](x=x, y=y, z=0.0),
        rotation=made["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=-1.0),
    )


@pytest.mark.parametrize("known", [True, False])
def test_an_old_recording_of_librealsense(
    run: Callable[..., Run],
    tmp_path: Path,
    known: bool,  # noqa: FBT001 -- a parameter of the test
) -> None:
    """As SDK 2.55 writes it: R = P = 0, four bytes behind each image, transforms by stream."""
    blank = {"D": np.zeros(5), "R": np.zeros(9), "P": np.zeros(12)}
    with rosbag1.Writer(tmp_path / "old.bag") as writer:
        for side, one, view in zip((1, 2), matrices(1), VIEWS, strict=True):
            stream = f"/device_0/sensor_0/Infrared_{side}"
            info = robots.info(ROS1, SIZE, {"K": one["K"]} | blank, "Brown Conrady", frame="")
            messages: list[tuple[str, Any, bytes]] = [
                (f"{stream}/info/camera_info", info, b""),
                (f"{stream}/image/data", robots.image(ROS1, START, view, "8UC1"), bytes(4)),
            ]
            if known:
                shift = transform(ROS1, -BASELINE * (side - 1))
                messages.append((f"{stream}/tf/1", shift, b""))
            for topic, message, surplus in messages:
                kind = message.__msgtype__
                connection = writer.add_connection(topic, kind, typestore=ROS1)
                data = bytes(ROS1.serialize_ros1(message, kind)) + surplus
                writer.write(connection, START, data)

    found, err = depths(run, tmp_path / "old.bag", tmp_path / "out.mcap")
    assert found == pytest.approx(1.5, rel=1e-3) if known else np.isnan(found)
    assert ("no baseline in camera_info or /tf_static: there are no depths" in err) != known


COLOR, PLACE = "/rig/color/camera_info", (0.03, 0.01)


def with_color(path: Path, *, joined: bool = True) -> Path:
    """Write a recording of a pair and of where a color camera is, which has a distortion."""
    bag = Bag()
    for info, one in zip(INFOS, matrices(1), strict=True):
        bag.add(info, START, robots.info(ROS2, SIZE, one))
    color = robots.straight((240, 160), 350.0, 0.0)[0] | {"D": np.array([-0.1, 0.02, 0, 0, 0])}
    bag.add(COLOR, START, robots.info(ROS2, (240, 160), color, frame="color_optical"))
    made = ROS2.types
    stamped = made["geometry_msgs/msg/TransformStamped"](
        header=robots.header(ROS2, START, "left_optical" if joined else "elsewhere"),
        child_frame_id="color_optical",
        transform=transform(ROS2, *PLACE),
    )
    bag.add("/tf_static", START, made["tf2_msgs/msg/TFMessage"](transforms=[stamped]))
    for topic, view in zip(TOPICS, VIEWS, strict=True):
        bag.add(topic, START, robots.image(ROS2, START, view, "mono8"))
    return bag.write(path)


def test_depths_of_a_recording_are_registered_to_its_color_camera(
    run: Callable[..., Run], tmp_path: Path
) -> None:
    path = with_color(tmp_path / "in.mcap")
    _, err = depths(run, path, tmp_path / "out.mcap", "--register", COLOR, "--no-temporal-filter")
    found = robots.read(tmp_path / "out.mcap")
    maps = {
        name.removeprefix("/rig/registered/"): messages[0][1]
        for name, messages in found.items()
        if "registered" in name
    }
    assert {*maps} == {"camera_info", "depth", "near", "far", "confidence"}, err
    info = maps.pop("camera_info")
    assert (info.k[0], info.d[0], info.distortion_model) == (350, -0.1, "plumb_bob")

    camera = ps.ThirdCamera(
        matrix=info.k, distortion=info.d, rotation=np.eye(3),
        translation=np.array([-0.03, -0.01, 0]), width=240, height=160,
    )  # fmt: skip
    rig = Calibration.from_focal(FOCAL, BASELINE, width=COLS, height=ROWS, unit="m")
    result = ps.match(*VIEWS, num_disparities=48)
    wanted = ps.register(result, rig, camera).maps
    for name, message in maps.items():
        assert (message.width, message.height, message.encoding) == (240, 160, "32FC1")
        assert message.header.frame_id == info.header.frame_id == "color_optical"
        values = message.data.view("<f4").reshape(160, 240)
        np.testing.assert_allclose(values, wanted[name], rtol=1e-5)
    depth = maps["depth"].data.view("<f4")
    assert np.nanmedian(depth) == pytest.approx(1.5, rel=1e-3)
    assert np.isfinite(depth).mean() > 0.3


@pytest.mark.parametrize("encoding", ["32FC1", "16UC1"])
def test_depths_and_points_of_blocks(
    run: Callable[..., Run], tmp_path: Path, encoding: str
) -> None:
    bag = Bag()
    for info, one in zip(INFOS, matrices(1), strict=True):
        bag.add(info, START, robots.info(ROS2, SIZE, one))
    for topic, view in zip(TOPICS, VIEWS, strict=True):
        bag.add(topic, START, robots.image(ROS2, START, view, "mono8"))
    options: tuple[Any, ...] = "--decimate", 4, "--messages", "depth", "points", "disparity"
    options += "--no-temporal-filter", "--depth-encoding", encoding, "--num-disparities", 48
    out = tmp_path / "out.mcap"
    code, _, err = run("live", bag.write(tmp_path / "in.mcap"), "-o", out, *options)
    assert code == 0, err
    found = {name.removeprefix("/rig/"): sent[0][1] for name, sent in robots.read(out).items()}
    assert {*found} == {
        "disparity", "camera_info", "decimated/depth", "decimated/points2", "decimated/camera_info",
    }  # fmt: skip
    depth, info = found["decimated/depth"], found["decimated/camera_info"]
    assert (depth.width, depth.height) == (info.width, info.height) == (COLS // 4, ROWS // 4)
    rig = Calibration.from_focal(FOCAL, BASELINE, width=COLS, height=ROWS, unit="m")
    np.testing.assert_allclose(info.k.reshape(3, 3), rig.decimated(4).cam0)

    result = ps.match(*VIEWS, num_disparities=48)
    wanted = ps.depth_interval(result, rig, decimate=4).depth
    values = depth.data.view("<f4" if encoding == "32FC1" else "<u2").reshape(wanted.shape)
    if encoding == "16UC1":
        millimeters = np.rint(1000 * wanted.astype(float))
        held = millimeters < 2**16  # false for NaN
        np.testing.assert_array_equal(values, np.where(held, millimeters, 0))
    else:
        known = np.isfinite(wanted)
        np.testing.assert_array_equal(values[known], wanted[known])
        assert not np.isfinite(values[~known]).any()
    points = found["decimated/points2"].data.view("<f4").reshape(*wanted.shape, 4)
    z, (x, y) = points[..., 2], np.meshgrid(np.arange(COLS // 4), np.arange(ROWS // 4))
    known = np.isfinite(z)
    assert known.mean() > 0.7
    k = info.k.reshape(3, 3)
    np.testing.assert_allclose(points[..., 0][known], ((x - k[0, 2]) / k[0, 0] * z)[known], 1e-4)
    np.testing.assert_allclose(points[..., 1][known], ((y - k[1, 2]) / k[1, 1] * z)[known], 1e-4)


def test_a_third_camera_that_is_not_known_is_refused(tmp_path: Path) -> None:
    path = with_color(tmp_path / "in.mcap", joined=False)
    for topic, message in (
        (COLOR, "register: no transforms join 'left_optical' and 'color_optical'"),
        (TOPICS[0], "register: got '/rig/left/image_raw', not a topic of camera_info"),
    ):
        with pytest.raises(ValueError, match=message):
            ros.open_recording(path, register=topic)


def test_a_baseline_leads_through_a_chain_of_transforms() -> None:
    base, left, right = "base", "left", "right"
    chain = [(base, left, transform(ROS2, 3.0, 1.0)), (base, right, transform(ROS2, 3.12, 1.0))]
    assert baseline_of(pose_between(chain, left, right)) == pytest.approx((0.12, 0))
    assert baseline_of(pose_between(chain, right, left)) is None  # exchanged
    assert baseline_of(pose_between(chain, left, "elsewhere")) is None
    assert baseline_of(pose_between(chain, left, left)) is None
    below = [(base, left, transform(ROS2, 1.0)), (base, right, transform(ROS2, 1.001, 0.1))]
    assert baseline_of(pose_between(below, left, right)) == pytest.approx((0, 0.1))
    aslant = [(base, left, transform(ROS2, 0.0)), (base, right, transform(ROS2, 0.1, 0.1))]
    assert baseline_of(pose_between(aslant, left, right)) is None


@pytest.mark.parametrize(("one", "other"), [
    ("left", "right"), ("infra1", "infra2"), ("Infrared_1", "Infrared_2"), ("cam0", "cam1"),
    ("cam_l", "cam_r"), ("top", "bottom"),
])  # fmt: skip
def test_topics_are_guessed_by_the_names_that_cameras_give(
    tmp_path: Path, one: str, other: str
) -> None:
    bag = Bag()
    topics = f"/rig/{one}/image_raw", f"/rig/{other}/image_raw"
    for topic, view in zip(topics, VIEWS, strict=True):
        bag.add(topic, START, robots.image(ROS2, START, view, "mono8"))
        packed = robots.compressed(ROS2, START, view, "PNG", "png")
        bag.add(f"{topic}/compressed", START, packed)
    bag.add("/rig/color/image_raw", START, robots.image(ROS2, START, VIEWS[0], "mono8"))
    source = ros.open_recording(bag.write(tmp_path / "in.mcap"))
    source.close()
    assert source.topics == topics

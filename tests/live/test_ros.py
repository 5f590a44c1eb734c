"""Recordings of robots: read and written without ROS, and held against what rosbags says."""

from __future__ import annotations

import json
import re
import struct
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.io import Calibration
from phasestereo.views.depths import Selection
from phasestereo_live import ros, stream
from phasestereo_live.ros import reading
from phasestereo_live.ros.images import decode_image, encode_image
from phasestereo_live.ros.messages import ranged_depth
from phasestereo_live.ros.output import FrameWriter
from support import counterpart, hostile, robots
from support.rigs import SIZE, made_up, of_opencv
from support.robots import INFOS, ROS1, ROS2, START, TOPICS, Bag

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from support import Run

STEP = 50_000_000  # ns
COLS, ROWS, COUNT = 96, 64, 16
FOCAL, BASELINE = 80.0, 0.12


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder, an empty one."""
    monkeypatch.chdir(tmp_path)
    return Path()


def pair(index: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return a color pair of one disparity."""
    scene = np.random.default_rng(index).integers(0, 256, (ROWS, COLS + 9, 3), np.uint8)
    return scene[:, : -3 - index], scene[:, 3 + index :][:, : COLS + 6 - index]


def cut(index: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return a color pair of the usual size."""
    left, right = pair(index)
    return left[:, :COLS], right[:, :COLS]


def recording(
    path: Path,
    count: int = 3,
    *,
    types: Any = ROS2,
    topics: tuple[str, str] = TOPICS,
    doffs: float = 0.0,
    packed: str = "none",
) -> Path:
    """Write a recording of some pairs from cameras that need no rectification."""
    bag = Bag(types)
    for topic, matrices in zip(
        INFOS, robots.straight((COLS, ROWS), FOCAL, BASELINE, doffs), strict=True
    ):
        bag.add(topic, START, robots.info(types, (COLS, ROWS), matrices))

    for index in range(count):
        for topic, view, late in zip(topics, cut(index), (0, 1_000_000), strict=True):
            stamp = START + index * STEP + late
            bag.add(
                topic,
                stamp,
                robots.image(types, stamp, np.ascontiguousarray(view[:, :, ::-1]), "bgr8"),
            )

    return bag.write(path, packed)


def live(run: Callable[..., Run], path: Path, *more: object) -> Run:
    topics = "--left", TOPICS[0], "--right", TOPICS[1], "--no-temporal-filter"
    return run("live", path, *topics, "--num-disparities", COUNT, "--preset", "fast", *more)


# Images


@pytest.mark.parametrize("pad", [0, 5])
@pytest.mark.parametrize(
    ("encoding", "dtype", "channels", "order"),
    [
        ("mono8", "u1", 1, [0]),
        ("mono16", "<u2", 1, [0]),
        ("mono16", ">u2", 1, [0]),
        ("32FC1", "<f4", 1, [0]),
        ("rgb8", "u1", 3, [0, 1, 2]),
        ("bgr8", "u1", 3, [2, 1, 0]),
        ("rgba8", "u1", 4, [0, 1, 2]),
        ("bgra8", "u1", 4, [2, 1, 0]),
    ],
)
def test_encodings_are_read_exactly(
    encoding: str, dtype: str, channels: int, order: list[int], pad: int
) -> None:
    samples = np.random.default_rng(0).integers(0, 200, (4, 6, channels)).astype(dtype)
    found = decode_image(robots.image(ROS2, START, samples, encoding, pad))
    expected = samples[:, :, order]
    np.testing.assert_array_equal(found, expected[:, :, 0] if channels == 1 else expected)
    assert found.dtype.isnative


@pytest.mark.parametrize("order", ["rggb", "bggr", "gbrg", "grbg"])
@pytest.mark.parametrize("bits", [8, 16])
def test_bayer_patterns_become_colors(order: str, bits: int) -> None:
    color = {"r": 200, "g": 120, "b": 40}
    raw = np.zeros((8, 8), f"u{bits // 8}")
    for place, letter in enumerate(order):
        raw[place // 2 :: 2, place % 2 :: 2] = color[letter]
    found = decode_image(robots.image(ROS2, START, raw, f"bayer_{order}{bits}"))
    np.testing.assert_array_equal(found[2:-2, 2:-2], np.full((4, 4, 3), [200, 120, 40]))


def test_compressed_images_are_read() -> None:
    left, _ = cut(0)
    png = decode_image(robots.compressed(ROS2, START, left, "png", "bgr8; png compressed bgr8"))
    np.testing.assert_array_equal(png, left)
    smooth = np.ascontiguousarray(np.broadcast_to(np.arange(COLS, dtype=np.uint8), (ROWS, COLS)))
    jpeg = decode_image(robots.compressed(ROS2, START, smooth, "jpeg", "mono8; jpeg compressed "))
    assert np.abs(jpeg.astype(int) - smooth).max() <= 3


def test_images_that_are_none_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(made: Any, pattern: str, **changes: Any) -> None:
        for name, value in changes.items():
            setattr(made, name, value)
        with pytest.raises(ValueError, match=f"^{pattern}") as raised:
            decode_image(made)
        assert len(str(raised.value)) < 400

    message = robots.image(ROS2, START, cut(0)[0].copy(), "rgb8")
    refused(message, r"image: got 96 x 64 pixels with rows of 287 bytes", step=287)
    refused(message, r"image: cut short, it has 18431 bytes", step=288, data=message.data[:-1])
    refused(message, r"encoding: got 'x{40}'\.\.\.; accepts mono8", encoding="x" * 100_000)

    packed = robots.compressed(ROS2, START, cut(0)[0], "png", "png")
    monkeypatch.setenv("PHASESTEREO_MAX_PIXELS", "6143")
    refused(packed, "image: the header says 96 x 64 pixels; at most 6143")
    refused(robots.image(ROS2, START, cut(0)[0].copy(), "rgb8"), "image: the header says 96 x 64")

    monkeypatch.delenv("PHASESTEREO_MAX_PIXELS")
    refused(packed, "image: ", data=packed.data[:99])
    refused(packed, "format: got 'png'; accepts jpeg and png", data=packed.data[4:])


def test_topics_are_guessed_where_only_two_can_be_meant(
    run: Callable[..., Run], tmp_path: Path
) -> None:
    recording(tmp_path / "in.mcap", types=ROS2, doffs=2.0)
    source = ros.open_recording(tmp_path / "in.mcap")
    source.close()
    assert source.topics == TOPICS
    out = tmp_path / "out.mcap"
    code, _, err = run("live", tmp_path / "in.mcap", "-o", out, "--preset", "fast")
    assert code == 0, err
    # Points take the most room, and are written where they are asked for.
    assert sorted(robots.read(out)) == [
        "/diagnostics", "/rig/camera_info", "/rig/depth", "/rig/disparity",
    ]  # fmt: skip


def test_arrays_go_through_messages() -> None:
    for array in (cut(0)[0], np.eye(3, dtype=np.uint16), np.full((2, 3), np.nan, np.float32)):
        message = ROS2.types["sensor_msgs/msg/Image"](header=None, **encode_image(array))
        np.testing.assert_array_equal(decode_image(message), array)


# Recordings that are packed


def taken(path: Path) -> list[Any]:
    """Return the pairs of a recording."""
    with closing(ros.open_recording(path, *TOPICS)) as source:
        return [capture.take() for capture in source.captures]


@pytest.mark.parametrize(("name", "packed"), [
    ("a.bag", "bz2"), ("a.bag", "lz4"), ("a.mcap", "storage"), ("a", "message"), ("a", "file"),
])  # fmt: skip
def test_packed_recordings_are_read(tmp_path: Path, name: str, packed: str) -> None:
    types = ROS1 if name == "a.bag" else ROS2
    pairs = taken(recording(tmp_path / name, types=types, packed=packed))
    for index, (found, expected) in enumerate(zip(pairs, map(cut, range(3)), strict=True)):
        np.testing.assert_array_equal(found, expected, str(index))


@pytest.mark.parametrize("claimed", [10, 2**31])
@pytest.mark.parametrize("packed", ["bz2", "lz4"])
def test_a_chunk_unpacks_to_what_it_claims(tmp_path: Path, packed: str, claimed: int) -> None:
    path = recording(tmp_path / "a.bag", types=ROS1, packed=packed)
    content = bytearray(path.read_bytes())
    struct.pack_into("<I", content, content.index(b"size=") + 5, claimed)
    path.write_bytes(content)
    with pytest.raises(ValueError, match=rf"a\.bag: claims to unpack to {claimed} bytes"):
        taken(path)


@pytest.mark.parametrize(("content", "message"), [
    (hostile.zstd_zeros(2**31), "claims to unpack to 2147483648 bytes; records have"),
    (hostile.zstd_zeros(2**31, said=False), "does not say to how much it unpacks"),
])  # fmt: skip
def test_a_packed_message_says_to_how_much_it_unpacks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: bytes, message: str
) -> None:
    writing = counterpart("rosbags.rosbag2.writer")
    monkeypatch.setattr(writing, "zstd", SimpleNamespace(compress=lambda _: content))
    path = recording(tmp_path / "a", packed="message")
    with pytest.raises(ValueError, match=f"a: .*{message}"):
        taken(path)


def test_a_packed_file_does_not_fill_the_disk(tmp_path: Path) -> None:
    path = recording(tmp_path / "a", packed="file")
    (file,) = path.glob("*.zstd")
    file.write_bytes(hostile.zstd_zeros(2**29))
    with pytest.raises(ValueError, match=r"a: unpacks to more than 100 times its size"):
        taken(path)


def test_chunks_that_overlap_are_bounded_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = recording(tmp_path / "a.mcap")
    monkeypatch.setattr(reading, "_TOGETHER", 1000)
    with pytest.raises(ValueError, match=r"a\.mcap: chunks of one time unpack to more than 1000"):
        taken(path)


# From recording to recording


@pytest.mark.parametrize("source", ["in.mcap", "in.bag", "folder", "folder/folder.db3"])
@pytest.mark.parametrize("target", ["out.mcap", "out.bag", "out.db3"])
def test_a_recording_goes_through(
    run: Callable[..., Run], tmp_path: Path, source: str, target: str
) -> None:
    types = ROS1 if source.endswith(".bag") else ROS2
    recording(tmp_path / source.partition("/")[0], types=types, doffs=2.0)

    out = tmp_path / target
    kinds = "disparity", "depth", "points", "diagnostics"
    code, _, err = live(run, tmp_path / source, "-o", out, "--messages", *kinds)
    assert code == 0, err

    found = robots.read(out)
    assert sorted(found) == [
        "/diagnostics", "/rig/camera_info", "/rig/depth", "/rig/disparity", "/rig/points2",
    ]  # fmt: skip
    for index, (time, message) in enumerate(found["/rig/disparity"]):
        assert time == START + index * STEP
        check_disparity(message, index)
        check_depth(found["/rig/depth"][index][1], message)
        check_info(found["/rig/camera_info"][index], found["/rig/depth"][index])
        check_points(found["/rig/points2"][index][1], found["/rig/depth"][index][1], index)

    assert index == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(
        {source.partition("/")[0], target}
    )


def test_error_bars_are_images_beside_the_disparities(
    run: Callable[..., Run], tmp_path: Path
) -> None:
    out = tmp_path / "out.mcap"
    more = "--confidence", "--messages", "uncertainty", "confidence"
    code, _, err = live(run, recording(tmp_path / "in.mcap"), "-o", out, *more)
    assert code == 0, err

    found = robots.read(out)
    assert sorted(found) == ["/rig/camera_info", "/rig/confidence", "/rig/uncertainty"]
    for index, (time, message) in enumerate(found["/rig/uncertainty"]):
        result = ps.match(*cut(index), num_disparities=COUNT, preset="fast", confidence=True)
        assert time == START + index * STEP
        assert message.encoding == "32FC1"
        values = message.data.view("<f4").reshape(ROWS, COLS)
        np.testing.assert_array_equal(values, result.uncertainty)


def stamp_of(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def check_disparity(message: Any, index: int) -> None:
    """Hold a DisparityImage against the match of the same frames, and the convention."""
    expected = ps.match(*cut(index), num_disparities=COUNT, preset="fast").disparity

    values = message.image.data.view("<f4").reshape(ROWS, COLS)
    assert (message.image.encoding, message.image.step) == ("32FC1", 4 * COLS)
    np.testing.assert_array_equal(values, expected + 2)  # doffs: Z = f T / d
    assert stamp_of(message) == stamp_of(message.image) == START + index * STEP

    assert message.header.frame_id == "left_optical"
    assert message.f == FOCAL
    assert getattr(message, "t", getattr(message, "T", None)) == pytest.approx(BASELINE)
    assert (message.min_disparity, message.max_disparity) == (2, COUNT - 1 + 2)
    assert message.delta_d == 1

    window = message.valid_window
    assert (window.x_offset, window.y_offset, window.width, window.height) == (0, 0, COLS, ROWS)


def check_depth(depth: Any, disparity: Any) -> None:
    values = disparity.image.data.view("<f4")
    found = depth.data.view("<f4")
    known = np.isfinite(found)
    assert known.mean() > 0.8
    np.testing.assert_allclose(found[known], FOCAL * BASELINE / values[known], rtol=1e-6)
    assert depth.encoding == "32FC1"


def check_info(info: tuple[int, Any], depth: tuple[int, Any]) -> None:
    """Hold a camera_info to the camera, and to the header of the images that it is beside."""
    (time, message), (wanted, image) = info, depth
    assert time == wanted
    assert stamp_of(message) == stamp_of(image)
    assert message.header.frame_id == image.header.frame_id == "left_optical"
    assert (message.width, message.height) == (image.width, image.height)

    k, d, r, p = (
        np.asarray(getattr(message, name, getattr(message, name.lower(), None))) for name in "KDRP"
    )
    (left, _) = robots.straight((COLS, ROWS), FOCAL, BASELINE)
    np.testing.assert_allclose(k.reshape(3, 3), left["K"])
    np.testing.assert_allclose(p.reshape(3, 4), left["P"])
    np.testing.assert_array_equal(r.reshape(3, 3), np.eye(3))
    assert not d.any()


def test_depths_out_of_range_are_infinite(run: Callable[..., Run], tmp_path: Path) -> None:
    """REP 117 and 118: what is too far is +Inf, too near -Inf, and NaN is not known."""
    rows, cols = 4, 6
    disparity = np.full((rows, cols), 5, np.float32)
    disparity[0] = [0, 0.05, 1, np.nan, 15, 10]  # 0 and 15 are the ends of the range
    flags = np.zeros((rows, cols), np.uint16)
    confidence = np.ones((rows, cols), np.float32)
    confidence[1, 0] = 0.1  # not trusted
    search = ps.SearchRange(0, 16, "given")
    bars = np.full((rows, cols), 0.1, np.float32)  # so that 0.05 may be infinitely far
    result = ps.Result(
        disparity, flags, confidence, ps.Settings(), {}, uncertainty=bars, search=search
    )
    rig = Calibration.from_focal(100, 0.1, width=cols, height=rows)
    selection = Selection(min_depth=1.5, max_depth=8.0)  # 10 px is 1 m, 1 px is 10 m, 5 px is 2 m

    inf = np.inf
    found = ranged_depth(result, rig)
    np.testing.assert_allclose(found[0], [inf, inf, 10, np.nan, -inf, 1], rtol=1e-6)
    assert np.isnan(found[1, 0])
    assert ranged_depth(result, rig, Selection(keep="all"))[1, 0] == pytest.approx(2)
    cut = ranged_depth(result, rig, selection)
    np.testing.assert_array_equal(cut[0], [inf, inf, inf, np.nan, -inf, -inf])
    assert cut[2, 2] == pytest.approx(2)

    # In mm all of these are 0, and points are beyond the range.
    recording(tmp_path / "in.mcap", 1)
    out = tmp_path / "out.mcap"
    options = "--messages", "depth", "points", "--min-depth", 1, "--max-depth", 2
    for encoding in ("32FC1", "16UC1"):
        code, _, err = live(
            run, tmp_path / "in.mcap", "-o", out, *options, "--depth-encoding", encoding
        )
        assert code == 0, err
        written = robots.read(out)
        values = written["/rig/depth"][0][1].data.view("<f4" if encoding == "32FC1" else "<u2")
        z = written["/rig/points2"][0][1].data.view("<f4").reshape(-1, 4)[:, 2]
        assert set(z[~np.isnan(z)].tolist()) == {inf}  # 80 px x 0.12 m / 3 px is 3.2 m
        wanted = [inf] if encoding == "32FC1" else [0]
        assert np.unique(values[~np.isnan(values)]).tolist() == wanted


def test_open3d_makes_our_points_of_depth_and_camera_info(
    run: Callable[..., Run], tmp_path: Path
) -> None:
    open3d = counterpart("open3d")
    out = tmp_path / "out.mcap"
    options = "--messages", "depth", "points", "--confidence"
    code, _, err = live(run, recording(tmp_path / "in.mcap", 1), "-o", out, *options)
    assert code == 0, err
    found = robots.read(out)
    (_, info), (_, depth), (_, cloud) = (
        found[f"/rig/{name}"][0] for name in ("camera_info", "depth", "points2")
    )
    camera = open3d.camera.PinholeCameraIntrinsic(
        info.width, info.height, info.k[0], info.k[4], info.k[2], info.k[5]
    )
    meters = depth.data.view("<f4").reshape(ROWS, COLS)
    image = open3d.geometry.Image(np.where(np.isfinite(meters), meters, 0).astype(np.float32))
    made = open3d.geometry.PointCloud.create_from_depth_image(
        image, camera, depth_scale=1.0, depth_trunc=1e6
    )
    points = cloud.data.view("<f4").reshape(-1, 4)[:, :3]
    ours = points[np.isfinite(points[:, 2])]
    assert len(ours) > COLS * ROWS / 2
    np.testing.assert_allclose(np.asarray(made.points), ours, atol=1e-3)


def check_points(cloud: Any, depth: Any, index: int) -> None:
    """Hold points against `phasestereo.point_cloud`, and the layout of stereo_image_proc."""
    assert [(one.name, one.offset, one.datatype) for one in cloud.fields] == [
        ("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("rgb", 12, 7),
    ]  # fmt: skip

    assert (cloud.height, cloud.width, cloud.point_step, cloud.row_step) == (
        ROWS,
        COLS,
        16,
        16 * COLS,
    )

    points = cloud.data.view("<f4").reshape(-1, 4)
    np.testing.assert_array_equal(points[:, 2], depth.data.view("<f4"))

    result = ps.match(*cut(index), num_disparities=COUNT, preset="fast")
    geometry = Calibration.from_focal(FOCAL, BASELINE, width=COLS, height=ROWS, doffs=2.0)
    expected = ps.point_cloud(result, geometry)
    known = np.isfinite(points[:, 2])
    np.testing.assert_allclose(points[known, :3], expected.points, rtol=1e-5, atol=1e-6)

    colors = cloud.data.reshape(-1, 16)[known, 12:15]
    assert expected.colors is not None
    np.testing.assert_array_equal(colors[:, ::-1], expected.colors)


def test_what_has_no_estimate_is_below_the_range(run: Callable[..., Run], tmp_path: Path) -> None:
    recording(tmp_path / "in.mcap", 1)

    more = "--lr-check", "1", "--no-fill", "--depth-encoding", "16UC1"
    out = tmp_path / "out.mcap"
    code, _, err = live(run, tmp_path / "in.mcap", "-o", out, *more, "--min-disparity", -2)
    assert code == 0, err

    found = robots.read(out)
    message, depth = found["/rig/disparity"][0][1], found["/rig/depth"][0][1]
    values = message.image.data.view("<f4")

    settings: dict[str, Any] = {"lr_check": 1, "fill": False, "preset": "fast"}
    result = ps.match(*cut(0), num_disparities=COUNT, min_disparity=-2, **settings)
    missing = np.isnan(result.disparity).ravel()

    assert missing.any()
    np.testing.assert_array_equal(values[missing], -3)
    assert values[~missing].min() >= message.min_disparity == -2

    assert depth.encoding == "16UC1"
    assert not depth.data.view("<u2")[missing].any()

    known = values > 0
    millimetres = 1000 * FOCAL * BASELINE / values[known].astype(float)
    np.testing.assert_allclose(depth.data.view("<u2")[known], millimetres, atol=0.51)


def test_diagnostics_tell_what_check_finds_once_a_second(tmp_path: Path) -> None:
    recording(tmp_path / "in.mcap", 25)

    source = ros.open_recording(tmp_path / "in.mcap", *TOPICS)
    with ros.RecordingWriter(tmp_path / "out.mcap") as writer:
        out = FrameWriter(writer, TOPICS, kinds=["diagnostics"])
        for frame in stream(source, num_disparities=COUNT, preset="fast"):
            out.write(frame, source.headers.pop(frame.index), None)

    diagnostics = robots.read(tmp_path / "out.mcap")["/diagnostics"]
    assert [time - START for time, _ in diagnostics] == [0, 20 * STEP]

    expected = ps.check(*cut(0))
    status = {one.name: one for one in diagnostics[0][1].status}
    assert list(status) == list(
        dict.fromkeys(f"phasestereo: {one.topic}" for one in expected.findings)
    )

    for one in expected.findings:
        assert one.sentence in status[f"phasestereo: {one.topic}"].message
        assert status[f"phasestereo: {one.topic}"].level == (one.severity == "warning")

    values = {one.key: float(one.value) for one in status["phasestereo: saturation"].values}
    assert values["left.bright"] == pytest.approx(expected.saturation[0].bright, rel=1e-5)


# Geometry


def test_camera_info_rectifies_as_opencv_does(tmp_path: Path) -> None:
    rig = made_up()

    of_cv = of_opencv(rig, SIZE)
    random = np.random.default_rng(0)
    raw = [random.integers(0, 256, SIZE[::-1], np.uint8) for _ in range(2)]

    bag = Bag()
    for side, info, topic, view in zip("12", INFOS, TOPICS, raw, strict=True):
        names = {"K": f"K{side}", "D": f"D{side}"}
        given = {key: rig[name] for key, name in names.items()}
        given |= {"R": of_cv[f"R{side}"], "P": of_cv[f"P{side}"]}
        bag.add(info, START, robots.info(ROS2, SIZE, given))
        bag.add(topic, START, robots.image(ROS2, START, view, "mono8"))

    source = ros.open_recording(bag.write(tmp_path / "in.mcap"), *TOPICS)
    assert source.note == f"frames are rectified by {INFOS[0]} and {INFOS[1]}"
    assert source.q is not None
    np.testing.assert_allclose(source.q / source.q[0, 0], of_cv["Q"], atol=1e-9)

    (frame,) = stream(source, num_disparities=COUNT, preset="fast", rectify=source.cameras)
    known: dict[str, Any] = {name: rig[name] for name in ("K1", "D1", "K2", "D2")}
    known |= {name: of_cv[name] for name in ("R1", "R2", "P1", "P2")}

    expected = ps.rectify(raw[0], raw[1], known)
    np.testing.assert_array_equal(frame.left, expected.left)
    np.testing.assert_array_equal(frame.right, expected.right)


def test_the_name_says_that_images_are_rectified(tmp_path: Path) -> None:
    rect = TOPICS[0].replace("raw", "rect"), TOPICS[1].replace("raw", "rect")
    source = ros.open_recording(recording(tmp_path / "in.mcap", topics=rect), *rect)
    assert source.cameras is None
    assert source.q is not None
    source.close()


def test_without_camera_info_there_are_disparities(run: Callable[..., Run], tmp_path: Path) -> None:
    bag = Bag()
    for topic, view in zip(("/l", "/r"), cut(0), strict=True):
        bag.add(topic, START, robots.image(ROS2, START, view.copy(), "rgb8"))

    source, out = bag.write(tmp_path / "in.mcap"), tmp_path / "out.mcap"
    line = "live", source, "--left", "/l", "--right", "/r", "--num-disparities", COUNT
    code, _, err = run(*line, "--preset", "fast", "-o", out)
    assert code == 0
    assert "no /camera_info" in err

    found = robots.read(out)
    assert sorted(found) == ["/diagnostics", "/disparity"]
    assert found["/disparity"][0][1].f == 0

    code, _, err = run(*line, "--preset", "fast", "-o", out, "--messages", "points")
    assert code == 2
    assert "--messages: points needs camera_info" in err


# What goes wrong


def test_frames_without_a_partner_are_counted_and_reported(
    run: Callable[..., Run], tmp_path: Path
) -> None:
    bag = Bag()
    late = {1: 20_000_000, 3: 20_000_000}  # ns: beyond the tolerance

    for index in range(5):
        for side, (topic, view) in enumerate(zip(TOPICS, cut(0), strict=True)):
            stamp = START + index * STEP + late.get(index, 0) * side
            bag.add(topic, stamp, robots.image(ROS2, stamp, view.copy(), "rgb8"))

    source = bag.write(tmp_path / "in.mcap")
    code, out, err = live(run, source, "--json", "-o", tmp_path / "out.mcap")
    assert code == 0

    said = json.loads(out)
    assert (said["frames"], said["failed"], said["unpaired"]) == (3, 4, 4)
    assert re.search(r"skipped frame 1: the left frame of 1700000000\.050 s has no right one", err)
    assert "the next one is 0.020 s later" in err

    times = [time - START for time, _ in robots.read(tmp_path / "out.mcap")["/rig/disparity"]]
    assert times == [0, 2 * STEP, 4 * STEP]

    code, out, _ = live(run, source, "--json", "--tolerance", 0.02)
    assert json.loads(out)["frames"] == 5


def test_a_camera_that_stops_does_not_fill_the_memory(tmp_path: Path) -> None:
    bag = Bag()

    gray = np.zeros((2, 2), np.uint8)
    for index in range(200):
        for topic in TOPICS[: 1 if index else 2]:
            bag.add(
                topic, START + index * STEP, robots.image(ROS2, START + index * STEP, gray, "mono8")
            )

    source = ros.open_recording(bag.write(tmp_path / "in.mcap"), *TOPICS)
    captures = list(source.captures)
    source.close()
    assert len(captures) == 200

    with pytest.raises(ros.UnpairedError, match=r"has no right one within 0\.01 s$"):
        captures[-1].take()


def test_a_damaged_frame_fails_alone(run: Callable[..., Run], tmp_path: Path) -> None:
    bag = Bag()

    for index in range(3):
        for topic, view in zip(TOPICS, cut(0), strict=True):
            stamp = START + index * STEP
            message = robots.image(ROS2, stamp, view.copy(), "rgb8")
            if index == 1:
                message.data = message.data[:-7]
            bag.add(topic, stamp, message)

    out = tmp_path / "out.mcap"
    code, _, err = live(run, bag.write(tmp_path / "in.mcap"), "-o", out)
    assert code == 0
    assert "skipped frame 1: left: image: cut short" in err
    assert len(robots.read(out)["/rig/disparity"]) == 2


def test_what_is_finished_is_kept(run: Callable[..., Run], tmp_path: Path) -> None:
    """A chunk in the middle is damaged: what came before is written, and the fault is named."""
    path = tmp_path / "in.mcap"
    bag = Bag()
    large = np.random.default_rng(0).integers(0, 256, (600, 900), np.uint8)

    for index in range(4):
        for topic in TOPICS:
            stamp = START + index * STEP
            bag.add(topic, stamp, robots.image(ROS2, stamp, large, "mono8"))
    bag.write(path)

    content = bytearray(path.read_bytes())
    middle = len(content) * 5 // 8
    start = content.find(large.tobytes(), middle)
    content[start - 200 : start] = b"\xff" * 200  # lengths and offsets of a message
    path.write_bytes(content)

    out = tmp_path / "out.mcap"
    code, _, err = live(run, path, "-o", out, "--messages", "disparity")
    assert code == 0
    assert "skipped frame" in err
    assert "in.mcap: " in err
    assert 1 <= len(robots.read(out)["/rig/disparity"]) < 4


@pytest.mark.parametrize(
    ("line", "code", "message"),
    [
        (
            "in.mcap --left /rig/left/image_raw --json --right /no",
            2,
            "--right: got '/no', not a topic",
        ),
        (
            "in.mcap --left /rig/left/image_raw --right /rig/left/image_raw --json",
            2,
            "--right: got /rig",
        ),
        (
            "in.mcap --left /rig/left/camera_info --json --right /x",
            2,
            "--left: got '/rig/left/camera_info'",
        ),
        ("in.mcap {} --camera-info /a /b --json", 2, "--camera-info: got '/a', not a topic"),
        (
            "in.mcap {} --json --messages depth",
            2,
            "--messages: has no effect without -o of a recording",
        ),
        ("in.mcap {} -o out.db4", 2, "--output: path of a video must end in"),
        ("in.mcap {} -o text.bag/out.mcap", 1, "text.bag: File exists"),
        ("in.mcap {} -o in.mcap", 2, "--output: in.mcap is an input or another"),
        ("in.mcap {} -o there.db3", 1, "there.db3"),
        (
            "in.mcap {} -o out.mcap --depth-encoding 64FC1",
            2,
            "--depth-encoding",
        ),
        ("a.mp4 --left /l --json", 2, "--left: has no effect without a recording"),
        ("a.mp4 -o out.mcap", 2, "--output: a recording is written of a recording"),
    ],
)
def test_wrong_commands_are_refused(
    run: Callable[..., Run], folder: Path, line: str, code: int, message: str
) -> None:
    recording(Path("in.mcap"), 1)
    Path("text.bag").write_text("no recording")
    Path("there.db3").mkdir()

    before = sorted(folder.iterdir())
    words = line.format(f"--left {TOPICS[0]} --right {TOPICS[1]}").split()
    got, out, err = run("live", *words, "--num-disparities", 8, "--preset", "fast")

    assert (got, out) == (code, "")
    assert message in err
    assert sorted(folder.iterdir()) == before


def test_an_earlier_recording_stays_until_there_is_one(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    path.write_text("earlier")
    with ros.RecordingWriter(path):
        pass
    assert path.read_text() == "earlier"
    assert list(tmp_path.iterdir()) == [path]


def test_unknown_calibrations_are_refused(tmp_path: Path) -> None:
    bag = Bag()
    for info, topic, view in zip(INFOS, TOPICS, cut(0), strict=True):
        blank = {"K": np.zeros(9), "D": [], "R": np.zeros(9), "P": np.zeros(12)}
        bag.add(info, START, robots.info(ROS2, (COLS, ROWS), blank, ""))
        bag.add(topic, START, robots.image(ROS2, START, view.copy(), "rgb8"))
    with pytest.raises(ValueError, match=r"never calibrated"):
        ros.open_recording(bag.write(tmp_path / "in.mcap"), *TOPICS)

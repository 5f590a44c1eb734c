"""Depths in the frame of a third camera: rendered truth, and what a RealSense's library makes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo.io import Calibration
from support import counterpart
from support.rigs import SIZE, cv2, made_up, of_opencv, turned

Floats = NDArray[np.float64]

COLS, ROWS, FOCAL = 160, 120, 150.0
RIG = Calibration.from_focal(FOCAL, 0.05, width=COLS, height=ROWS)
NORMAL, DISTANCE = np.array([0.2, -0.1, 1.0]), 2.0  # of the wall behind
BOX, SIDES = np.array([0.05, -0.02, 0.9]), np.array([0.18, 0.15])


def camera(
    rotation: Any, translation: Any, focal: float, size: tuple[int, int], **more: Any
) -> ps.ThirdCamera:
    cols, rows = size
    matrix = [[focal, 0, (cols - 1) / 2], [0, focal, (rows - 1) / 2], [0, 0, 1]]
    return ps.ThirdCamera(
        matrix=np.array(matrix), rotation=rotation, translation=translation,
        width=cols, height=rows, **more,
    )  # fmt: skip


CAMERAS = {
    "shifted": camera(np.eye(3), (0.03, 0, 0), FOCAL, (COLS, ROWS)),
    "turned and finer": camera(turned(-2, 4, 3), (0.03, 0.01, -0.02), 260, (320, 240)),
    "on its side": camera(turned(0, 0, 90), (0.03, 0.01, 0.02), FOCAL, (ROWS, COLS)),
    "distorted": camera(
        turned(1, 0, 0), (-0.03, 0, 0.01), 200, (240, 180),
        distortion=np.array([-0.25, 0.08, 0.001, -0.001, 0.0]),
    ),
    "fisheye": camera(
        turned(0, 2, 0), (-0.06, 0, 0), 120, (240, 180),
        distortion=np.array([0.05, -0.01, 0.002, 0.0]), fisheye=True,
    ),
}  # fmt: skip


def left_rays() -> Floats:
    y, x = np.mgrid[:ROWS, :COLS]
    center = RIG.cam0[0][2], RIG.cam0[1][2]
    return np.dstack([(x - center[0]) / FOCAL, (y - center[1]) / FOCAL, np.ones(x.shape)])


def struck(rays: Floats, origin: Floats) -> Floats:
    """Return the factor by which each ray reaches the scene: a box before a slanted wall."""
    wall = (DISTANCE - origin @ NORMAL) / (rays @ NORMAL)
    box = (BOX[2] - origin[2]) / rays[..., 2]
    there = np.abs(origin + rays * box[..., np.newaxis] - BOX)[..., :2] < SIDES
    found: Floats = np.where(there.all(axis=-1), box, wall)
    return found


def seen_by(third: ps.ThirdCamera) -> tuple[Floats, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the true depths of a camera, what is hidden from the left one, and beside its view."""
    y, x = np.mgrid[: third.height, : third.width]
    lens = np.zeros(4) if third.distortion is None else third.distortion
    model = cv2.fisheye if third.fisheye else cv2
    pixels = np.column_stack([x.ravel(), y.ravel()]).astype(float)[:, np.newaxis]
    rays = np.insert(model.undistortPoints(pixels, third.matrix, lens)[:, 0], 2, 1.0, axis=1)
    origin = -third.rotation.T @ third.translation
    ways = rays @ third.rotation
    depth = struck(ways, origin)
    points = origin + ways * depth[:, np.newaxis]
    u, v = (points[:, :2] / points[:, 2:] * FOCAL + [RIG.cam0[0][2], RIG.cam0[1][2]]).T
    outside = (u < -0.5) | (u >= COLS - 0.5) | (v < -0.5) | (v >= ROWS - 0.5)
    hidden = ~outside & (struck(points / points[:, 2:], np.zeros(3)) < 0.95 * points[:, 2])
    shape = third.height, third.width
    return depth.reshape(shape), hidden.reshape(shape), outside.reshape(shape)


def eroded(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return a mask without the pixels at its edges, where a pixel decides by halves."""
    found: NDArray[np.bool_] = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return found


DEPTH = struck(left_rays(), np.zeros(3))
DISPARITY = (FOCAL * 0.05 / DEPTH).astype(np.float32)


@pytest.mark.parametrize("name", CAMERAS)
def test_depths_are_the_true_ones_of_the_third_camera(name: str) -> None:
    third = CAMERAS[name]
    truth, hidden, outside = seen_by(third)
    found = ps.register(DISPARITY, RIG, third)
    known = np.isfinite(found.depth)

    assert known[eroded(~hidden & ~outside)].mean() > 0.995  # no cracks
    assert known[eroded(hidden | outside)].mean() < 0.02
    error = np.abs(found.depth / truth - 1)[known]
    assert np.median(error) < 1e-3
    assert (error < 0.01).mean() > 0.985  # but for half a pixel at edges
    assert not found.holes.any()
    assert found.occluded[eroded(hidden)].mean() > 0.9
    assert not found.occluded[eroded(outside)].any()
    assert (found.source[known] >= 0).all()
    np.testing.assert_array_equal(np.isfinite(found.picked(DISPARITY)), known)


def test_bars_and_confidences_go_along_and_holes_are_no_occlusions() -> None:
    third = CAMERAS["turned and finer"]
    truth, hidden, _ = seen_by(third)
    confidence = np.ones(DISPARITY.shape, np.float32)
    confidence[20:40, 120:150] = 0.2  # on the wall, beside the box
    bars = np.full(DISPARITY.shape, 0.1, np.float32)
    flags = np.zeros(DISPARITY.shape, np.uint16)
    result = ps.Result(DISPARITY, flags, confidence, ps.Settings(), {}, uncertainty=bars)

    whole = ps.register(result, RIG, third, keep="all")
    found = ps.register(result, RIG, third)
    assert found.near is not None
    assert found.far is not None
    known = np.isfinite(found.depth)
    assert (found.near < found.depth)[known].all()
    assert (found.depth < found.far)[known].all()
    inside = (found.near <= truth) & (truth <= found.far)
    assert inside[known].mean() > 0.99
    assert found.confidence is not None
    assert (found.confidence[known] == 1).all()
    assert set(found.maps) == {"depth", "near", "far", "confidence", "holes", "occluded"}

    missing = np.isfinite(whole.depth) & ~known
    assert 0.9 < found.holes.sum() / missing.sum() < 1.1
    assert found.holes[eroded(missing)].mean() > 0.95
    assert not found.holes[eroded(hidden)].any()
    assert not (found.holes & found.occluded).any()

    near = ps.register(result, RIG, third, max_depth=1.2)
    assert np.nanmax(near.depth) < 1.3
    assert near.holes.sum() > 10 * found.holes.sum()

    meters = replace(third, unit="m")
    in_mm = ps.register(DISPARITY, replace(RIG, baseline=50.0, unit="mm"), meters)
    np.testing.assert_allclose(in_mm.depth, 1000 * whole.depth, rtol=1e-5)

    nothing = ps.register(np.full_like(DISPARITY, np.nan), RIG, third)
    assert not (np.isfinite(nothing.depth) | nothing.holes | nothing.occluded).any()


@pytest.mark.parametrize("name", ["shifted", "turned and finer"])
def test_it_is_what_librealsense_aligns(name: str) -> None:
    """``rs.align`` keeps depths along the left axis, and lets pixels grow by one."""
    third = CAMERAS[name]
    aligned = aligned_by_librealsense(np.rint(1000 * DEPTH).astype(np.uint16), third) / 1000
    found = ps.register(DISPARITY, RIG, third)
    known = np.isfinite(found.depth)
    both = known & (aligned > 0)
    assert both.sum() > 0.97 * (known | (aligned > 0)).sum()
    ours = found.picked(DEPTH.astype(np.float32))[both]
    assert (np.abs(aligned[both] / ours - 1) < 0.01).mean() > 0.995
    assert np.median(np.abs(aligned[both] - ours)) < 1e-3  # in m: it has whole mm


def aligned_by_librealsense(millimeters: NDArray[np.uint16], third: ps.ThirdCamera) -> Any:
    """Return depths as its library aligns them to a color camera, without a camera."""
    rs = counterpart("pyrealsense2")

    def stream(kind: Any, uid: int, encoding: Any, bytes_each: int, given: Any) -> Any:
        matrix, cols, rows = given
        lens = rs.intrinsics()
        lens.width, lens.height, lens.model, lens.coeffs = cols, rows, rs.distortion.none, [0] * 5
        (lens.fx, _, lens.ppx), (_, lens.fy, lens.ppy), _ = np.asarray(matrix).tolist()
        made = rs.video_stream()
        made.type, made.index, made.uid, made.fmt, made.bpp = kind, 0, uid, encoding, bytes_each
        made.width, made.height, made.fps, made.intrinsics = cols, rows, 30, lens
        return made

    device = rs.software_device()
    sensors = device.add_sensor("Depth"), device.add_sensor("Color")
    given = (RIG.cam0, COLS, ROWS), (third.matrix, third.width, third.height)
    formats = (rs.stream.depth, rs.format.z16, 2), (rs.stream.color, rs.format.rgb8, 3)
    profiles = [
        sensor.add_video_stream(stream(kind, uid, encoding, size, lens))
        for uid, (sensor, (kind, encoding, size), lens) in enumerate(
            zip(sensors, formats, given, strict=True)
        )
    ]
    sensors[0].add_read_only_option(rs.option.depth_units, 0.001)
    pose = rs.extrinsics()
    pose.rotation, pose.translation = third.rotation.T.ravel().tolist(), third.translation.tolist()
    profiles[0].register_extrinsics_to(profiles[1], pose)
    device.create_matcher(rs.matchers.default)
    syncer, align = rs.syncer(), rs.align(rs.stream.color)
    for sensor, profile in zip(sensors, profiles, strict=True):
        sensor.open(profile)
        sensor.start(syncer)

    images: tuple[NDArray[Any], ...]
    images = millimeters, np.zeros((third.height, third.width, 3), np.uint8)
    for number in range(1, 10):
        for sensor, profile, image, (_, _, size) in zip(
            sensors, profiles, images, formats, strict=True
        ):
            frame = rs.software_video_frame()
            frame.pixels, frame.stride, frame.bpp = image, image.shape[1] * size, size
            frame.timestamp, frame.frame_number = 33.0 * number, number
            frame.domain = rs.timestamp_domain.hardware_clock
            frame.profile = profile.as_video_stream_profile()
            frame.depth_units = 0.001
            sensor.on_video_frame(frame)
        frames = syncer.wait_for_frames(5000)
        if frames.get_depth_frame() and frames.get_color_frame():
            return np.asanyarray(align.process(frames).get_depth_frame().get_data()).copy()
    raise AssertionError("no pair of frames")


def test_a_calibration_and_a_rectification_say_where_it_is() -> None:
    rig, third = made_up(), made_up()
    third |= {"R": turned(2.0, 1.0, -3.0), "T": np.array([0.06, 0.01, 0.0])}
    noise = np.random.default_rng(0).integers(0, 256, SIZE[::-1], np.uint8)
    rectified = ps.rectify(noise, noise, rig)
    found = ps.ThirdCamera.of_pair(third, rectification=rectified, size=(320, 200))
    wanted = third["R"] @ of_opencv(rig, SIZE)["R1"].T
    np.testing.assert_allclose(found.rotation, wanted, atol=1e-5)
    np.testing.assert_array_equal(found.translation, third["T"])
    np.testing.assert_array_equal(found.matrix, third["K2"])
    assert (found.width, found.height) == (320, 200)
    plain = ps.ThirdCamera.of_pair(third, size=SIZE)
    np.testing.assert_array_equal(plain.rotation, third["R"])

    other = third | {"D1": np.array([0.3, 0.0, 0.0, 0.0, 0.0])}
    with pytest.raises(ValueError, match="left camera is not the one that was rectified"):
        ps.ThirdCamera.of_pair(other, rectification=rectified, size=SIZE)
    with pytest.raises(ValueError, match="^size: got None"):
        ps.ThirdCamera.of_pair(third)
    with pytest.raises(ValueError, match="^calibration: accepts K1, D1, K2, D2, R, T"):
        ps.ThirdCamera.of_pair(rectified, size=SIZE)  # type: ignore[arg-type]  # on purpose


@pytest.mark.parametrize(("options", "message"), [
    ({"matrix": np.eye(2)}, "^matrix: got shape"),
    ({"rotation": 2 * np.eye(3)}, "^rotation: "),
    ({"translation": (0, 0, np.nan)}, "^translation: got shape"),
    ({"height": 0}, "^height: got 0"),
])  # fmt: skip
def test_what_is_no_camera_is_refused(options: dict[str, Any], message: str) -> None:
    given: dict[str, Any] = {
        "matrix": np.eye(3), "rotation": np.eye(3), "translation": (0, 0, 0),
        "width": 4, "height": 3,
    }  # fmt: skip
    with pytest.raises(ValueError, match=message):
        ps.ThirdCamera(**given | options)

"""Folders of images and depths, as their own readers take them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
import phasestereo_live as live
from phasestereo.io import Calibration, read_depth, read_image
from phasestereo_live.rgbd import LAYOUTS, RgbdWriter, normal_map
from support import counterpart
from support.footage import COLS, COUNT, INTRA, ROWS, film, pair, shift, side_by_side
from support.rigs import turned

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from support import Run

FOCAL, BASELINE = 100.0, 0.06
RIG = Calibration.from_focal(FOCAL, BASELINE, width=COLS, height=ROWS, cx=46.0, cy=30.0)
WALL, NORMAL = 2.0, np.array([0.3, -0.2, -1.0]) / np.linalg.norm([0.3, -0.2, -1.0])


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def frames(count: int) -> list[live.Frame]:
    pairs = [pair(index) for index in range(count)]
    return list(live.stream(pairs, num_disparities=COUNT, preset="fast", temporal_filter=False))


def slanted() -> NDArray[np.float32]:
    """Return the depths of a wall that is ``WALL`` away where the camera looks."""
    (fx, _, cx), (_, fy, cy), _ = RIG.cam0
    y, x = np.mgrid[:ROWS, :COLS]
    rays = np.dstack([(x - cx) / fx, (y - cy) / fy, np.ones(x.shape)])
    depth: NDArray[np.float32] = (WALL * NORMAL[2] / (rays @ NORMAL)).astype(np.float32)
    return depth


def pose(index: int) -> NDArray[np.float64]:
    """Return the pose of the camera: elsewhere, and turned, in each frame."""
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = turned(3.0 * index, -2.0, 5.0), [0.1 * index, 0.02, -0.3]
    return found


def framed(depth: NDArray[np.float32], index: int = 0) -> live.Frame:
    """Return a frame of these depths."""
    disparity = (FOCAL * BASELINE / depth).astype(np.float32)
    flags = np.zeros(depth.shape, np.uint16)
    result = ps.Result(disparity, flags, None, ps.PRESETS["fast"], {})
    image = np.full((*depth.shape, 3), 90, np.uint8)
    return live.Frame(index, None, image, image, result)


def test_tum_is_what_open3d_reads() -> None:
    open3d = counterpart("open3d")
    given = frames(2)
    with RgbdWriter("a") as writer:
        for frame in given:
            writer.write(frame, RIG, pose=pose(frame.index))

    lines = Path("a/associations.txt").read_text().split("\n")
    assert [line.split()[1::2] for line in lines[:2]] == [
        [f"{kind}/{index}.000000.png" for kind in ("rgb", "depth")] for index in range(2)
    ]
    camera = [float(word) for word in Path("a/camera.txt").read_text().split()]
    assert camera == [FOCAL, FOCAL, 46, 30]
    poses = np.loadtxt("a/groundtruth.txt")
    for index, (time, *place) in enumerate(poses):
        assert (time, place[:3]) == (index, pytest.approx(pose(index)[:3, 3]))
        x, y, z, w = place[3:]
        rotation = open3d.geometry.get_rotation_matrix_from_quaternion([w, x, y, z])
        np.testing.assert_allclose(rotation, pose(index)[:3, :3], atol=1e-7)

    for line, frame in zip(lines[:2], given, strict=True):
        _, color, _, depth = line.split()
        image, values = (open3d.io.read_image(f"a/{name}") for name in (color, depth))
        made = open3d.geometry.RGBDImage.create_from_tum_format(
            image, values, convert_rgb_to_intensity=False
        )
        intrinsics = open3d.camera.PinholeCameraIntrinsic(COLS, ROWS, *camera)
        cloud = open3d.geometry.PointCloud.create_from_rgbd_image(made, intrinsics)
        wanted = ps.point_cloud(frame.result, RIG, image=frame.left, max_depth=4.0)
        assert len(wanted) > 0.8 * COLS * ROWS
        np.testing.assert_allclose(np.asarray(cloud.points), wanted.points, atol=1.1e-4)
        assert wanted.colors is not None
        np.testing.assert_array_equal(np.rint(255 * np.asarray(cloud.colors)), wanted.colors)


def test_open3d_fuses_it_to_the_wall() -> None:
    open3d = counterpart("open3d")
    with RgbdWriter("a") as writer:
        writer.write(framed(slanted()), RIG, pose=pose(1))
    color, depth = (open3d.io.read_image(f"a/{kind}/0.000000.png") for kind in ("rgb", "depth"))
    made = open3d.geometry.RGBDImage.create_from_tum_format(color, depth)
    integration = open3d.pipelines.integration
    kind = integration.TSDFVolumeColorType.Gray32
    middle = pose(1)[:3, :3] @ [0, 0, WALL] + pose(1)[:3, 3]
    volume = integration.UniformTSDFVolume(
        length=4.0, resolution=200, sdf_trunc=0.08, color_type=kind, origin=middle - 2
    )
    camera = [float(word) for word in Path("a/camera.txt").read_text().split()]
    intrinsics = open3d.camera.PinholeCameraIntrinsic(COLS, ROWS, *camera)
    volume.integrate(made, intrinsics, np.linalg.inv(pose(1)))
    points = np.asarray(volume.extract_point_cloud().points)
    assert len(points) > 1000
    turn, place = pose(1)[:3, :3], pose(1)[:3, 3]
    errors = np.abs((points - place) @ (turn @ NORMAL) - WALL * NORMAL[2])
    assert np.percentile(errors, 95) < 4e-3  # it takes the depth of the nearest pixel, 2 cm wide


def test_colmap_fuses_it_to_the_wall() -> None:
    pycolmap = counterpart("pycolmap")
    with RgbdWriter("a", "colmap") as writer:
        for index in range(2):
            writer.write(framed(slanted(), index), RIG, pose=pose(index))

    model = pycolmap.Reconstruction("a/sparse")
    (camera,) = model.cameras.values()
    assert camera.model.name == "PINHOLE"
    np.testing.assert_array_equal(camera.params, [FOCAL, FOCAL, 46.5, 30.5])
    for index, image in enumerate(sorted(model.images.values(), key=lambda image: image.name)):
        matrix = image.cam_from_world().matrix()
        np.testing.assert_allclose(matrix, np.linalg.inv(pose(index))[:3], atol=1e-7)
        wanted = read_image(f"a/images/{image.name}").shape[:2]
        assert wanted == (camera.height, camera.width)

    options = pycolmap.StereoFusionOptions()
    options.min_num_pixels = 1
    pycolmap.stereo_fusion("fused.ply", "a", options=options, output_type="PLY")
    plyfile = counterpart("plyfile")
    vertices = plyfile.PlyData.read("fused.ply", mmap=False)["vertex"].data
    points = np.stack([vertices[name] for name in "xyz"], axis=1)
    normals = np.stack([vertices[f"n{name}"] for name in "xyz"], axis=1)
    assert len(points) > 1.5 * COLS * ROWS
    # Each camera sees the wall at the same place before it: two walls in the world.
    errors, angles = [], []
    for index in range(2):
        turn, place = pose(index)[:3, :3], pose(index)[:3, 3]
        errors.append(np.abs((points - place) @ (turn @ NORMAL) - WALL * NORMAL[2]))
        angles.append(np.degrees(np.arccos(np.clip(normals @ (turn @ NORMAL), -1, 1))))
    nearest = np.argmin(errors, axis=0)
    # Its fusion counts pixels from their centers, its cameras from their corners: half a pixel.
    assert np.median(np.min(errors, axis=0)) < 1.1e-3
    assert np.percentile(np.min(errors, axis=0), 95) < 3e-3
    angle = np.take_along_axis(np.array(angles), nearest[np.newaxis], 0)
    assert np.percentile(angle, 95) < 1  # in the world's frame


def test_transforms_of_nerfstudio_are_those_of_opengl() -> None:
    with RgbdWriter("a", "nerfstudio") as writer:
        writer.write(framed(slanted()), RIG, pose=pose(1))
    found = json.loads(Path("a/transforms.json").read_text())
    (frame,) = found["frames"]
    assert (found["fl_x"], found["cx"], found["cy"], found["w"]) == (FOCAL, 46.5, 30.5, COLS)
    # A point below and ahead of the camera, seen with Y up and Z backward.
    up = np.array([0.0, -0.5, -2.0, 1.0])
    world = np.array(frame["transform_matrix"]) @ up
    np.testing.assert_allclose(world, pose(1) @ [0.0, 0.5, 2.0, 1.0])
    depth = read_depth(f"a/{frame['depth_file_path']}", unit="m")
    np.testing.assert_allclose(depth, slanted(), atol=5.1e-4)
    assert read_image(f"a/{frame['file_path']}").shape == (ROWS, COLS, 3)


def test_normals_are_those_of_each_surface() -> None:
    depth = slanted()
    depth[:, COLS // 2 :] = 0.8  # nearer, and facing the camera
    depth[10:20, 10:20] = np.nan
    found = normal_map(depth, RIG)
    there = np.linalg.norm(found, axis=2) > 0
    left, right = np.zeros((2, ROWS, COLS), bool)
    left[:, : COLS // 2], right[:, COLS // 2 :] = True, True
    assert not there[np.isnan(depth)].any()
    assert there[~np.isnan(depth)].mean() > 0.99
    np.testing.assert_allclose(found[there & left] @ NORMAL, 1, atol=1e-4)
    np.testing.assert_allclose(
        found[there & right], [[0, 0, -1]] * (there & right).sum(), atol=1e-4
    )


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_film_becomes_a_folder(run: Callable[..., Run], layout: str) -> None:
    film(Path("a.mkv"), side_by_side(2), **INTRA)
    Path("calib.txt").write_text(
        f"cam0=[100 0 48; 0 100 32; 0 0 1]\ncam1=[100 0 48; 0 100 32; 0 0 1]\n"
        f"doffs=0\nbaseline=60\nwidth={COLS}\nheight={ROWS}\n"
    )
    options = "--num-disparities", COUNT, "--preset", "fast", "--rgbd", "out"
    code, _, err = run("live", "a.mkv", *options, "--rgbd-layout", layout, "--calib", "calib.txt")
    assert code == 0, err
    depths = sorted(Path("out").rglob("*depth*/*.*"))
    assert len(depths) == 2
    scale: Any = {"depth_scale": 5000} if layout == "tum" else {}
    depth = read_depth(depths[0], unit="m", **scale)
    assert np.nanmedian(depth) == pytest.approx(6 / shift(0), rel=0.01)

    code, _, err = run("live", "a.mkv", *options, "--calib", "calib.txt")
    assert code == 1
    assert "is not empty" in err
    code, _, err = run("live", "a.mkv", *options[:-1], "other")
    assert (code, err.count("\n")) == (2, 1)  # before any frame
    assert "--rgbd: needs a geometry" in err


def test_what_cannot_be_written_is_refused() -> None:
    with pytest.raises(ValueError, match="^layout: got 'kitti'; accepts 'tum'"):
        RgbdWriter("a", "kitti")  # type: ignore[arg-type]  # on purpose
    with RgbdWriter("a") as writer, pytest.raises(ValueError, match="^pose: got shape"):
        writer.write(framed(slanted()), RIG, pose=np.eye(3))
    assert not list(Path("a").iterdir())

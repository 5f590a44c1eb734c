"""Calibrations as makers write them: what their own software reads is what comes out here."""

from __future__ import annotations

import configparser
import io
import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.io.rigs.cameras import Cameras
from phasestereo.io.rigs.reading import read_cameras
from support import counterpart
from support.rigs import SIZE, made_up, of_opencv

cv2 = counterpart("cv2")

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")  # noise is matched here

NAMES = "K1", "D1", "K2", "D2", "R", "T"


def assert_cameras(found: Cameras, rig: dict[str, Any], unit: str | None = "m") -> None:
    """Hold a pair to matrices of OpenCV's, and its maps to OpenCV's own."""
    assert found.unit == unit
    for name in NAMES:
        given = np.ravel(rig[name])
        read = found.matrices[name].ravel()
        np.testing.assert_allclose(read, np.pad(given, (0, len(read) - len(given))), atol=1e-6)


def pose_of(rig: dict[str, Any]) -> Any:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rig["R"], np.ravel(rig["T"])
    return pose


@pytest.fixture
def samples(data: Path) -> Path:
    return data / "real_pairs/calibrations"


# Against the software of the makers


def test_an_oak_is_as_depthai_reads_it(samples: Path) -> None:
    dai = counterpart("depthai")
    path = samples / "depthai_oakd.json"
    handler, sockets = dai.CalibrationHandler(str(path)), dai.CameraBoardSocket
    pose = np.array(handler.getCameraExtrinsics(sockets.CAM_B, sockets.CAM_C))
    rig = {"R": pose[:3, :3], "T": pose[:3, 3] / 100}  # cm
    for side, socket in (("1", sockets.CAM_B), ("2", sockets.CAM_C)):
        rig[f"K{side}"] = np.array(handler.getCameraIntrinsics(socket, 1280, 800))
        rig[f"D{side}"] = np.array(handler.getDistortionCoefficients(socket))
    found = read_cameras(path)
    assert_cameras(found, rig)

    warp = found.warp((1280, 800), None)
    for part, other in zip(warp.maps, of_opencv(rig, (1280, 800))["maps"], strict=True):
        # float32 there, and the quotients of polynomials have poles
        assert np.quantile(np.abs(np.array(part) - np.array(other)), 0.999) < 1e-3

    half = ps.io.read_calibration(path, (640, 400))
    whole = ps.io.read_calibration(path)
    assert half.unit == "m"
    assert half.baseline == pytest.approx(whole.baseline)
    assert half.baseline == pytest.approx(0.0738, abs=1e-4)
    assert half.focal == pytest.approx(whole.focal / 2, rel=1e-6)


@pytest.mark.parametrize(("name", "size"), [
    ("HD", (1280, 720)), ("2K", (2208, 1242)), ("FHD", (1920, 1080)), ("VGA", (672, 376)),
])  # fmt: skip
def test_a_zed_is_as_zed_opencv_native_reads_it(
    samples: Path, name: str, size: tuple[int, int]
) -> None:
    parser = configparser.ConfigParser()
    parser.read(samples / "zed/SN1267.conf")
    stereo = parser["STEREO"]
    rig: dict[str, Any] = {}
    for side, word in (("1", "LEFT"), ("2", "RIGHT")):
        one = {key: float(value) for key, value in parser[f"{word}_CAM_{name}"].items()}
        rig[f"K{side}"] = np.array(
            [[one["fx"], 0, one["cx"]], [0, one["fy"], one["cy"]], [0, 0, 1]]
        )
        rig[f"D{side}"] = np.array([one["k1"], one["k2"], one["p1"], one["p2"], 0])
    vector = [float(stereo[f"{key}_{name}"]) for key in ("RX", "CV", "RZ")]
    rig |= {"R": cv2.Rodrigues(np.array(vector))[0], "T": np.array([120.0, 0, 0])}

    # That program passes +T, mm: the same rotations, and another sign of the baseline.
    found = read_cameras(samples / "zed/SN1267.conf").warp(size, None)
    for both, other in zip(found.maps, of_opencv(rig, size)["maps"], strict=True):
        np.testing.assert_array_equal(np.array(both), np.array(other))
    assert 1 / ps.io.read_calibration(samples / "zed/SN1267.conf", size).q[3, 2] == pytest.approx(
        0.12
    )


def test_a_model_of_colmap(tmp_path: Path) -> None:
    pycolmap = counterpart("pycolmap")
    rig = made_up() | {"D1": np.array([-0.2, 0.05, 0.001, -0.002]), "D2": np.zeros(4)}
    model = pycolmap.Reconstruction()
    for side in (1, 2):
        k = rig[f"K{side}"]
        # There the corner of the first pixel is (0, 0).
        values = [k[0, 0], k[1, 1], k[0, 2] + 0.5, k[1, 2] + 0.5, *rig[f"D{side}"]]
        camera = pycolmap.Camera(
            camera_id=side, model="OPENCV", width=SIZE[0], height=SIZE[1], params=values
        )
        model.add_camera_with_trivial_rig(camera)
    for number, (side, pose) in enumerate(((2, pose_of(rig)), (1, np.eye(4))), start=1):
        image = pycolmap.Image(name=f"{side}.png", camera_id=side, image_id=number)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pose[:3]))
    for kind in ("text", "binary"):
        folder = tmp_path / kind
        folder.mkdir()
        getattr(model, f"write_{kind}")(str(folder))
        assert_cameras(read_cameras(folder), rig, None)

    (folder / "cameras.bin").write_bytes(b"\xff" * 99)
    with pytest.raises(ValueError, match="binary: is a damaged model of COLMAP"):
        read_cameras(folder)


# By the documented conventions of the makers


def seen(rig: dict[str, Any], points: Any, side: int) -> Any:
    """Return the pixels of points of the left camera's frame, by OpenCV."""
    pose = np.eye(4) if side == 1 else pose_of(rig)
    vector = cv2.Rodrigues(pose[:3, :3])[0]
    args = points, vector, pose[:3, 3], rig[f"K{side}"], np.ravel(rig[f"D{side}"])
    return cv2.projectPoints(*args)[0].reshape(-1, 2)


POINTS = np.random.default_rng(0).uniform((-1, -1, 3), (1, 1, 5), (40, 3))


def test_parameters_of_matlab_see_what_matlab_documents(tmp_path: Path) -> None:
    """Points are rows there, x = (X R + t) K, and the first pixel is (1, 1)."""
    scipy = counterpart("scipy.io")
    rig = made_up()
    stored: dict[str, Any] = {
        "RotationOfCamera2": rig["R"].T, "TranslationOfCamera2": rig["T"][np.newaxis],
    }  # fmt: skip
    for side in (1, 2):
        k1, k2, p1, p2, k3 = rig[f"D{side}"]
        k = rig[f"K{side}"] + [[0, 0, 1], [0, 0, 1], [0, 0, 0]]
        stored[f"CameraParameters{side}"] = {
            "IntrinsicMatrix": k.T, "RadialDistortion": np.array([[k1, k2, k3]]),
            "TangentialDistortion": np.array([[p1, p2]]), "ImageSize": np.array([SIZE[::-1]]),
        }  # fmt: skip
    for wrapped in (stored, {"stereoParams": stored}):
        scipy.savemat(tmp_path / "rig.mat", wrapped)
        found = read_cameras(tmp_path / "rig.mat")
        assert_cameras(found, rig, None)
        assert found.size == SIZE

    for side in (1, 2):
        one = stored[f"CameraParameters{side}"]
        rows = POINTS if side == 1 else POINTS @ stored["RotationOfCamera2"] + rig["T"]
        x, y = (rows[:, :2] / rows[:, 2:]).T
        (k1, k2, k3), (p1, p2) = one["RadialDistortion"][0], one["TangentialDistortion"][0]
        r2 = x * x + y * y
        radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        distorted = np.stack([
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y, np.ones_like(x),
        ], axis=1)  # fmt: skip
        there = (distorted @ one["IntrinsicMatrix"])[:, :2] - 1
        np.testing.assert_allclose(there, seen(dict(found.matrices), POINTS, side), atol=1e-9)


def test_what_matlab_hands_to_opencv(tmp_path: Path) -> None:
    scipy = counterpart("scipy.io")
    rig = made_up()
    scipy.savemat(tmp_path / "rig.mat", {
        "intrinsicMatrix1": rig["K1"], "distortionCoefficients1": rig["D1"],
        "intrinsicMatrix2": rig["K2"], "distortionCoefficients2": rig["D2"],
        "rotationOfCamera2": rig["R"], "translationOfCamera2": rig["T"], "imageSize": SIZE[::-1],
    })  # fmt: skip
    found = read_cameras(tmp_path / "rig.mat")
    assert_cameras(found, rig, None)
    assert found.size == SIZE


def test_the_toolbox_of_bouguet(tmp_path: Path) -> None:
    scipy = counterpart("scipy.io")
    rig = made_up()
    stored: dict[str, Any] = {"R": rig["R"], "T": rig["T"][:, np.newaxis], "nx": 160, "ny": 120}
    for side, word in ((1, "left"), (2, "right")):
        k = rig[f"K{side}"]
        stored |= {
            f"fc_{word}": k[[0, 1], [0, 1]], f"cc_{word}": k[:2, 2], f"alpha_c_{word}": 0.0,
            f"kc_{word}": rig[f"D{side}"][:, np.newaxis],
        }  # fmt: skip
    scipy.savemat(tmp_path / "Calib_Results_stereo.mat", stored)
    found = read_cameras(tmp_path / "Calib_Results_stereo.mat")
    assert_cameras(found, rig, None)
    assert found.size == SIZE
    scipy.savemat(tmp_path / "skewed.mat", stored | {"alpha_c_left": 0.1})
    with pytest.raises(ValueError, match="alpha_c_left: pixels are skewed"):
        read_cameras(tmp_path / "skewed.mat")


METASHAPE = """<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0"><chunk label="Chunk 1" enabled="true"><sensors next_id="2">
{sensors}</sensors><cameras next_id="2">{cameras}</cameras></chunk></document>
"""
SENSOR = """<sensor id="{id}" label="s" type="frame"><resolution width="160" height="120"/>
<calibration type="frame" class="adjusted"><resolution width="160" height="120"/>{values}
</calibration></sensor>
"""
CAMERA = '<camera id="{id}" sensor_id="{id}" label="{id}"><transform>{pose}</transform></camera>\n'


def metashape(rig: dict[str, Any]) -> str:
    """Write a rig as Agisoft's manual has it: x' = x ... + P1 (r2 + 2 x x) + 2 P2 x y, from f."""
    sensors, cameras = "", ""
    for number in (2, 1):
        (fx, _, x), (_, fy, y), _ = rig[f"K{number}"]
        k1, k2, p1, p2, k3 = rig[f"D{number}"]
        values = {
            "f": fy, "b1": fx - fy, "cx": x + 0.5 - 80, "cy": y + 0.5 - 60,
            "k1": k1, "k2": k2, "k3": k3, "p1": p2, "p2": p1,
        }  # fmt: skip
        text = "".join(f"<{key}>{float(value)!r}</{key}>" for key, value in values.items())
        sensors += SENSOR.format(id=number, values=text)
        pose = np.linalg.inv(np.eye(4) if number == 1 else pose_of(rig))
        cameras += CAMERA.format(id=number, pose=" ".join(map(repr, pose.ravel().tolist())))
    return METASHAPE.format(sensors=sensors, cameras=cameras)


def test_cameras_of_metashape(tmp_path: Path) -> None:
    rig = made_up()
    (tmp_path / "cameras.xml").write_text(metashape(rig))
    assert_cameras(read_cameras(tmp_path / "cameras.xml"), rig, None)

    more = metashape(rig).replace("</cameras>", CAMERA.format(
        id=1, pose=" ".join(map(str, np.eye(4).ravel()))) + "</cameras>")  # fmt: skip
    (tmp_path / "cameras.xml").write_text(more)
    with pytest.raises(ValueError, match="Metashape's XML of 3 images; accepts one of two"):
        read_cameras(tmp_path / "cameras.xml")


def mrcal(rig: dict[str, Any], side: int, model: str = "LENSMODEL_OPENCV5") -> str:
    k = rig[f"K{side}"]
    values = [k[0, 0], k[1, 1], k[0, 2], k[1, 2], *rig[f"D{side}"]]
    pose = np.zeros(6) if side == 1 else np.r_[cv2.Rodrigues(rig["R"])[0].ravel(), rig["T"]]
    numbers = ", ".join(map(repr, map(float, values)))
    return (
        f"# generated\n{{\n    'lensmodel':  '{model}',\n    # fx,fy,cx,cy,...\n    'intrinsics': ["
        f" {numbers},],\n    'extrinsics': {list(map(float, pose))},\n    'imagersize': [ 160, 120,"
        "],\n    'optimization_inputs': b'P)h>@6aWAK2mk'\n}\n"
    )


def test_a_pair_of_mrcal(tmp_path: Path) -> None:
    rig = made_up()
    paths = [tmp_path / "0.cameramodel", tmp_path / "1.cameramodel"]
    for side, path in enumerate(paths, start=1):
        path.write_text(mrcal(rig, side))
    assert_cameras(read_cameras(paths), rig)
    with pytest.raises(ValueError, match="holds one camera; give the files of both"):
        read_cameras(paths[0])
    paths[0].write_text(mrcal(rig, 1, "LENSMODEL_SPLINED_STEREOGRAPHIC_order=3"))
    with pytest.raises(ValueError, match="lensmodel: got LENSMODEL_SPLINED.*mrcal-convert"):
        read_cameras(paths)


def test_a_configuration_of_okvis(tmp_path: Path) -> None:
    rig = made_up()
    text = "cameras:\n"
    for side, pose in ((1, np.eye(4)), (2, np.linalg.inv(pose_of(rig)))):
        k = rig[f"K{side}"]
        text += (
            f"  - {{T_SC: {pose.ravel().tolist()}, image_dimension: [160, 120],\n"
            f"     distortion_coefficients: {rig[f'D{side}'][:4].tolist()},\n"
            "     distortion_type: radialtangential,\n"
            f"     focal_length: [{k[0, 0]}, {k[1, 1]}],\n"
            f"     principal_point: [{k[0, 2]}, {k[1, 2]}]}}\n"
        )
    (tmp_path / "okvis.yaml").write_text(f"%YAML:1.0\n{text}")
    cut = {name: rig[name][:4] for name in ("D1", "D2")}
    assert_cameras(read_cameras(tmp_path / "okvis.yaml"), rig | cut)


def test_settings_of_orb_slam(samples: Path, tmp_path: Path) -> None:
    storage = cv2.FileStorage(str(samples / "orb2/EuRoC.yaml"), cv2.FILE_STORAGE_READ)
    maps = []
    for side in ("LEFT", "RIGHT"):
        k, d, r, p = (storage.getNode(f"{side}.{name}").mat() for name in "KDRP")
        maps.append(cv2.initUndistortRectifyMap(k, d, r, p, (752, 480), cv2.CV_32FC1))
    bf, fx = (storage.getNode(f"Camera.{name}").real() for name in ("bf", "fx"))
    for name in ("EuRoC.yaml", "EuRoC_fixed.yaml"):
        found = read_cameras(samples / "orb2" / name)
        np.testing.assert_array_equal(np.array(found.warp((752, 480), None).maps), np.array(maps))
        rig = ps.io.read_calibration(samples / "orb2" / name)
        assert (rig.focal, rig.unit) == (fx, "m")
        assert rig.baseline == pytest.approx(bf / fx)

    kitti = ps.io.read_calibration(samples / "orb2/KITTI00-02.yaml")
    assert kitti.baseline == pytest.approx(386.1448 / 718.856)

    rig3 = made_up()  # ORB-SLAM3's
    lines = ['%YAML:1.0\n\nCamera.type: "PinHole"\nCamera.width: 160\nCamera.height: 120\n']
    for number in (1, 2):
        k, names = rig3[f"K{number}"], ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"]
        numbers = *k[[0, 1, 0, 1], [0, 1, 2, 2]], *rig3[f"D{number}"]
        values = zip(names, numbers, strict=True)
        lines += [f"Camera{number}.{name}: {float(value)!r}\n" for name, value in values]
    pose = np.linalg.inv(pose_of(rig3)).ravel().tolist()
    lines += [f"Stereo.T_c1_c2: !!opencv-matrix\n  rows: 4\n  cols: 4\n  dt: f\n  data:{pose}\n"]
    (tmp_path / "orb3.yaml").write_text("".join(lines))
    assert_cameras(read_cameras(tmp_path / "orb3.yaml"), rig3)
    alone = "".join(line for line in lines if "Stereo" not in line and "k1" not in line)
    (tmp_path / "mono.yaml").write_text(alone)
    with pytest.raises(ValueError, match="mono.yaml: holds one camera with distortion"):
        read_cameras(tmp_path / "mono.yaml")


# Rectified pairs


P = "7.215377e+02 0 6.095593e+02 {tx} 0 7.215377e+02 1.728540e+02 {ty} 0 0 1 {tz}"
KITTI = {"P0": (0, 0, 0), "P1": (-387.5744, 0, 0), "P2": (44.85728, 0.2163791, 0.002745884),
         "P3": (-339.5242, 2.199936, 0.002729905)}  # fmt: skip


def kitti(*names: str) -> str:
    keys = "tx", "ty", "tz"
    return "".join(
        f"{name}: {P.format(**dict(zip(keys, KITTI[name], strict=True)))}\n" for name in names
    )


def test_files_of_kitti(samples: Path, tmp_path: Path) -> None:
    path = tmp_path / "calib.txt"
    for names, baseline in (
        (("P0", "P1"), 387.5744 / 721.5377),
        (("P2", "P3"), (44.85728 + 339.5242) / 721.5377),
        (tuple(KITTI), (44.85728 + 339.5242) / 721.5377),
    ):
        path.write_text(kitti(*names) + "Tr_velo_to_cam: 1 2 3\n")
        found = ps.io.read_calibration(path, (1242, 375))
        assert (found.focal, found.unit, found.doffs) == (721.5377, "m", 0)
        assert found.baseline == pytest.approx(baseline, rel=1e-4)
        with pytest.raises(ValueError, match="size: got None, and the file has none"):
            ps.io.read_calibration(path)

    # Images that are rectified stay as they are, to the bit.
    pair = np.random.default_rng(0).integers(0, 256, (2, 375, 1242), np.uint8)
    rig = ps.rectify(pair[0], pair[1], path)
    np.testing.assert_array_equal(rig.left, pair[0])
    np.testing.assert_array_equal(rig.right, pair[1])
    assert rig.calibration == ps.io.read_calibration(path, (1242, 375))
    assert any("P2 and P3 are taken" in sentence for sentence in rig.sentences)

    real = ps.io.read_calibration(samples / "kitti/000074.txt", (1241, 376))
    assert real.baseline == pytest.approx(0.5371657)


def test_kitti_of_raw_images(tmp_path: Path) -> None:
    rig = made_up()
    made = of_opencv(rig, SIZE)
    text = "calib_time: 09-Jan-2012 13:57:47\ncorner_dist: 9.950000e-02\n"
    for n, side in (("02", "1"), ("03", "2")):
        pose = np.eye(4) if side == "1" else pose_of(rig)
        values = {
            "S": [160, 120], "K": rig[f"K{side}"], "D": rig[f"D{side}"], "R": pose[:3, :3],
            "T": pose[:3, 3], "S_rect": [150, 110], "R_rect": made[f"R{side}"],
            "P_rect": made[f"P{side}"],
        }  # fmt: skip
        for name, matrix in values.items():
            text += f"{name}_{n}: {' '.join(map(repr, np.ravel(matrix).astype(float).tolist()))}\n"
    (tmp_path / "calib_cam_to_cam.txt").write_text(text)
    found = read_cameras(tmp_path / "calib_cam_to_cam.txt")
    for part, other in zip(found.warp(SIZE, None).maps, made["maps"], strict=True):
        np.testing.assert_allclose(part, other, atol=1e-3)
    (x, y), _ = found.warp((150, 110), None).maps
    assert (x == np.arange(150)).all()
    assert (y == np.arange(110)[:, np.newaxis]).all()
    assert found.geometry(None)[0].baseline == pytest.approx(np.linalg.norm(rig["T"]))


def test_k_and_a_baseline_of_foundation_stereo(samples: Path, tmp_path: Path) -> None:
    found = ps.io.read_calibration(samples / "foundation_K.txt", (960, 540))
    assert (found.focal, found.unit) == (754.6680908203125, "m")
    assert found.baseline == pytest.approx(0.063)
    assert found.depth(47.0) == pytest.approx(754.668 * 0.063 / 47, rel=1e-5)
    for text, message in (
        ("1 0 0 0 1 0 0 0 1", "a matrix K without a baseline"),
        ("1 2 3", "3 numbers"),
    ):
        (tmp_path / "K.txt").write_text(text)
        with pytest.raises(ValueError, match=f"K.txt: holds {message}"):
            ps.io.read_calibration(tmp_path / "K.txt", (960, 540))


def test_every_reader_takes_middleburys_calibration(tmp_path: Path) -> None:
    (tmp_path / "calib.txt").write_text(
        "cam0=[100 0 32; 0 100 20; 0 0 1]\ncam1=[100 0 34; 0 100 20; 0 0 1]\n"
        "doffs=2\nbaseline=70\nwidth=66\nheight=40\nndisp=16\n"
    )
    pair = np.random.default_rng(0).integers(0, 256, (2, 40, 66), np.uint8)
    rig = ps.rectify(pair[0], pair[1], tmp_path / "calib.txt")
    assert rig.calibration is not None
    assert rig.calibration.unit == "mm"
    assert rig.calibration.baseline == pytest.approx(70)
    assert rig.calibration.doffs == 2
    half = ps.io.read_calibration(tmp_path / "calib.txt", (33, 20))
    assert (half.focal, half.doffs, half.ndisp, half.baseline) == (50, 1, 8, 70)


def test_maps_of_fixed_point(samples: Path, tmp_path: Path) -> None:
    made = of_opencv(made_up(), SIZE)
    stored: dict[str, Any] = {}
    for word, maps in zip(("left", "right"), made["maps"], strict=True):
        fixed = cv2.convertMaps(*maps, cv2.CV_16SC2)
        stored |= {f"{word}MapX": fixed[0], f"{word}MapY": fixed[1]}
    np.savez(tmp_path / "maps.npz", allow_pickle=False, **stored)
    for part, other in zip(read_cameras(tmp_path / "maps.npz").warp(SIZE, None).maps,
                           made["maps"], strict=True):  # fmt: skip
        np.testing.assert_allclose(part, other, atol=1 / 64)  # it counts in 32nds

    real = read_cameras(samples / "stereo_camera_calibration.npz")
    assert real.geometry(None)[0].width == 320
    with pytest.raises(ValueError, match="got maps of 320 x 240 pixels, which cannot be scaled"):
        real.at((640, 480))
    del stored["leftMapY"]
    with pytest.raises(ValueError, match="map1y: map1x is of fixed point"):
        read_cameras(stored)


# What a size has to do with it


def test_a_calibration_is_scaled_where_the_proportions_fit_and_else_refused() -> None:
    """What the scaled cameras see is what the whole ones see, reduced."""
    rig = made_up()
    whole = read_cameras({**rig, "image_width": SIZE[0], "image_height": SIZE[1]})
    half, notes = whole.at((80, 60))
    assert notes == ("the calibration of 160 x 120 pixels is scaled to 80 x 60",)
    for side in (1, 2):
        reduced = (seen(rig, POINTS, side) + 0.5) / 2 - 0.5
        np.testing.assert_allclose(seen({**half.matrices, "R": rig["R"], "T": rig["T"]}, POINTS,
                                        side), reduced, atol=1e-9)  # fmt: skip
    for size in ((160, 100), (80, 80), (120, 160)):
        with pytest.raises(ValueError, match="accepts that of the images' .* same proportions"):
            whole.at(size)


def test_a_size_that_is_not_in_the_file_is_held_against_the_principal_points() -> None:
    rig = made_up()  # about (80, 60)
    with pytest.raises(ValueError, match=r"principal point \(82, 57\) lies outside of images"):
        read_cameras(rig).at((80, 60))
    assert read_cameras(rig).at(SIZE)[1] == ()
    assert "far from the middle" in read_cameras(rig).at((100, 75))[1][0]


# Refused by what it is


def test_files_are_refused_by_what_they_are(tmp_path: Path) -> None:
    scipy = counterpart("scipy.io")
    object_of_matlab = io.BytesIO()
    scipy.savemat(object_of_matlab, {"None": np.zeros(3)})
    contents: list[tuple[bytes, str]] = [
        (pickle.dumps({"K1": np.eye(3)}), "is a Python pickle, which could run anything"),
        (b"\x89HDF\r\n\x1a\n\0\0\0\0", "is an HDF5 file, as MATLAB writes with -v7.3"),
        (b"SQLite format 3\0", "is an SQLite database"),
        (b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM" + bytes(9),
         "is an HDF5 file, as MATLAB writes with -v7.3"),
        (b"\x1f\x8b\x08\0\0\0\0\0", "is a gzip archive; unpack it"),
        (b"%PDF-1.7", "is a PDF document"),
        (b"\x89PNG\r\n\x1a\n", "is a PNG picture"),
        (object_of_matlab.getvalue(), "holds an object of MATLAB.*toStruct"),
        (b'cam0_calib: "cam0_mei.yaml"\n', "is a configuration of VINS"),
        (b'{"controls-laserstate": "on", "a": 1}', "it holds controls-laserstate, a; accepts"),
        (b"[LEFT_CAM_8K]\nfx=1\n[STEREO]\nBaseline=1\n", "has no sections LEFT_CAM and RIGHT_CAM"),
        (b"[camera]\nfx=1\n", "it holds DEFAULT, CAMERA; accepts"),
        (b"<html><body/></html>", "is XML of 'html'; accepts"),
        (b"<html>", "is damaged XML"),
        (b"Camera.fx: 1.0\nCamera.fy: 1\nCamera.cx: 1\nCamera.cy: 1\n", "it is not a stereo rig"),
        (json.dumps({"cameraData": [], "stereoRectificationData": {
            "leftCameraSocket": -1, "rightCameraSocket": -1}}).encode(), "holds no stereo pair"),
        (b"P0: 1 2 3\nP1: 1 2 3\n", "P0|reshape"),
    ]  # fmt: skip
    for content, message in contents:
        (tmp_path / "some").write_bytes(content)
        for read in (read_cameras, ps.io.read_calibration):
            with pytest.raises(ValueError, match=message) as raised:
                read(tmp_path / "some")
            assert str(raised.value).startswith(f"{tmp_path / 'some'}: ")
            assert "\n" not in str(raised.value)


@pytest.mark.parametrize(("size", "baseline"), [(-30.0, 0.1), (-0.1, None)])
def test_camera_info_without_distortion_is_read_and_its_baseline_checked(
    tmp_path: Path, size: float, baseline: float | None
) -> None:
    yaml = counterpart("yaml")

    def matrix(rows: int, numbers: list[float]) -> dict[str, Any]:
        return {"rows": rows, "cols": len(numbers) // rows, "data": numbers}

    kinds = [([0.0] * 5, "plumb_bob"), ([], ""), ([0.0] * 5, "equidistant"), ([], "plumb_bob")]
    for rotation in (np.eye(3), np.zeros((3, 3))):
        for distortion, model in kinds:
            for name, tx in (("left", 0.0), ("right", size)):
                (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump({
                    "image_width": 360, "image_height": 240, "distortion_model": model,
                    "camera_matrix": matrix(3, [300.0, 0, 180, 0, 300, 120, 0, 0, 1]),
                    "distortion_coefficients": matrix(1, distortion),
                    "rectification_matrix": matrix(3, rotation.ravel().tolist()),
                    "projection_matrix": matrix(3, [300.0, 0, 180, tx, 0, 300, 120, 0, 0, 0, 1, 0]),
                }))  # fmt: skip
            if baseline is None:
                with pytest.raises(ValueError, match=r"baseline of 0.33 mm.*for 0.1 m -30"):
                    ps.io.read_calibration(tmp_path)
            else:
                assert ps.io.read_calibration(tmp_path).baseline == pytest.approx(baseline)


@pytest.mark.parametrize("binning", [0, 2])
def test_camera_info_as_ros2_topic_echo_prints_it(tmp_path: Path, binning: int) -> None:
    """K and P are of the whole sensor, the images a region of interest, binned."""
    yaml, by = counterpart("yaml"), binning or 1
    for name, tx in (("left", 0.0), ("right", -30.0)):
        message = {
            "header": {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": name},
            "height": 480, "width": 640, "distortion_model": "plumb_bob", "d": [0.0] * 5,
            "k": [300.0, 0, 320, 0, 300, 240, 0, 0, 1], "r": np.eye(3).ravel().tolist(),
            "p": [300.0, 0, 320, tx, 0, 300, 240, 0, 0, 0, 1, 0],
            "binning_x": binning, "binning_y": binning,
            "roi": {"x_offset": 100, "y_offset": 80, "height": 240, "width": 360,
                    "do_rectify": False},
        }  # fmt: skip
        (tmp_path / f"{name}.yaml").write_text(f"{yaml.safe_dump(message)}---\n")
    found = ps.io.read_calibration(tmp_path)
    assert (found.width, found.height) == (360 // by, 240 // by)
    assert found.cam0 == ((300 / by, 0, 220 / by), (0, 300 / by, 160 / by), (0, 0, 1))
    assert found.baseline == pytest.approx(0.1)
    with pytest.raises(ValueError, match="same proportions"):
        ps.io.read_calibration(tmp_path, (640, 480))

"""Rectification by a calibration: OpenCV's bits, from any file of the cameras."""

from __future__ import annotations

import json
import pickle
import zipfile
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
import phasestereo_live as live
from phasestereo.io import read_calibration
from phasestereo_bench.rendering import render_pair
from phasestereo_live.video.rectifying import Rectifier
from support import counterpart
from support.rigs import SIZE, cv2, euroc, euroc_frames, made_up, of_opencv, turned

if TYPE_CHECKING:
    from pathlib import Path

yaml = counterpart("yaml")

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")  # noise is matched here

RNG = np.random.default_rng(0)
PAIR: Any = RNG.integers(0, 256, (2, SIZE[1], SIZE[0]), np.uint8)


def rectified(calibration: Any, **options: Any) -> ps.Rectification:
    return of(PAIR, calibration, **options)


def of(pair: Any, calibration: Any, **options: Any) -> ps.Rectification:
    return ps.rectify(pair[0], pair[1], calibration, **options)


def assert_same_bits(found: ps.Rectification, maps: Any, pair: Any = PAIR) -> None:
    for image, given, (x, y) in zip((found.left, found.right), pair, maps, strict=True):
        np.testing.assert_array_equal(image, cv2.remap(given, x, y, cv2.INTER_LINEAR))


# Real rigs


def test_raw_frames_of_euroc_come_out_as_opencv_has_them(data: Path) -> None:
    folder, rig = data / "rigs/euroc", euroc(data)
    pair = euroc_frames(data)[0]
    expected = of_opencv(rig, (752, 480))

    files = folder / "cam0/sensor.yaml", folder / "cam1/sensor.yaml"
    for source in (files, folder, rig):
        found = of(pair, source)
        assert_same_bits(found, expected["maps"], pair)

    assert found.Q is not None
    np.testing.assert_allclose(found.Q, expected["Q"], atol=1e-9)

    assert found.error is not None
    assert found.error < 0.1
    assert found.sentences[0].startswith("rows correspond as the calibration says")

    diagnosis = ps.check(found.left, found.right)
    assert {"alignment", "blur"} & {
        finding.topic for finding in diagnosis.findings if finding.severity != "ok"
    } == set()


def test_the_calibration_of_another_rig_is_reported(data: Path) -> None:
    found = of(euroc_frames(data)[0], data / "rigs/stereopi")
    assert "the calibration is not of these cameras" in found.sentences[0]


# Kinds of files


def opencv_yaml(path: Path, matrices: dict[str, Any]) -> Path:
    """Write a file with OpenCV itself."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, matrix in matrices.items():
        storage.write(name, np.atleast_2d(matrix))
    storage.release()
    return path


def test_files_of_opencv(tmp_path: Path) -> None:
    rig = made_up()
    expected = of_opencv(rig, SIZE)

    for name in ("rig.yml", "rig.yaml", "rig.xml"):
        assert_same_bits(rectified(opencv_yaml(tmp_path / name, rig)), expected["maps"])

    np.savez(tmp_path / "rig.npz", allow_pickle=False, **rig)
    assert_same_bits(rectified(tmp_path / "rig.npz"), expected["maps"])

    (tmp_path / "folder").mkdir()
    for key, matrix in rig.items():
        np.save(tmp_path / f"folder/{key}.npy", matrix)
    assert_same_bits(rectified(tmp_path / "folder"), expected["maps"])


VECTOR = {  # as OpenCV 5 writes an array of one dimension
    "yml": "{name}: !!opencv-nd-matrix\n   sizes: [ {size} ]\n   dt: d\n   data: [ {numbers} ]\n",
    "xml": '<{name} type_id="opencv-nd-matrix">\n  <sizes>\n    {size}</sizes>\n  <dt>d</dt>\n'
    "  <data>\n    {numbers}</data></{name}>\n",
}


@pytest.mark.parametrize("ending", VECTOR)
def test_files_of_opencv_5(tmp_path: Path, ending: str) -> None:
    rig = made_up()
    matrices = {name: matrix for name, matrix in rig.items() if matrix.ndim == 2}
    path = opencv_yaml(tmp_path / f"rig.{ending}", matrices)

    between = {"yml": ", ", "xml": " "}[ending]
    vectors = "".join(
        VECTOR[ending].format(
            name=name, size=vector.size, numbers=between.join(map(repr, vector.tolist()))
        )
        for name, vector in rig.items()
        if vector.ndim == 1
    )
    text = path.read_text("utf-8").replace("%YAML:1.0", "%YAML 1.2")
    end = text.find("</opencv_storage>") if ending == "xml" else len(text)
    path.write_text(text[:end] + vectors + text[end:], encoding="utf-8")
    assert_same_bits(rectified(path), of_opencv(rig, SIZE)["maps"])


def test_cameras_one_above_the_other(tmp_path: Path) -> None:
    rig = made_up() | {"R": np.eye(3), "T": np.array([0.001, -0.12, 0.002])}
    found = rectified(rig)
    assert_same_bits(found, of_opencv(rig, SIZE)["maps"])
    assert found.Q is not None
    np.testing.assert_allclose(found.Q, of_opencv(rig, SIZE)["Q"], atol=1e-9)
    assert found.vertical
    assert "columns" in found.sentences[0]

    found.save(tmp_path / "rig.npz")
    assert ps.Rectification.load(tmp_path / "rig.npz").vertical

    rectifier = Rectifier(rig, (None, None))
    assert rectifier.vertical is None
    rectifier.pair(*PAIR)
    assert rectifier.vertical


def test_two_files_that_complete_each_other(tmp_path: Path) -> None:
    rig = made_up()
    inner = {"M1": rig["K1"], "D1": rig["D1"], "M2": rig["K2"], "D2": rig["D2"]}
    opencv_yaml(tmp_path / "intrinsics.yml", inner)
    opencv_yaml(tmp_path / "extrinsics.yml", {"R": rig["R"], "T": rig["T"]})
    names = [tmp_path / "intrinsics.yml", tmp_path / "extrinsics.yml"]
    for source in (names, tmp_path):
        assert_same_bits(rectified(source), of_opencv(rig, SIZE)["maps"])


@pytest.mark.parametrize("names", [
    "K1 D1 K2 D2 R T", "M1 D1 M2 D2 R T", "cameraMatrix1 distCoeffs1 cameraMatrix2 distCoeffs2 R T",
    "camera_matrix_left dist_coeffs_left camera_matrix_right dist_coeffs_right rot_mat trans_vec",
    "cam_mats_left dist_coefs_left cam_mats_right dist_coefs_right rot_mat trans_vec",
    "mtxL distL mtxR distR R T", "mtx_1 dist_1 mtx_2 dist_2 rotation translation",
    "K0 D0 K1 D1 R T", "left_K left_D right_K right_D R T",
    "cameraMatrixL distCoeffsL cameraMatrixR distCoeffsR rotationMatrix translationVector",
])  # fmt: skip
def test_the_names_that_people_give_matrices(names: str) -> None:
    rig = made_up()
    named = dict(zip(names.split(), rig.values(), strict=True))
    assert_same_bits(
        rectified(named | {"rms": 0.2, "valid_box": [1, 2]}), of_opencv(rig, SIZE)["maps"]
    )


def test_a_rotation_may_be_a_vector() -> None:
    rig = made_up()
    vector = cv2.Rodrigues(rig["R"])[0]
    assert_same_bits(
        rectified(rig | {"R": vector.ravel()}),
        of_opencv(rig | {"R": cv2.Rodrigues(vector)[0]}, SIZE)["maps"],
    )


def test_alpha_is_that_of_opencv() -> None:
    rig = made_up()
    for alpha in (0.0, 0.5, 1.0):
        found = rectified(rig, alpha=alpha)
        assert_same_bits(found, of_opencv(rig, SIZE, alpha)["maps"])
        assert (found.left_mask.mean() > 0.99) == (alpha == 0)
    assert_same_bits(rectified(rig, alpha=-1), of_opencv(rig, SIZE)["maps"])


def test_a_rectification_in_the_file_is_taken_as_it_is() -> None:
    rig = made_up()
    made = of_opencv(rig, SIZE, 1)
    known = {name: made[name] for name in ("R1", "R2", "P1", "P2", "Q")}
    assert_same_bits(rectified(rig | known), made["maps"])
    assert_same_bits(rectified(rig | known, alpha=0), of_opencv(rig, SIZE, 0)["maps"])


@pytest.mark.parametrize("names", [
    "map1x map1y map2x map2y", "mapLx mapLy mapRx mapRy", "left_map_x left_map_y right_map_x "
    "right_map_y", "stereoMapL_x stereoMapL_y stereoMapR_x stereoMapR_y", "undistortion_map_left "
    "rectification_map_left undistortion_map_right rectification_map_right",
])  # fmt: skip
def test_maps_may_be_given_themselves(tmp_path: Path, names: str) -> None:
    made = of_opencv(made_up(), SIZE)
    parts = [*made["maps"][0], *made["maps"][1]]
    np.savez(
        tmp_path / "maps.npz", allow_pickle=False, **dict(zip(names.split(), parts, strict=True))
    )

    found = rectified(tmp_path / "maps.npz")
    assert_same_bits(found, made["maps"])
    assert found.Q is None


def dump(content: Any) -> str:
    """Return YAML."""
    return str(yaml.safe_dump(content))


def ros(k: Any, d: Any, r: Any, p: Any, **more: Any) -> str:
    def matrix(values: Any) -> dict[str, Any]:
        values = np.atleast_2d(values)
        return {"rows": values.shape[0], "cols": values.shape[1], "data": values.ravel().tolist()}

    return dump({
        "image_width": SIZE[0], "image_height": SIZE[1], "camera_name": "narrow",
        "camera_matrix": matrix(k), "distortion_model": "plumb_bob",
        "distortion_coefficients": matrix(d), "rectification_matrix": matrix(r),
        "projection_matrix": matrix(p),
    } | more)  # fmt: skip


def test_a_pair_of_camera_info_of_ros(tmp_path: Path) -> None:
    rig = made_up()
    made = of_opencv(rig, SIZE, 0)
    for side, name in (("1", "left"), ("2", "right")):
        text = ros(rig[f"K{side}"], rig[f"D{side}"], made[f"R{side}"], made[f"P{side}"])
        (tmp_path / f"{name}.yaml").write_text(text)

    found = rectified((tmp_path / "left.yaml", tmp_path / "right.yaml"))
    assert_same_bits(found, made["maps"])
    assert_same_bits(rectified(str(tmp_path)), made["maps"])

    assert found.Q is not None
    np.testing.assert_allclose(found.Q, made["Q"], atol=1e-9)


def test_a_pair_of_camera_info_as_it_is_recorded(tmp_path: Path) -> None:
    rig = made_up()
    made = of_opencv(rig, SIZE)
    for side in "12":
        info = {"height": SIZE[1], "width": SIZE[0], "distortion_model": "plumb_bob"} | {
            name: np.ravel((rig | made)[f"{name}{side}"]).tolist() for name in "KDRP"
        }
        (tmp_path / f"{side}.yaml").write_text(yaml.safe_dump(info))

    assert_same_bits(rectified([tmp_path / "1.yaml", tmp_path / "2.yaml"]), made["maps"])


def kalibr(rig: dict[str, Any], model: str, *, by_imu: bool = False) -> str:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rig["R"], rig["T"]

    body = np.eye(4)
    body[:3, :3], body[:3, 3] = turned(10, 20, 30), (0.1, 0.2, 0.3)
    cameras = {}

    for number in (0, 1):
        k = rig[f"K{number + 1}"]
        cameras[f"cam{number}"] = {
            "cam_overlaps": [1 - number], "camera_model": "pinhole", "distortion_model": model,
            "distortion_coeffs": rig[f"D{number + 1}"][:4].tolist(), "resolution": list(SIZE),
            "intrinsics": [float(k[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2))],
            "rostopic": f"/cam{number}/image_raw",
        }  # fmt: skip
        if by_imu:
            cameras[f"cam{number}"]["T_cam_imu"] = ((pose if number else np.eye(4)) @ body).tolist()

    if not by_imu:
        cameras["cam1"]["T_cn_cnm1"] = pose.tolist()
    return dump(cameras)


def test_a_chain_of_kalibr(tmp_path: Path) -> None:
    rig = made_up()
    expected = of_opencv(rig | {"D1": rig["D1"][:4], "D2": rig["D2"][:4]}, SIZE)

    (tmp_path / "camchain.yaml").write_text(kalibr(rig, "radtan"))
    found = rectified(tmp_path / "camchain.yaml")
    assert_same_bits(found, expected["maps"])

    (tmp_path / "imu.yaml").write_text(kalibr(rig, "radtan", by_imu=True))
    for part, other in zip(rectified(tmp_path / "imu.yaml").maps, found.maps, strict=True):
        np.testing.assert_allclose(part, other, atol=1e-3)


def test_fisheyes_of_a_chain_of_kalibr(tmp_path: Path) -> None:
    rig = made_up() | {"D1": np.array([-0.01, 0.02, 0, 0]), "D2": np.array([0.01, -0.01, 0, 0])}
    (tmp_path / "camchain.yaml").write_text(kalibr(rig, "equidistant"))

    given = [rig[name] for name in ("K1", "D1", "K2", "D2")]
    r1, r2, p1, p2, *_ = cv2.fisheye.stereoRectify(
        *given, SIZE, rig["R"], rig["T"].reshape(3, 1), flags=cv2.CALIB_ZERO_DISPARITY
    )

    maps = [
        cv2.fisheye.initUndistortRectifyMap(k, d, r, p, SIZE, cv2.CV_32FC1)
        for k, d, r, p in ((*given[:2], r1, p1), (*given[2:], r2, p2))
    ]

    found = rectified(tmp_path / "camchain.yaml")
    assert_same_bits(found, maps)
    assert found.Q is not None


# Two sizes


def raw(image: Any, rig: dict[str, Any], side: str, *, by: float) -> Any:
    """Return the view of a camera of a rig, this many times as large, and its K."""
    made = of_opencv(rig, LARGE)
    scale = np.array([[by, 0, (by - 1) / 2], [0, by, (by - 1) / 2], [0, 0, 1]])
    k, size = scale @ rig[f"K{side}"], [round(by * length) for length in LARGE]
    x, y = np.meshgrid(*map(np.arange, size))
    pixels = np.stack([x, y], axis=-1).reshape(-1, 1, 2).astype(np.float64)
    lens = k, rig[f"D{side}"]
    turn = {"R": made[f"R{side}"], "P": made[f"P{side}"]}
    places = cv2.undistortPoints(pixels, *lens, **turn).reshape(*x.shape, 2).astype(np.float32)
    soft = cv2.GaussianBlur(image, (0, 0), 0.5 / by) if by < 1 else image
    return cv2.remap(soft, places[..., 0], places[..., 1], cv2.INTER_CUBIC), k


LARGE = 320, 240


@pytest.fixture(scope="module")
def scene() -> tuple[Any, dict[str, Any]]:
    """Return a rectified scene and the rig whose raw images are larger than `SIZE`."""
    rig = made_up()
    double = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]])
    rig |= {name: double @ rig[name] for name in ("K1", "K2")}
    return render_pair(3, height=LARGE[1], width=LARGE[0], num_disparities=32), rig


def wrong(found: ps.Rectification, truth: Any) -> float:
    """Return the share of disparities that are off, where both cameras see."""
    masks: dict[str, Any] = {"left_mask": found.left_mask, "right_mask": found.right_mask}
    result = ps.match(found.left, found.right, num_disparities=40, **masks)
    scored = (slice(16, -16), slice(48, -16))
    return float(np.mean(~(np.abs(result.disparity - truth)[scored] <= 1)))


@pytest.mark.parametrize("by", [0.5, 0.8, 1.5])
def test_cameras_of_two_sizes(tmp_path: Path, scene: Any, by: float) -> None:
    rendered, rig = scene
    left, k1 = raw(rendered.left, rig, "1", by=1)
    right, k2 = raw(rendered.right, rig, "2", by=by)
    rows, cols = right.shape[:2]

    chain = yaml.safe_load(kalibr(rig, "radtan"))
    for name, k, size in (("cam0", k1, LARGE), ("cam1", k2, (cols, rows))):
        numbers = [float(k[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2))]
        chain[name] |= {"intrinsics": numbers, "resolution": list(size)}
    (tmp_path / "chain.yaml").write_text(yaml.safe_dump(chain))

    mask = np.ones((rows, cols), bool)
    mask[:, : cols // 8] = False
    for calibration in (tmp_path / "chain.yaml", rig | {"imageSize": LARGE}):
        found = ps.rectify(left, right, calibration, right_mask=mask)
        assert wrong(found, rendered.truth) < 0.12
        assert found.Q is not None
        np.testing.assert_allclose(found.Q, of_opencv(rig, LARGE)["Q"], rtol=0.02, atol=2)
        assert not found.right_mask[120, : LARGE[0] // 8 - 4].any()

    found.save(tmp_path / "saved.npz")
    again = ps.rectify(left, right, tmp_path / "saved.npz", right_mask=mask)
    np.testing.assert_array_equal(again.right_mask, found.right_mask)
    np.testing.assert_array_equal(again.right, found.right)
    applied = found.apply(left, right)[1]
    inside = slice(None), slice(LARGE[0] // 4, None)  # masked pixels are read from their neighbors
    np.testing.assert_array_equal(applied[inside], found.right[inside])

    geometry = read_calibration(tmp_path / "chain.yaml", LARGE)
    assert found.calibration is not None
    np.testing.assert_allclose(geometry.cam0, found.calibration.cam0, rtol=1e-2)

    # The error is that of the pair at hand, not of the one that the file is from.
    assert found.error is not None
    moved = ps.rectify(left, np.roll(right, 6, axis=0), tmp_path / "saved.npz")
    assert moved.error is not None
    assert moved.error > 6 / by - 2 > found.error
    assert "rows do not correspond" in moved.sentences[0]

    with pytest.raises(ValueError, match=f"accepts that of the images' 320 x 240 and {cols} x "):
        ps.rectify(left, right[: rows // 2], tmp_path / "chain.yaml")


@pytest.mark.parametrize("by", [0.5, 1.5])
def test_images_of_two_sizes_and_types_alone(scene: Any, by: float) -> None:
    rendered, rig = scene
    left, _ = raw(rendered.left, rig, "1", by=1)
    right, _ = raw(rendered.right, rig, "2", by=by)
    found = ps.rectify(left, right.astype(np.uint16) * 257)
    assert found.right.shape == left.shape
    assert found.right.dtype == np.uint16
    seen = ps.check(found.left, found.right, self_rectify=False).alignment
    assert seen is not None
    assert seen.rms < 0.5


# What is refused


@pytest.mark.parametrize("content", [
    b"\x89PNG\r\n\x1a\n\0\0", b"", b"hello", b"- 1\n- 2\n", b"a: b: c", b"%YAML:1.0\n---\nx: [1, 2",
    b"cam0=[1 0 0; 0 1 0; 0 0 1]\n", b"K1: !!python/object/apply:os.system [ls]", b"\xff\xfe\0a",
    b"PK\x03\x04 no zip", b"<?xml version='1.0'?><a/>", b"K1: &a [1]\nK2: *a\n",
])  # fmt: skip
def test_files_that_are_no_calibration(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "rig.yml"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"rig\.yml: ") as raised:
        rectified(path)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(("change", "message"), [
    ({"K1": np.eye(4)}, r"K1: got shape \(4, 4\); accepts \(3, 3\)"),
    ({"D2": np.zeros(3)}, r"D2: got shape \(3,\); accepts 4, 5, 8, 12, 14 numbers"),
    ({"R": np.zeros((3, 3)) * np.nan}, "R: holds a value that is not a finite number"),
    ({"T": np.array([0.12, 0, 0])}, "a left camera that is on the right"),
    ({"T": np.array([0.01, 0.12, 0])}, "a left camera that is below the other one"),
    ({"M1": np.eye(3)}, "gives K1 twice"),
    ({"K2": np.array([["a"] * 3] * 3)}, "K2: holds <U1; accepts numbers"),
    ({"R": np.zeros((3, 3))}, r"R: is not a rotation: R R\^T differs from the identity by 1"),
    ({"R": 5 * np.eye(3)}, r"R: is not a rotation: R R\^T differs from the identity by 24"),
    ({"R": np.random.default_rng(0).normal(size=(3, 3))}, "R: is not a rotation"),
    ({"R": np.diag([1.0, 1.0, -1.0])}, "R: is a mirror, not a rotation"),
    ({"K1": np.diag([1e300, 1e300, 1.0])}, r"K1: got a number of size 1e\+300; accepts 1e\+09"),
    ({"K1": np.diag([1e-300, 1e-300, 1.0])}, "K1: got no positive focal lengths of a camera"),
    ({"K2": np.array([[80.0, 0, 0], [0, 80, 0], [40, 30, 1]])}, "K2: got the last row 40 30 1"),
])  # fmt: skip
def test_matrices_that_are_no_camera_pair(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        rectified(made_up() | change)


def test_what_is_missing_is_reported() -> None:
    rig = made_up()
    del rig["D2"]
    with pytest.raises(ValueError, match=r"^calibration: has no D2, only D1, K1, K2, R, T; a"):
        rectified(rig)


def test_an_alpha_that_has_no_effect_is_refused() -> None:
    maps = zip(("map1x", "map1y", "map2x", "map2y"), np.ones((4, *SIZE[::-1])), strict=True)
    for calibration in (None, rectified(made_up()), dict(maps)):
        with pytest.raises(ValueError, match=r"^alpha: got 0\.5; accepts None without the matric"):
            rectified(calibration, alpha=0.5)


def test_a_calibration_of_another_size_is_refused(tmp_path: Path) -> None:
    (tmp_path / "camchain.yaml").write_text(kalibr(made_up(), "radtan"))
    small: Any = PAIR[:, ::2]
    with pytest.raises(ValueError, match="^calibration: got that of 160 x 120 pixels; accepts"):
        of(small, tmp_path / "camchain.yaml")

    found = rectified(made_up())
    for use in (lambda: of(small, found), lambda: found.apply(*small)):
        with pytest.raises(ValueError, match="pixels; accepts"):
            use()


def test_one_camera_is_no_pair(tmp_path: Path) -> None:
    rig = made_up()
    (tmp_path / "left.yaml").write_text(ros(rig["K1"], rig["D1"], np.eye(3), np.eye(3, 4)))
    with pytest.raises(ValueError, match=r"left\.yaml: holds one camera; give the files of both"):
        rectified(tmp_path / "left.yaml")


@pytest.mark.parametrize(("change", "message"), [
    ({"cam1": {}}, "cam1 has neither T_cn_cnm1 nor T_cam_imu"),
    ({"cam0": {"camera_model": "omni"}}, "camera_model: got omni; accepts pinhole"),
    ({"cam0": {"distortion_model": "fov"}}, "distortion_model: got fov; accepts radtan"),
    ({"cam0": {"intrinsics": [1, 2, 3]}}, "intrinsics: got 3 numbers; accepts 4"),
    ({"cam0": {"resolution": None}}, "the cameras differ in model, or one has no size"),
    ({"cam0": {"resolution": "large"}}, "resolution: "),
    ({"cam1": {"T_cn_cnm1": np.diag([0, 0, 0, 1]).tolist()}}, "T_cn_cnm1: is not a rotation"),
    ({"cam1": {"T_cn_cnm1": np.ones((4, 4)).tolist()}}, "T_cn_cnm1: accepts 4 x 4 numbers, a"),
])  # fmt: skip
def test_chains_that_tell_too_little(tmp_path: Path, change: Any, message: str) -> None:
    chain = yaml.safe_load(kalibr(made_up(), "radtan"))
    for name, values in change.items():
        chain[name] = chain[name] | values if values else {}
    (tmp_path / "chain.yaml").write_text(yaml.safe_dump(chain))
    with pytest.raises(ValueError, match=rf"chain\.yaml: .*{message}"):
        rectified(tmp_path / "chain.yaml")


@pytest.mark.parametrize(("arguments", "error", "message"), [
    ({"calibration": 5}, TypeError, "^calibration: got int; accepts"),
    ({"calibration": ["a", "b", "c"]}, TypeError, "^calibration: got list; accepts"),
    ({"calibration": "nowhere.yml"}, FileNotFoundError, "nowhere.yml"),
    ({"alpha": 2}, ValueError, "^alpha: got 2; accepts"),
    ({"alpha": "0"}, TypeError, "^alpha: got str; accepts"),
    ({"interpolation": "nearest"}, ValueError, "^interpolation: got 'nearest'; accepts"),
    ({"left_mask": np.ones((2, 2), bool)}, ValueError, "^left_mask: got shape"),
])  # fmt: skip
def test_wrong_arguments(arguments: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        ps.rectify(*PAIR, **({"calibration": made_up()} | arguments))


# What is carried


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32", "float64"])
@pytest.mark.parametrize("channels", [(), (3,)])
def test_images_keep_type_and_shape(dtype: str, channels: tuple[int, ...]) -> None:
    pair: Any = RNG.integers(0, 256, (2, SIZE[1], SIZE[0], *channels)).astype(dtype)
    for interpolation in ("linear", "cubic", "lanczos"):
        found = of(pair, made_up(), interpolation=interpolation)
        assert found.left.dtype == found.right.dtype == dtype
        assert found.left.shape == pair[0].shape


def test_masks_are_false_outside_and_where_pixels_are_masked() -> None:
    rig = made_up()

    found = rectified(rig, alpha=1)
    (x, y), _ = found.maps
    inside = (x >= 0) & (x <= SIZE[0] - 1) & (y >= 0) & (y <= SIZE[1] - 1)
    np.testing.assert_array_equal(found.left_mask, inside)

    mask = np.ones(PAIR[0].shape, bool)
    mask[40:60, 50:80] = False

    masked = rectified(rig, alpha=1, right_mask=mask)
    hole = found.right_mask & ~masked.right_mask
    np.testing.assert_array_equal(masked.left_mask, found.left_mask)
    assert 300 < hole.sum() < 1500

    x, y = found.maps[1]
    assert ((x[hole] > 48) & (x[hole] < 81) & (y[hole] > 38) & (y[hole] < 61)).all()


def test_masked_pixels_may_be_nan() -> None:
    pair: Any = PAIR.astype(np.float32)
    mask = np.ones(PAIR[0].shape, bool)
    mask[40:60, 50:80] = False
    pair[:, ~mask] = np.nan

    found = of(pair, made_up(), left_mask=mask, right_mask=mask)
    assert np.isfinite(found.left[found.left_mask]).all()
    assert (found.error, found.sentences) == (None, ())

    with pytest.raises(ValueError, match="^left: got NaN"):
        ps.rectify(pair[0], pair[1])


def assert_same(one: ps.Rectification, other: ps.Rectification) -> None:
    for name in ("left", "right", "left_mask", "right_mask", "Q"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_array_equal(np.array(one.maps), np.array(other.maps))
    for name in ("method", "interpolation", "error", "sentences"):
        assert getattr(one, name) == getattr(other, name)
    assert repr(one) == repr(other)


def test_it_is_saved_loaded_and_pickled(tmp_path: Path) -> None:
    found = rectified(made_up(), alpha=1)
    found.save(tmp_path / "rig.npz")
    assert_same(ps.Rectification.load(tmp_path / "rig.npz"), found)
    assert_same(pickle.loads(pickle.dumps(found)), found)  # noqa: S301  # our own
    assert_same(rectified(tmp_path / "rig.npz"), found)

    without = rectified({f"map{n}": part for n, part in zip(("1x", "1y", "2x", "2y"), (
        *found.maps[0], *found.maps[1]), strict=True)})  # fmt: skip
    without.save(tmp_path / "maps.npz")
    assert ps.Rectification.load(tmp_path / "maps.npz").Q is None


@pytest.mark.parametrize("change", [
    {"plain": np.array("[")}, {"plain": np.array("{}")}, {"map1x": np.zeros((2, 2), np.float32)},
    {"left_mask": np.zeros((2, 2), bool)}, {"right": np.zeros((1, 1), np.uint8)},
    {"Q": np.zeros(3)}, {"map2y": np.zeros((SIZE[1], SIZE[0]))}, {"left": np.array("a")},
    {"plain": np.array(json.dumps({"method": "magic", "interpolation": "linear", "error": None,
                                  "sentences": []}))},
])  # fmt: skip
def test_a_saved_file_with_a_wrong_value_is_refused(tmp_path: Path, change: Any) -> None:
    path = tmp_path / "rig.npz"
    rectified(made_up()).save(path)
    with np.load(path) as file:
        arrays = dict(file)

    np.savez(path, allow_pickle=False, **(arrays | change))

    for read in (ps.Rectification.load, rectified):
        with pytest.raises(ValueError, match=r"rig\.npz: "):
            read(path)


def test_a_saved_file_that_is_damaged_anywhere_is_refused_or_whole(tmp_path: Path) -> None:
    path = tmp_path / "rig.npz"
    found = of(PAIR[:, :12, :16], {
        "map1x": np.zeros((12, 16)), "map1y": np.zeros((12, 16)),
        "map2x": np.zeros((12, 16)), "map2y": np.zeros((12, 16)),
    })  # fmt: skip
    found.save(path)

    content = path.read_bytes()
    for place in range(0, len(content), 41):
        path.write_bytes(content[:place] + bytes([content[place] ^ 0xFF]) + content[place + 1 :])
        try:
            assert_same(ps.Rectification.load(path), found)
        except ValueError as error:
            assert str(path) in str(error)  # noqa: PT017

    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(ValueError, match=r"rig\.npz: "):
        ps.Rectification.load(path)


def test_nothing_in_a_saved_file_is_pickled(tmp_path: Path) -> None:
    rectified(made_up()).save(tmp_path / "rig.npz")
    with zipfile.ZipFile(tmp_path / "rig.npz") as archive:
        assert not any(b"|O" in archive.read(name)[:200] for name in archive.namelist())


# Streams


def test_a_stream_rectifies_its_frames() -> None:
    frames: Any = RNG.integers(0, 256, (3, 2, SIZE[1], SIZE[0]), np.uint8)
    rig = rectified(made_up(), alpha=1)
    for source in (rig, made_up()):
        with live.stream(list(frames), num_disparities=16, preset="fast", rectify=source) as stream:
            matched = list(stream)

        for frame, pair in zip(matched, frames, strict=True):
            wanted = of(pair, source)

            np.testing.assert_array_equal(frame.left, wanted.left)
            expected = ps.match(
                wanted.left, wanted.right, num_disparities=16, preset="fast",
                left_mask=wanted.left_mask, right_mask=wanted.right_mask,
            )  # fmt: skip
            np.testing.assert_array_equal(frame.result.disparity, expected.disparity)


def test_a_stream_refuses_a_calibration_at_once(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        live.stream(list(PAIR[np.newaxis]), num_disparities=8, rectify=tmp_path / "no.yml")

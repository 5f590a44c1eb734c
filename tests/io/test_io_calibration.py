"""Calibrations: parsed, checked, and turned into depth."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo.io import Calibration, read_calibration
from support import counterpart

QUARTER = "middlebury/MiddEval3/trainingQ"

CALIBRATION = """\
cam0=[1000.5 0 300; 0 1000.5 200; 0 0 1]
cam1=[1000.5 0 330; 0 1000.5 200; 0 0 1]
doffs=30
baseline=200.25
width=640
height=480
ndisp=70
isint=0
vmin=7
vmax=65.5
dyavg=0.23
"""


def calibration(tmp_path: Path, text: str) -> Calibration:
    (tmp_path / "calib.txt").write_text(text, encoding="utf-8")
    return read_calibration(tmp_path / "calib.txt")


def test_calibration_is_parsed(tmp_path: Path) -> None:
    loaded = calibration(tmp_path, CALIBRATION)

    assert loaded == Calibration(
        cam0=((1000.5, 0, 300), (0, 1000.5, 200), (0, 0, 1)),
        cam1=((1000.5, 0, 330), (0, 1000.5, 200), (0, 0, 1)),
        doffs=30,
        baseline=200.25,
        width=640,
        height=480,
        ndisp=70,
        vmin=7,
        vmax=65.5,
        unit="mm",
    )

    assert loaded.focal == 1000.5
    assert len({loaded, calibration(tmp_path, CALIBRATION.replace("=", " = "))}) == 1

    short = calibration(tmp_path, "\n".join(CALIBRATION.splitlines()[:6]))
    assert short == replace(loaded, ndisp=None, vmin=None, vmax=None)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("doffs=30", "doffs 30", "line 3, 'doffs 30': expected name=value"),
        ("doffs=30", "=30", "line 3"),
        ("doffs=30", "doffs=thirty", "line 3"),
        ("doffs=30", "doffs=", "line 3"),
        ("width=640", "width=640.5", "line 5"),
        ("isint=0", "width=640", "line 8.*width is given twice"),
        ("cam0=[1000.5 0 300; 0 1000.5 200; 0 0 1]", "cam0=[1000.5 0 300]", "line 1.*3 rows"),
        ("cam0=[1000.5 0 300; 0 1000.5 200; 0 0 1]", "cam0=1000.5 0 300", "line 1.*matrix"),
        ("cam0=[1000.5 0 300;", "cam0=[1000.5 zero 300;", "line 1"),
        ("cam0=[1000.5 0 300;", "cam0=[1000.5 0;", "line 1.*3 numbers"),
        ("cam0=[1000.5 0 300;", "cam0=[1000.5 nan 300;", "cam0 must be 3 x 3 finite"),
        ("cam0=[1000.5 0 300;", "cam0=[-1000.5 0 300;", "positive focal length"),
        ("[1000.5 0 300; 0 1000.5 200", "[1000.5 1 300; 0 1000.5 200", "rectified camera"),
        ("cam0=[1000.5 0 300; 0 1000.5 200", "cam0=[1000.5 0 300; 0 -5 200", "rectified camera"),
        ("cam1=", "cam9=", "no line gives cam1"),
        ("doffs=30", "doffs=nan", "doffs must be finite"),
        ("baseline=200.25", "baseline=0", "baseline must be positive"),
        ("baseline=200.25", "baseline=inf", "baseline must be positive and finite"),
        ("height=480", "height=-1", "height must be positive"),
        ("ndisp=70", "ndisp=0", "ndisp must be positive"),
    ],
)
def test_malformed_calibrations_are_refused(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in CALIBRATION
    with pytest.raises(ValueError, match=rf"calib\.txt: .*{message}"):
        calibration(tmp_path, CALIBRATION.replace(old, new))


def test_depth_is_the_formula_and_nan_where_there_is_none(tmp_path: Path) -> None:
    loaded = calibration(tmp_path, CALIBRATION)
    disparity = np.array([[0, 7.5, np.nan, np.inf], [-30, -31, -29.5, -np.inf]], np.float32)

    depth = loaded.depth(disparity)
    product = 200.25 * 1000.5

    expected = [
        [product / 30, product / 37.5, np.nan, np.nan],
        [np.nan, np.nan, 2 * product, np.nan],
    ]

    assert depth.dtype == np.float32
    np.testing.assert_allclose(depth, expected, rtol=1e-6)
    assert loaded.depth(0).shape == ()

    with pytest.raises(TypeError, match="real numbers"):
        loaded.depth(np.array(["7"]))


@pytest.mark.parametrize("use", [
    lambda disparity, rig: rig.depth(disparity), ps.point_cloud, ps.surface_mesh,
    lambda disparity, rig: ps.depth_interval(disparity, rig, uncertainty=np.ones((2, 2))),
])  # fmt: skip
def test_sixteenths_of_opencv_are_not_pixels(use: Callable[..., Any]) -> None:
    rig = Calibration.from_focal(300, 0.1, width=2, height=2, unit="m")
    with pytest.raises(TypeError, match=r"got int16.*divide by 16\.0"):
        use(np.full((2, 2), 320, np.int16), rig)
    use(np.full((2, 2), 20, np.int32), rig)


def test_a_calibration_of_resized_images() -> None:
    rig = Calibration.from_focal(300, 0.1, width=360, height=240, doffs=4, cx=170, cy=110, unit="m")
    half = rig.scaled(180, 120)
    # A pixel of the half covers two of the whole: so do its centers and disparities.
    assert half == Calibration.from_focal(
        150, 0.1, width=180, height=120, doffs=2, cx=84.75, cy=54.75, unit="m"
    )
    np.testing.assert_array_equal(half.depth([8.0]), rig.depth([16.0]))
    assert rig.scaled(361, 241).width == 361
    with pytest.raises(
        ValueError, match="accepts that of images with the proportions of 360 x 200"
    ):
        rig.scaled(360, 200)


def test_units_are_known_or_left_open() -> None:
    rig = Calibration.from_focal(300, 100, width=4, height=4, unit="mm")
    assert (rig.in_meters().baseline, rig.in_meters().unit) == (0.1, "m")
    assert replace(rig, unit=None).in_meters().baseline == 100
    with pytest.raises(ValueError, match="unit must be one of mm, cm, m, got 'inch'"):
        replace(rig, unit="inch")  # type: ignore[arg-type]  # what is tested


# OpenCV's Q


Q = np.array(
    [
        [1, 0, 0, -333.75],
        [0, 1, 0, -240.5],
        [0, 0, 0, 512.25],
        [0, 0, 1 / 128, 4 / 128],  # baseline 128, doffs 4
    ]
)
SIZE: Any = {"width": 640, "height": 480}


def test_q_and_calibration_say_the_same() -> None:
    rig = Calibration.from_q(Q, **SIZE)
    assert rig == Calibration.from_focal(512.25, 128, doffs=4, cx=333.75, cy=240.5, **SIZE)
    assert rig.cam1[0][2] == 337.75
    np.testing.assert_array_equal(rig.q, Q)
    assert Calibration.from_q(-2 * Q, **SIZE) == rig  # Q is homogeneous
    assert Calibration.from_q(Q.astype(np.float32).tolist(), **SIZE) == rig


def test_focal_lengths_may_differ() -> None:
    camera = ((500.0, 0, 300), (0, 400.0, 200), (0, 0, 1))
    rig = Calibration(cam0=camera, cam1=camera, doffs=0, baseline=64, **SIZE)
    np.testing.assert_array_equal(rig.q[1], [0, 1.25, 0, -250])
    assert Calibration.from_q(rig.q, **SIZE) == rig


def changed(row: int, column: int, value: float) -> NDArray[np.float64]:
    matrix = Q.copy()
    matrix[row, column] = value
    return matrix


@pytest.mark.parametrize(
    ("q", "error", "message"),
    [
        (Q[:3], ValueError, "q must be 4 x 4 finite numbers"),
        (changed(0, 3, np.nan), ValueError, "q must be 4 x 4 finite numbers"),
        (Q > 0, TypeError, "q must hold real numbers, got dtype bool"),
        (np.zeros((4, 4)), ValueError, "q must be .1 0 0 -cx"),
        (np.eye(4), ValueError, "q must be .1 0 0 -cx"),  # no focal length
        (Q.T, ValueError, "q must be .1 0 0 -cx"),
        (changed(0, 1, 0.5), ValueError, "q must be .1 0 0 -cx"),
        (
            Q * [[1], [-1], [-1], [1]],
            ValueError,
            "Y down, Z forward",
        ),  # as OpenCV's sample turns it
        (changed(3, 2, -1 / 128), ValueError, r"element \[3, 2\].* on the right of"),
        (changed(3, 2, 0), ValueError, r"element \[3, 2\]"),
    ],
)
def test_other_matrices_are_no_q(q: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=f"^{message}" if message.startswith("q") else message):
        Calibration.from_q(q, **SIZE)


def test_two_equal_cameras_look_through_the_center() -> None:
    rig = Calibration.from_focal(500, 0.12, **SIZE)
    assert rig.cam0 == rig.cam1 == ((500, 0, 319.5), (0, 500, 239.5), (0, 0, 1))
    assert (rig.doffs, rig.baseline, rig.ndisp) == (0, 0.12, None)
    assert rig.depth(60) == pytest.approx(1)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"focal": 0}, ValueError, "focal: got 0; accepts a positive, finite number"),
        ({"focal": "500"}, TypeError, "^focal: got .*; accepts a number"),
        ({"focal": True}, TypeError, "^focal: got .*; accepts a number"),
        ({"focal": np.nan}, ValueError, "^focal: got .*; accepts a positive, finite number"),
        ({"baseline": -0.1}, ValueError, "baseline must be positive"),
        ({"doffs": np.inf}, ValueError, "^doffs: got .*; accepts a finite number"),
        ({"cx": np.nan}, ValueError, "^cx: got .*; accepts a finite number"),
        ({"cy": [1]}, TypeError, "^cy: got .*; accepts a number"),
        ({"width": 0}, ValueError, "width must be positive"),
        ({"width": "640"}, TypeError, "^width: got .*; accepts a number"),
        ({"height": None}, TypeError, "^height: got .*; accepts a number"),
        ({"height": 480.0}, TypeError, "height must be an integer"),
    ],
)
def test_cameras_that_cannot_be_are_refused(
    arguments: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=f"^{message}"):
        Calibration.from_focal(**({"focal": 500, "baseline": 0.12} | SIZE | arguments))


def test_calibrations_hold_for_one_size(tmp_path: Path) -> None:
    loaded = calibration(tmp_path, CALIBRATION)
    loaded.check_size((480, 640))
    loaded.check_size((480, 640, 3))
    with pytest.raises(ValueError, match="that of 640 x 480 .* the images' 320 x 240"):
        loaded.check_size((240, 320))


@pytest.mark.parametrize("suffix", [".yml", ".yaml", ".xml"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_q_is_read_from_files_of_opencv(tmp_path: Path, suffix: str, dtype: type) -> None:
    cv2 = counterpart("cv2")
    path = tmp_path / f"extrinsics{suffix}"

    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("P1", np.ones((3, 4)))
    storage.write("Q", Q.astype(dtype))
    storage.write("Q2", np.zeros((4, 4)))
    storage.release()

    found = read_calibration(path, (640, 480)).q
    np.testing.assert_allclose(found, Q, rtol=1e-8 if dtype == np.float64 else 1e-7)


def test_q_is_read_from_files_of_numpy(tmp_path: Path) -> None:
    np.save(tmp_path / "q.npy", Q)
    np.savez(tmp_path / "rig.npz", R1=np.eye(3), Q=Q)
    np.savetxt(tmp_path / "q.txt", Q)
    np.savetxt(tmp_path / "commas.txt", Q, delimiter=", ")

    for name in ("q.npy", "rig.npz", "q.txt", "commas.txt"):
        found = read_calibration(tmp_path / name, (640, 480))
        np.testing.assert_allclose(found.q, Q, rtol=1e-15)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("q.txt", b"1 2 3\n4 5 6", r"q\.txt: holds 6 numbers; .* or the 16 of Q"),
        ("q.txt", b"one two", r"q\.txt: "),
        ("q.npy", b"not an array", r"q\.npy: "),
        ("q.npz", b"not a zip", r"q\.npz: "),
        ("q.yml", b"%YAML:1.0\nP: 1\n", r"q\.yml: "),
        (
            "q.yml",
            b"Q: !!opencv-matrix\n rows: 4\n cols: 4\n dt: d\n data: [ 1., 0. ]",
            r"q\.yml: a matrix of 4 x 4 has 2 numbers",
        ),
        (
            "q.yml",
            b"Q: !!opencv-matrix\n rows: 1\n cols: 2\n dt: d\n data: [ 1., 0. ]",
            r"q\.yml: q must be 4 x 4",
        ),
        ("q.xml", b"<opencv_storage></opencv_storage>", r"q\.xml: "),
    ],
)
def test_files_without_a_q_are_refused(
    tmp_path: Path, name: str, content: bytes, message: str
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=message):
        read_calibration(tmp_path / name, (640, 480))


def test_a_q_asks_for_the_size(tmp_path: Path) -> None:
    np.save(tmp_path / "q.npy", Q)
    with pytest.raises(ValueError, match=r"q\.npy: size: got None for a matrix Q"):
        read_calibration(tmp_path / "q.npy")


def test_archives_without_a_q_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "rig.npz", R1=np.eye(3))
    with pytest.raises(ValueError, match=r"rig\.npz: is not a calibration .* it holds R1"):
        read_calibration(tmp_path / "rig.npz", (640, 480))
    np.save(tmp_path / "q.npy", np.array([[None] * 4] * 4))
    with pytest.raises(ValueError, match=r"q\.npy: "):
        read_calibration(tmp_path / "q.npy", (640, 480))

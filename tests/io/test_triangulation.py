"""Points in space: what OpenCV makes of the same disparities, in color, and nothing else."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo.io import Calibration, read_calibration, read_disparity, read_image
from phasestereo_bench.rendering import render_pair
from support import counterpart

ROWS, COLS = 48, 64
RIG = Calibration(
    cam0=((500.5, 0, 30.25), (0, 480.5, 21.5), (0, 0, 1)),
    cam1=((500.5, 0, 33.5), (0, 480.5, 21.5), (0, 0, 1)),
    doffs=3.25,
    baseline=120.75,
    width=COLS,
    height=ROWS,
)


def disparities() -> NDArray[np.float32]:
    return np.random.default_rng(1).uniform(-3, 60, (ROWS, COLS)).astype(np.float32)


def test_a_pair_rectified_by_opencv_keeps_its_geometry() -> None:
    cv2 = counterpart("cv2")

    camera = np.array([[500.0, 0, 31], [0, 500, 23], [0, 0, 1]])
    other = np.array([[500.0, 0, 36], [0, 500, 23], [0, 0, 1]])
    turn, _ = cv2.Rodrigues(np.array([0.01, 0.02, -0.01]))
    shift = np.array([[-120.0], [2], [1]])

    for flags in (0, cv2.CALIB_ZERO_DISPARITY):  # with and without doffs
        rectified = cv2.stereoRectify(
            camera, None, other, None, (COLS, ROWS), turn, shift, flags=flags
        )

        q, left, right = rectified[4], rectified[2], rectified[3]
        rig = Calibration.from_q(q, width=COLS, height=ROWS)
        # OpenCV 5 computes some of it in float32
        assert rig.baseline == pytest.approx(np.linalg.norm(shift), rel=1e-5)
        assert rig.doffs == pytest.approx(right[0, 2] - left[0, 2], abs=1e-4)
        assert (rig.doffs != 0) == (flags == 0)

        disparity = disparities() + 5 - np.float32(rig.doffs)
        expected = cv2.reprojectImageTo3D(disparity, q).reshape(-1, 3)
        np.testing.assert_allclose(ps.point_cloud(disparity, rig).points, expected, rtol=1e-6)


def test_a_point_projects_to_its_pixels() -> None:
    """Both cameras see each point where the pair has it."""
    disparity = disparities()
    x, y, z = ps.point_cloud(disparity, RIG).points.T.astype(np.float64)
    rows, cols = np.mgrid[:ROWS, :COLS].reshape(2, -1)
    (fx, _, cx), (_, fy, cy), _ = RIG.cam0

    np.testing.assert_allclose(fx * x / z + cx, cols, atol=1e-4)
    np.testing.assert_allclose(fy * y / z + cy, rows, atol=1e-4)

    in_right = fx * (x - RIG.baseline) / z + RIG.cam1[0][2]
    np.testing.assert_allclose(in_right, cols - disparity.ravel(), atol=1e-4)


def test_only_pixels_with_a_depth_become_points() -> None:
    disparity = np.full((ROWS, COLS), 10, np.float32)
    disparity[0, :5] = [np.nan, np.inf, -np.inf, -3.25, -4]
    disparity[1, 1] = -3.25 + 1e-5  # 6 km away

    wanted = np.ones((ROWS, COLS), bool)
    wanted[2] = False

    image = np.arange(ROWS * COLS, dtype=np.uint32).view(np.uint8).reshape(ROWS, COLS, 4)
    cloud = ps.point_cloud(disparity, RIG, image=image, mask=wanted, max_depth=1e4)

    kept = wanted.copy()
    kept[0, :5] = kept[1, 1] = False
    assert len(cloud) == kept.sum()
    np.testing.assert_array_equal(cloud.colors, image[kept][:, :3])  # row by row, alpha left out
    np.testing.assert_allclose(cloud.points[:, 2], 120.75 * 500.5 / 13.25, rtol=1e-6)

    everything = ps.point_cloud(disparity, RIG)
    assert len(everything) == ROWS * COLS - 5
    assert everything.points[:, 2].max() > 1e6


def test_points_beyond_float32_are_left_out() -> None:
    rig = Calibration.from_focal(1.0, 3e38, width=COLS, height=ROWS)
    cloud = ps.point_cloud(np.ones((ROWS, COLS)), rig)
    assert 0 < len(cloud) < ROWS * COLS  # X or Y overflows towards the edges


def test_a_result_is_taken_as_it_is() -> None:
    pair = render_pair(3, height=96, width=128, num_disparities=24)
    result = ps.match(pair.left, pair.right, num_disparities=24)

    sure = result.flags == 0
    cloud = ps.point_cloud(result, pair.calibration, mask=sure, keep="all")
    assert 0.5 * sure.size < len(cloud) == sure.sum() < sure.size

    alone = ps.point_cloud(result.disparity, pair.calibration, image=pair.left, mask=sure)
    np.testing.assert_array_equal(cloud.points, alone.points)
    np.testing.assert_array_equal(cloud.colors, alone.colors)

    other = ps.point_cloud(result, pair.calibration, image=pair.right, mask=sure, keep="all")
    assert (other.colors != cloud.colors).any()

    forgotten = replace(result, pair=None)  # as one that was pickled
    assert ps.point_cloud(forgotten, pair.calibration).colors is None


@pytest.mark.parametrize(
    ("image", "expected"),
    [
        (np.array([[0, 7, 255]], np.uint8), [0, 7, 255]),
        (np.array([[0, 7, 255]], np.uint16), [0, 7, 255]),  # 8 bits in 16
        (np.array([[0, 256, 1023]], np.uint16), [0, 64, 255]),  # 10 bits
        (np.array([[0, 256, 65535]], np.uint16), [0, 1, 255]),
        (np.array([[0, 0.6, 1]], np.float32), [0, 153, 255]),
        (np.array([[-10, 2, 10]], np.float64), [0, 153, 255]),
        (np.array([[np.nan, 1, 2]], np.float32), [0, 0, 255]),
        (np.full((1, 3), np.nan, np.float32), [0, 0, 0]),
        (np.full((1, 3), 7, np.float32), [0, 0, 0]),
        (np.array([[0, 7, 255]], ">u2"), [0, 7, 255]),
    ],
)
def test_images_of_any_type_give_colors(image: NDArray[Any], expected: list[int]) -> None:
    rig = Calibration.from_focal(10, 1, width=3, height=1)
    for form in (image, image[:, :, None], np.repeat(image[:, :, None], 3, axis=2)):
        cloud = ps.point_cloud(np.ones((1, 3)), rig, image=form)
        assert cloud.colors.dtype == np.uint8
        np.testing.assert_array_equal(cloud.colors, np.repeat(expected, 3).reshape(3, 3))


ONE = np.ones((ROWS, COLS), np.float32)


@pytest.mark.parametrize(
    ("disparity", "options", "error", "message"),
    [
        (ONE > 0, {}, TypeError, "disparity: got dtype bool"),
        ("no map", {}, TypeError, "disparity: got str; accepts an array"),
        (np.ma.masked_array(ONE), {}, TypeError, "disparity: got a masked array"),
        (ONE[0], {}, ValueError, r"disparity: got shape \(64,\)"),
        (ONE[:, 1:], {}, ValueError, "calibration: got that of 64 x 48 pixels; .* 63 x 48"),
        (ONE, {"calibration": RIG.q}, TypeError, "calibration: got ndarray"),
        (ONE, {"image": ONE[1:]}, ValueError, r"image: got \(47, 64\) pixels"),
        (ONE, {"image": ONE > 0}, TypeError, "image: got dtype bool"),
        (ONE, {"mask": ONE}, TypeError, "mask: got dtype float32"),
        (ONE, {"mask": ONE[1:] > 0}, ValueError, "mask: got shape"),
        (ONE, {"max_depth": 0}, ValueError, "max_depth: got 0"),
        (ONE, {"max_depth": np.nan}, ValueError, "max_depth: got nan"),
        (ONE, {"max_depth": "far"}, TypeError, "max_depth: got str"),
        (ONE, {"max_depth": True}, TypeError, "max_depth: got bool"),
    ],
)
def test_refusals(disparity: Any, options: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=f"^{message}"):
        ps.point_cloud(disparity, **({"calibration": RIG} | options))


POINTS = np.zeros((4, 3), np.float32)


@pytest.mark.parametrize(
    ("points", "colors", "error", "message"),
    [
        ([[0, 0, 1]], None, TypeError, "points: got dtype int"),
        (POINTS.astype(np.float64), None, TypeError, "points: got dtype float64"),
        (POINTS.ravel(), None, ValueError, "points: got shape"),
        (POINTS[:, :2], None, ValueError, "points: got shape"),
        (POINTS + np.float32(np.inf), None, ValueError, "points: got infinity or NaN"),
        (POINTS, POINTS, TypeError, "colors: got dtype float32"),
        (POINTS, np.zeros((4, 4), np.uint8), ValueError, "colors: got shape"),
        (
            POINTS,
            np.zeros((3, 3), np.uint8),
            ValueError,
            r"colors: got shape \(3, 3\); accepts \(4, 3\)",
        ),
    ],
)
def test_clouds_are_what_they_say(
    points: Any, colors: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=f"^{message}"):
        ps.PointCloud(points, colors)


def test_clouds_tell_their_size() -> None:
    cloud = ps.point_cloud(ONE, RIG, image=ONE)
    span = "14220 to 14220"
    assert repr(cloud) == f"<PointCloud {ROWS * COLS} points, depth {span}, colored>"
    assert repr(ps.point_cloud(np.nan * ONE, RIG)) == "<PointCloud 0 points>"
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(cloud)).points, cloud.points)  # noqa: S301 - our own


def test_depths_of_a_real_pair_are_right(data: Path) -> None:
    scene = data / "middlebury/MiddEval3/trainingQ/Motorcycle"
    left, right = read_image(scene / "im0.png"), read_image(scene / "im1.png")
    calibration = read_calibration(scene / "calib.txt")
    truth = read_disparity(scene / "disp0GT.pfm")
    seen = read_image(scene / "mask0nocc.png") == 255

    result = ps.match(left, right, num_disparities=80)
    assert median_error(result.disparity, truth, calibration, seen) < 0.005

    cloud = ps.point_cloud(result, calibration, image=left, mask=seen & np.isfinite(truth))
    near, far = np.percentile(cloud.points[:, 2], (1, 99))
    assert 1900 < near < far < 5000  # mm: a motorcycle in a workshop


def median_error(
    disparity: NDArray[np.float32],
    truth: NDArray[np.float32],
    calibration: Calibration,
    mask: NDArray[np.bool_],
) -> float:
    """Return the median error of the depths, relative to the true ones."""
    depth, right = calibration.depth(disparity), calibration.depth(truth)
    error = np.abs(depth - right)[mask & np.isfinite(right)] / right[mask & np.isfinite(right)]
    return float(np.median(np.where(np.isnan(error), np.inf, error)))

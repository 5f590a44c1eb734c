"""Error bars of depths: their ends, what a yaw adds to them, what an anchor takes away."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

import phasestereo as ps
from phasestereo.io import Calibration
from phasestereo.result import KEEPS
from phasestereo_bench.datasets import Pair
from phasestereo_bench.rendering import render_pair
from support import counterpart

Map = NDArray[np.float32]

RIG = Calibration.from_focal(1000, 0.5, width=4, height=2, doffs=2.0)
DISPARITY = np.array([[98, 48, -1.5, np.nan], [8, 3, -4, 498]], np.float32)
FLAGS = np.zeros(DISPARITY.shape, np.uint16)
BAR = np.where(np.isnan(DISPARITY), np.nan, 1).astype(np.float32)
TURNED = 0.1  # degrees of yaw that the calibration does not know


@pytest.fixture(scope="module")
def pair() -> Pair:
    return render_pair(7, height=240, width=400, num_disparities=48)


def moved_by_yaw(x: NDArray[np.float64], calibration: Calibration) -> NDArray[np.float64]:
    """Return the columns of the right image after its camera is turned."""
    (focal, _, center), _, _ = calibration.cam1
    angle = np.arctan((x - center) / focal) - np.radians(TURNED)
    seen: NDArray[np.float64] = center + focal * np.tan(angle)
    return seen


def covered(found: ps.DepthInterval, truth: NDArray[Any], mask: NDArray[np.bool_]) -> float:
    """Return the share of the depths that lie between their ends."""
    inside = (found.near <= truth) & (truth <= found.far)
    return float(inside[mask & np.isfinite(found.near)].mean())


def test_the_ends_are_those_of_the_disparities() -> None:
    depth, near, far = ps.depth_interval(DISPARITY, RIG, uncertainty=BAR, yaw=0)
    inf, nan = np.inf, np.nan
    np.testing.assert_allclose(depth, [[5, 10, inf, nan], [50, 100, inf, 1]])
    np.testing.assert_allclose(
        near, [[500 / 101, 500 / 51, 500 / 1.5, nan], [500 / 11, 500 / 6, inf, 500 / 501]],
        rtol=1e-6,
    )  # fmt: skip
    np.testing.assert_allclose(
        far, [[500 / 99, 500 / 49, inf, nan], [500 / 9, 500 / 4, inf, 500 / 499]],
        rtol=1e-6,
    )  # fmt: skip
    known = np.isfinite(depth) & np.isfinite(far)
    assert (far[known] - depth[known] > depth[known] - near[known]).all(), "far is less certain"
    found = ps.depth_interval(DISPARITY, RIG, uncertainty=BAR, yaw=0, finite=True)
    np.testing.assert_allclose(found.depth, [[5, 10, 1000, nan], [50, 100, nan, 1]])


def test_a_yaw_is_added_to_the_bars() -> None:
    wide = replace(RIG, width=1001, cam0=((1000, 0, 500), *RIG.cam0[1:]))
    wide = replace(wide, cam1=((1000, 0, 502), *RIG.cam1[1:]))
    disparity, bar = np.full((2, 1001), 8, np.float32), np.full((2, 1001), 0.5, np.float32)
    found = ps.depth_interval(disparity, wide, uncertainty=bar, yaw=0.1)

    share = 500 / found.near - 10 - 0.5
    assert share[0, 510] == pytest.approx(1000 * math.tan(math.radians(0.1)), rel=1e-3)
    assert share[0, 10] == pytest.approx(share[0, 510] * 1.25, rel=1e-3), "t is -0.5 there"

    by_default = ps.depth_interval(disparity, wide, uncertainty=bar)
    wanted = ps.depth_interval(disparity, wide, uncertainty=bar, yaw=0.01)
    np.testing.assert_array_equal(by_default.far, wanted.far)


def test_an_unknown_yaw_is_covered_and_an_anchor_takes_it_away(pair: Pair) -> None:
    """The bars of the matching are short: without the yaw's share next to nothing is covered."""
    known = pair.calibration
    columns = np.arange(pair.truth.shape[1], dtype=np.float64)
    measured = columns - moved_by_yaw(columns - pair.truth, known)
    truth, bar = known.depth(pair.truth), np.full(pair.truth.shape, 0.05)
    everywhere = np.isfinite(truth)

    blind = ps.depth_interval(measured, known, uncertainty=bar, yaw=0)
    assert covered(blind, truth, everywhere) < 0.01
    aware = ps.depth_interval(measured, known, uncertainty=bar, yaw=TURNED)
    assert covered(aware, truth, everywhere) == 1

    anchor = 90, 200, float(truth[200, 90])
    for yaw in (0.0, TURNED):
        fixed = ps.depth_interval(measured, known, uncertainty=bar, yaw=yaw, anchor=anchor)
        assert fixed.depth[200, 90] == pytest.approx(truth[200, 90], rel=1e-6)
        assert covered(fixed, truth, everywhere) == 1
        assert np.median(fixed.far - fixed.near) < 0.4 * np.median(aware.far - aware.near)


def test_an_offset_of_a_rig_moves_depths_and_its_error_is_in_their_bars() -> None:
    found = ps.depth_interval(
        DISPARITY, RIG, uncertainty=BAR, yaw=0, offset=(-3.0, 2.0), finite=True
    )
    np.testing.assert_array_equal(found.depth, replace(RIG, doffs=-1.0).depth(DISPARITY))
    # The first is on the axis but for 95 / 1000, by which a yaw that moves 3 px moves it further.
    bar = 1 + 1.645 * 2 + 3 * (-(98 + 1.5) / 1000) ** 2
    assert found.near[0, 0] == pytest.approx(500 / (97 + bar), rel=1e-4)
    assert found.far[0, 0] == pytest.approx(500 / (97 - bar), rel=1e-4)

    for offset, anchor in (((1.0, 0.1), (0, 0, 5.0)), ((1.0, -0.1), None), ((np.nan, 0.1), None)):
        with pytest.raises(ValueError, match="^offset: "):
            ps.depth_interval(DISPARITY, RIG, uncertainty=BAR, offset=offset, anchor=anchor)


def test_the_sky_is_an_anchor() -> None:
    disparity = np.array([[1.0, 9.0, 17.0, 25.0]] * 2)
    rig = Calibration.from_focal(1000, 0.5, width=4, height=2)
    found = ps.depth_interval(
        disparity, rig, uncertainty=0 * disparity, yaw=0, anchor=(0, 1, math.inf)
    )
    np.testing.assert_array_equal(found.at_infinity[0], [True, False, False, False])
    np.testing.assert_allclose(found.depth[0], [np.inf, 500 / 8, 500 / 16, 500 / 24])


def test_what_may_be_infinitely_far_is_told_from_what_has_no_depth() -> None:
    disparity = np.array([[0.1, 0.3, -0.2, 8.0, np.nan, 0.2]] * 60, np.float32)
    bars = np.full_like(disparity, 0.4)
    sure = np.array([[0.9, 0.9, 0.9, 0.9, 0.9, 0.1]] * 60, np.float32)
    flags = np.zeros(disparity.shape, np.uint16)
    result = ps.Result(disparity, flags, sure, ps.Settings(), {}, uncertainty=bars)
    rig = Calibration.from_focal(300.0, 0.1, width=6, height=60)

    found = ps.depth_interval(result, rig)
    np.testing.assert_array_equal(found.at_infinity[0], [True, True, True, False, False, False])
    np.testing.assert_allclose(found.depth[0, 3:], [30 / 8, np.nan, np.nan], rtol=1e-6)
    assert np.isfinite(found.near[0, 0])
    assert found.far[0, 0] == np.inf
    for options in ({"finite": True}, {"max_depth": 1000.0}):
        near = ps.depth_interval(result, rig, **options).depth
        np.testing.assert_array_equal(np.isfinite(near[0]), [False] * 3 + [True] + [False] * 2)
        assert not np.isinf(near).any()
    assert len(ps.point_cloud(result, rig)) == 60
    with pytest.raises(TypeError, match="^finite: got 'no'; accepts True or False"):
        ps.depth_interval(result, rig, finite="no")  # type: ignore[arg-type]


def test_a_rendered_pair_of_a_turned_camera_is_within_its_bars(pair: Pair) -> None:
    known, valid = pair.calibration, pair.masks["nonocc"]
    # The turned camera sees at `columns` what the right one sees at `source`.
    columns = np.arange(pair.truth.shape[1], dtype=np.float64)
    (focal, _, center), _, _ = known.cam1
    source = center + focal * np.tan(np.arctan((columns - center) / focal) + np.radians(TURNED))
    rows = np.arange(pair.truth.shape[0], dtype=np.float64)
    turned = np.stack(
        [
            ndimage.map_coordinates(
                channel.astype(np.float64), np.meshgrid(rows, source, indexing="ij"), mode="nearest"
            )
            for channel in np.moveaxis(pair.right, 2, 0)
        ],
        axis=2,
    )
    right = np.clip(np.rint(turned), 0, 255).astype(np.uint8)
    result = ps.match(pair.left, right, num_disparities=50)
    truth = known.depth(pair.truth)

    seen = valid & result.trusted
    blind = ps.depth_interval(result, known, yaw=0)
    aware = ps.depth_interval(result, known, yaw=TURNED)
    fixed = ps.depth_interval(result, known, anchor=(90, 200, float(truth[200, 90])))
    assert covered(blind, truth, seen) < 0.7
    assert covered(aware, truth, seen) > 0.9
    assert covered(fixed, truth, seen) > 0.9
    assert np.nanmedian(fixed.far - fixed.near) < np.nanmedian(aware.far - aware.near)


@pytest.fixture(scope="module")
def found(pair: Pair) -> ps.Result:
    return ps.match(pair.left, pair.right, num_disparities=48)


def test_fewer_pixels_are_kept_and_more_of_them_are_right(pair: Pair, found: ps.Result) -> None:
    wrong = np.abs(found.disparity - pair.truth) > 1
    every, trusted, checked = (found.kept(keep) for keep in ("all", "trusted", "checked"))
    assert not (checked & ~trusted).any()
    assert not (trusted & ~every).any()
    assert 0.5 < checked.mean() < trusted.mean() < every.mean()
    assert wrong[checked].mean() < wrong[trusted].mean() < wrong[every].mean()
    np.testing.assert_array_equal(trusted, found.trusted)
    assert not found.flags[checked].any()


def test_real_pairs_have_the_share_of_wrong_pixels_that_is_claimed(data: Path) -> None:
    """What is claimed of the kept pixels, 1 less their mean confidence, is right within a half."""
    shares = []
    for scene in ("Motorcycle", "Piano", "Playroom"):
        folder = data / "middlebury/MiddEval3/trainingQ" / scene
        known = ps.io.read_calibration(folder / "calib.txt")
        result = ps.match(folder / "im0.png", folder / "im1.png", num_disparities=known.ndisp)
        truth = ps.io.read_disparity(folder / "disp0GT.pfm")
        assert result.confidence is not None
        for keep in KEEPS:
            scored = result.kept(keep) & np.isfinite(truth)
            wrong = np.abs(result.disparity - truth)[scored] > 1
            shares.append([wrong.mean(), 1 - result.confidence[scored].mean()])
    by_choice = np.reshape(shares, (3, 3, 2)).mean(axis=0)  # trusted, checked, all
    wrong, claimed = by_choice[[1, 0, 2]].T
    assert (np.diff(wrong) > 0).all()
    assert (np.diff(claimed) > 0).all()
    np.testing.assert_array_less(np.abs(wrong - claimed), wrong / 2)


def test_depths_are_those_that_are_kept(pair: Pair, found: ps.Result) -> None:
    rig = pair.calibration
    every = ps.depth_interval(found, rig, keep="all", finite=True)
    limits = float(np.nanpercentile(every.depth, 20)), float(np.nanpercentile(every.depth, 80))
    for keep in KEEPS:
        kept = found.kept(keep)
        if keep != "all":  # what may be infinitely far has no depth to rely on
            kept &= np.isfinite(every.far)
        assert 0.1 < kept.mean() <= 1
        depths = ps.depth_interval(found, rig, keep=keep, finite=True)
        for values, wanted in zip(depths, every, strict=True):
            np.testing.assert_array_equal(values, np.where(kept, wanted, np.nan))

        cut = ps.depth_interval(found, rig, keep=keep, min_depth=limits[0], max_depth=limits[1])
        inside = kept & (every.depth >= limits[0]) & (every.depth <= limits[1])
        np.testing.assert_array_equal(cut.depth, np.where(inside, every.depth, np.nan))
        cloud = ps.point_cloud(found, rig, keep=keep, min_depth=limits[0], max_depth=limits[1])
        np.testing.assert_array_equal(cloud.points[:, 2], cut.depth[inside])


@pytest.mark.parametrize("n", [2, 3, 7])
def test_a_block_becomes_its_kept_pixel_of_median_disparity(
    pair: Pair, found: ps.Result, n: int
) -> None:
    rig, small = pair.calibration, pair.calibration.decimated(n)
    every, thin = (ps.depth_interval(found, rig, decimate=step, finite=True) for step in (1, n))
    rows, cols = small.height, small.width
    assert (rows, cols) == (rig.height // n, rig.width // n) == thin.depth.shape
    for y in range(rows):
        for x in range(cols):
            block = every.depth[y * n : y * n + n, x * n : x * n + n]
            kept = np.sort(block[np.isfinite(block)])[::-1]  # by disparities, from the smallest
            wanted = kept[(len(kept) - 1) // 2] if len(kept) else np.nan
            np.testing.assert_equal(thin.depth[y, x], wanted)

    # A point of the middle of a block, on a plane, is where the small camera sees it.
    cloud = ps.point_cloud(found, rig, decimate=n)
    known = np.isfinite(thin.depth)
    assert len(cloud) == known.sum()
    columns = np.nonzero(known)[1]
    focal, _, center = small.cam0[0]
    np.testing.assert_allclose(
        cloud.points[:, 0], (columns - center) * thin.depth[known] / focal, rtol=1e-5, atol=1e-3
    )
    assert small.depth(10.0 / n) == pytest.approx(rig.depth(10.0))
    assert small.cam0[1][2] == (rig.cam0[1][2] + 0.5) / n - 0.5


@pytest.mark.parametrize("n", [2, 4])
def test_a_decimated_camera_is_that_of_librealsense(n: int) -> None:
    """Size, which it pads to multiples of 4, and focal lengths; its principal point is ppx / n."""
    rs = counterpart("pyrealsense2")
    cols, rows, focal = 848, 480, 421.5
    lens = rs.intrinsics()
    lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy = (
        cols,
        rows,
        focal,
        focal,
        420,
        238,
    )
    lens.model, lens.coeffs = rs.distortion.none, [0] * 5
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fmt = rs.stream.depth, 0, 0, rs.format.z16
    stream.width, stream.height, stream.fps, stream.bpp, stream.intrinsics = cols, rows, 30, 2, lens
    device, queue = rs.software_device(), rs.frame_queue(1)
    sensor = device.add_sensor("Depth")
    profile = sensor.add_video_stream(stream)
    sensor.add_read_only_option(rs.option.depth_units, 0.001)
    sensor.open(profile)
    sensor.start(queue)
    frame = rs.software_video_frame()
    frame.pixels, frame.stride, frame.bpp = np.full((rows, cols), 1000, np.uint16), 2 * cols, 2
    frame.timestamp, frame.frame_number, frame.depth_units = 1.0, 1, 0.001
    frame.domain = rs.timestamp_domain.hardware_clock
    frame.profile = profile.as_video_stream_profile()
    sensor.on_video_frame(frame)
    made = rs.decimation_filter(n).process(queue.wait_for_frame(5000))
    theirs = made.profile.as_video_stream_profile().intrinsics

    rig = Calibration.from_focal(focal, 0.05, width=cols, height=rows, cx=420, cy=238)
    ours = rig.decimated(n)
    assert (ours.width, ours.height) == (theirs.width, theirs.height)
    assert (ours.focal, ours.cam0[1][1]) == (theirs.fx, theirs.fy)
    assert ours.cam0[0][2] == pytest.approx(theirs.ppx - 0.5 + 0.5 / n)


def test_a_selection_that_is_none_is_refused() -> None:
    bare: dict[str, Any] = {"disparity": DISPARITY, "calibration": RIG}
    for options, message in (
        ({"keep": "sure"}, "^keep: got 'sure'; accepts 'trusted', 'checked', 'all'"),
        ({"min_depth": 0}, "^min_depth: got 0; accepts"),
        ({"min_depth": 5, "max_depth": 4}, "^min_depth: got 5; accepts at most max_depth"),
        ({"decimate": 0}, "^decimate: got 0; accepts 1 or more"),
        ({"decimate": 3}, "^decimate: got 3; accepts 1 to 2"),
    ):
        with pytest.raises(ValueError, match=message):
            ps.point_cloud(**bare, **options)
    with pytest.raises(ValueError, match="^keep: got 'sure'"):
        ps.Result(DISPARITY, FLAGS, None, ps.Settings(), {}).kept("sure")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"^flags: got shape \(1, 4\); accepts that of disparity"):
        ps.Result(DISPARITY, FLAGS[:1], None, ps.Settings(), {}).kept("all")


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"uncertainty": None}, ValueError, "^uncertainty: got None, and a result without"),
        ({"uncertainty": BAR[:1]}, ValueError, r"^uncertainty: got shape \(1, 4\); accepts"),
        ({"uncertainty": -BAR}, ValueError, "^uncertainty: got -1; accepts 0 or more"),
        ({"uncertainty": BAR > 0}, TypeError, "^uncertainty: got dtype bool"),
        ({"yaw": -0.1}, ValueError, "^yaw: got -0.1; accepts"),
        ({"yaw": 11}, ValueError, "^yaw: got 11; accepts a finite number, 0 to 10"),
        ({"yaw": "0.1"}, TypeError, "^yaw: got str"),
        ({"anchor": (1, 1)}, ValueError, r"^anchor: got \(1, 1\); accepts \(x, y, depth\)"),
        ({"anchor": (4, 1, 5.0)}, ValueError, "^anchor: got 4; accepts 0 to 3"),
        ({"anchor": (1, 2, 5.0)}, ValueError, "^anchor: got 2; accepts 0 to 1"),
        ({"anchor": (1, 1, 0.0)}, ValueError, "^anchor: got 0.0; accepts a positive"),
        ({"anchor": (3, 0, 5.0)}, ValueError, r"^anchor: got pixel \(3, 0\), which has no est"),
        ({"calibration": "calib.txt"}, TypeError, "^calibration: got str"),
        (
            {"disparity": DISPARITY[:1], "uncertainty": BAR[:1]},
            ValueError,
            "^calibration: got that of 4 x 2 pixels",
        ),
    ],
)
def test_errors_name_the_argument(
    given: dict[str, Any], error: type[Exception], message: str
) -> None:
    arguments: dict[str, Any] = {
        "disparity": DISPARITY,
        "calibration": RIG,
        "uncertainty": BAR,
    } | given
    with pytest.raises(error, match=message):
        ps.depth_interval(arguments.pop("disparity"), arguments.pop("calibration"), **arguments)

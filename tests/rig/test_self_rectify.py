"""Pairs that are far from rectified: a match rectifies them from what they show, and says so."""

from __future__ import annotations

import hashlib
import subprocess
import sys
import warnings
from typing import TYPE_CHECKING

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.metrics import bad_pixels
from phasestereo_bench.cases import Case, usual_side
from phasestereo_bench.datasets import find_scene
from phasestereo_bench.rigs.geometry import Misaligned
from support import counterpart
from support.rigs import cv2

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from phasestereo_bench.datasets import Pair

counterpart("scipy")

RIGS = {
    "turned by 15 degrees": Misaligned(turn=15),
    "zoomed by 25 %": Misaligned(focal=0.25),
    "60 rows lower": Misaligned(down=60),
    "distorted": Misaligned(distortion=-0.2),
}


@pytest.fixture(scope="module")
def cones(data: Path) -> Pair:
    """Return a real scene whose rows correspond."""
    return find_scene(data / "middlebury", "cones").load()


@pytest.fixture(scope="module")
def turned(cones: Pair) -> Pair:
    """Return the same scene as a rig sees it whose right camera is turned."""
    return RIGS["turned by 15 degrees"](cones, "right")


@pytest.fixture(scope="module")
def found(turned: Pair) -> ps.Result:
    """Return the match of the turned pair."""
    return ps.match(turned.left, turned.right, threads=1)


def bad(pair: Pair, result: ps.Result) -> float:
    assert pair.truth is not None
    return bad_pixels(result.disparity, pair.truth, 1.0, mask=pair.masks["nonocc"])


def sentences(result: ps.Result) -> str:
    return "; ".join(one.sentence for one in result.findings if one.topic == "alignment")


@pytest.mark.parametrize("rig", RIGS)
def test_a_pair_far_from_rectified_is_matched_about_as_well_as_a_rectified_one(
    rig: str, cones: Pair
) -> None:
    pair = RIGS[rig](cones, "right")

    result = ps.match(pair.left, pair.right)

    assert result.rectified is not None
    assert result.rectified.error < 0.5
    assert bad(pair, result) < 12
    assert "far from rectified" in sentences(result)
    assert ("lenses distort" in sentences(result)) == (rig == "distorted")


def test_a_check_reports_what_the_match_does(turned: Pair, found: ps.Result) -> None:
    reported = ps.check(turned.left, turned.right)
    matched = [one for one in found.findings if one.topic == "alignment"]
    assert matched
    assert [one for one in reported.findings if one.topic == "alignment"] == matched
    assert reported.search == found.search
    as_it_is = ps.check(turned.left, turned.right, self_rectify=False)
    assert "rectified by what they show" not in str(as_it_is)


def test_a_map_of_a_turned_pair_is_judged_in_its_raw_pixels(
    turned: Pair,
) -> None:
    truth = np.asarray(turned.truth, np.float32)
    seen = turned.masks["nonocc"] & np.isfinite(truth)
    claims = truth.copy()
    claims[150:200, 180:260] += 6
    square = np.zeros_like(seen)
    square[150:200, 180:260] = True

    judged = ps.verify(turned.left, turned.right, claims, threads=1)
    assert judged.result.rectified is not None
    assert (judged.verdict[seen & square] == ps.Verdict.REFUTED).mean() > 0.6
    assert (judged.verdict[seen & ~square] == ps.Verdict.REFUTED).mean() < 0.05
    assert judged.confidence[seen & square].mean() < 0.3
    assert judged.confidence[seen & ~square].mean() > 0.7
    assert np.array_equal(judged.verdict == ps.Verdict.NO_CLAIM, ~np.isfinite(claims))
    refuted = judged.verdict == ps.Verdict.REFUTED
    assert np.array_equal(judged.better[refuted], judged.result.disparity[refuted])


def test_a_small_scene_shows_its_cameras_at_half_its_size(data: Path) -> None:
    """At its own size too few of its corners agree."""
    scene = find_scene(data / "middlebury", "tsukuba").load()
    pair = RIGS["turned by 15 degrees"](scene, "right")

    result = ps.match(pair.left, pair.right)

    assert result.rectified is not None
    assert bad(pair, result) < 10


def test_a_raw_pair_is_rectified_whatever_its_size(turned: Pair, found: ps.Result) -> None:
    """The same pair enlarged: misalignments of rows are larger by as much."""
    images = [cv2.resize(image, None, fx=4, fy=4) for image in (turned.left, turned.right)]

    result = ps.match(*images)

    assert result.rectified is not None
    assert result.summary is not None
    assert found.summary is not None
    assert result.summary.wrong < found.summary.wrong + 0.15


def test_rows_and_columns_lead_to_the_right_image_as_it_came(
    turned: Pair, found: ps.Result
) -> None:
    assert turned.truth is not None
    assert found.rectified is not None
    y, x = np.mgrid[: turned.truth.shape[0], : turned.truth.shape[1]].astype(float)
    known = find_true_rows(turned.truth, x, y)

    sure = found.trusted & turned.masks["nonocc"]
    error = np.abs(found.rectified.rows - known)[sure & np.isfinite(known)]
    assert error.size > 50_000
    assert np.median(error) < 0.3
    assert np.quantile(error, 0.9) < 1


def find_true_rows(
    truth: NDArray[np.floating], x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return y' - y: of a turn, x' and y fix it."""
    rows, cols = y.shape
    angle, middle_x, middle_y = np.deg2rad(15), (cols - 1) / 2, (rows - 1) / 2
    # x' = cos u - sin v, so u and then y' = sin u + cos v
    across = (x - truth - middle_x + np.sin(angle) * (y - middle_y)) / np.cos(angle)
    lower: NDArray[np.float64] = np.sin(angle) * across + np.cos(angle) * (y - middle_y)
    there: NDArray[np.float64] = lower + middle_y - y
    return there


def test_the_rectified_pair_is_that_of_its_calibration(turned: Pair, found: ps.Result) -> None:
    rectified = found.rectified
    assert rectified is not None
    for maps, index in zip(rectified.maps, (1, 2), strict=True):
        k, d, r, p = (rectified.calibration[f"{name}{index}"] for name in "KDRP")
        size = turned.left.shape[1], turned.left.shape[0]
        theirs = cv2.initUndistortRectifyMap(k, d, r, p[:, :3], size, cv2.CV_32FC1)
        for own, other in zip(maps, theirs, strict=True):
            there = np.isfinite(own)
            assert there.mean() > 0.9
            np.testing.assert_allclose(own[there], other[there], atol=0.01)

    again = ps.rectify(
        turned.left, turned.right, dict(rectified.calibration), interpolation="lanczos"
    )
    assert again.error is not None
    assert again.error < 0.5


def test_a_rig_rectifies_all_frames_by_the_cameras_of_the_first_and_exports_them(
    turned: Pair, found: ps.Result, tmp_path: Path
) -> None:
    rig = ps.Rig()
    first, second = (rig.match(turned.left, turned.right) for _ in range(2))

    assert first.rectified is not None
    assert second.rectified is not None
    np.testing.assert_array_equal(first.disparity, found.disparity)
    np.testing.assert_array_equal(second.rectified.maps, first.rectified.maps)
    assert bad(turned, second) < bad(turned, first) + 1
    assert [event.subject for event in rig.events] == ["cameras"]

    rig.export(tmp_path / "rig.yml")
    rig.export(tmp_path / "chain.yaml", "kalibr")
    rig.export(tmp_path, "camera_info")
    left, right = tmp_path / "left.yaml", tmp_path / "right.yaml"
    for calibration in (tmp_path / "rig.yml", tmp_path / "chain.yaml", (left, right)):
        again = ps.rectify(turned.left, turned.right, calibration)
        assert again.error is not None
        assert again.error < 0.5, calibration
    with pytest.raises(
        ValueError, match="^form: got 'xml'; accepts 'opencv', 'camera_info', 'kalibr'"
    ):
        rig.export(tmp_path / "rig", "xml")  # type: ignore[arg-type]  # the point


LOADING = """
import copy, hashlib, os, pickle, signal, sys, warnings
warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 advises against it
import numpy as np, phasestereo as ps
path, pair = sys.argv[1], np.load(sys.argv[2])

def threads():
    return len(os.listdir("/proc/self/task"))

def digest(rig):
    map = rig.match(pair["left"], pair["right"]).disparity
    return hashlib.sha256(map.tobytes()).hexdigest()

rig = ps.Rig.load(path, threads=1)
before = threads()
others = [ps.Rig.load(path, threads=1), pickle.loads(pickle.dumps(rig)), copy.deepcopy(rig)]
assert threads() == before + len(others), "only the worker of each"
child = os.fork()
if child == 0:
    signal.alarm(300)
    loaded = ps.Rig.load(path, threads=1), pickle.loads(pickle.dumps(rig)), copy.deepcopy(rig)
    assert all(one.frames == 1 for one in loaded)
    print(digest(loaded[0]), flush=True)
    os._exit(0)
_, status = os.waitpid(child, 0)
assert os.waitstatus_to_exitcode(status) == 0, status
print(digest(others[0]))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="/proc lists the threads of a process")
def test_a_rig_of_raw_images_is_loaded_without_threads_also_in_a_forked_child(
    turned: Pair, tmp_path: Path
) -> None:
    rig = ps.Rig(threads=1)
    rig.match(turned.left, turned.right)
    rig.save(tmp_path / "rig.txt")
    np.savez(tmp_path / "pair.npz", left=turned.left, right=turned.right)

    command = [sys.executable, "-c", LOADING, str(tmp_path / "rig.txt"), str(tmp_path / "pair.npz")]
    run = subprocess.run(command, capture_output=True, check=False, text=True)  # noqa: S603
    assert run.returncode == 0, run.stderr
    child, parent = run.stdout.split()
    again = rig.match(turned.left, turned.right).disparity.tobytes()
    assert child == parent == hashlib.sha256(again).hexdigest()


def test_a_setting_turns_it_off(turned: Pair) -> None:
    with pytest.warns(ps.MatchWarning):
        result = ps.match(turned.left, turned.right, self_rectify=False)

    assert result.rectified is None
    assert bad(turned, result) > 50


def test_a_budget_leaves_out_what_it_has_no_time_for_and_the_match_says_so(turned: Pair) -> None:
    images = turned.left, turned.right
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ps.MatchWarning)
        whole, ample, none = (ps.match(*images, budget=budget) for budget in (None, 3600, 0))

    assert whole.rectified is not None
    np.testing.assert_array_equal(ample.disparity, whole.disparity)
    assert ample.findings == whole.findings

    assert none.rectified is None
    assert not np.any(none.flags & (ps.Flag.COARSE | ps.Flag.INFERRED))
    said = {one.sentence for one in none.findings}
    assert said >= {
        "rows may be off: the budget left no time to find out how the cameras look",
        "the budget left no time for smaller copies and planes",
    }


def test_a_pair_whose_rows_correspond_is_matched_as_it_is(cones: Pair) -> None:
    result = ps.match(cones.left, cones.right)
    plain = ps.match(cones.left, cones.right, self_rectify=False)

    assert result.rectified is None
    np.testing.assert_array_equal(result.disparity, plain.disparity)
    assert result.findings == plain.findings


@pytest.mark.parametrize(
    ("suite", "blur", "name", "most"),
    [("one-sided-blur", "gauss 4", "Piano", 45), ("rigs", "annulus 6 4.5", "venus", 6)],
    ids=["Gaussian", "annulus"],
)
def test_blur_is_not_taken_for_cameras(
    suite: str, blur: str, name: str, most: float, data: Path
) -> None:
    scene = find_scene(data / "middlebury", name)
    pair = Case(scene, suite, blur, usual_side(suite)).pair(true_blur=False)
    with warnings.catch_warnings(action="ignore"):
        result = ps.match(pair.left, pair.right, threads=1)

    # Rectified by what they seem to show, 80 and 51 % were wrong, with a confidence of .8.
    assert result.rectified is None
    assert bad(pair, result) < most


def test_images_of_different_things_are_not_rectified_and_it_is_said_why(
    cones: Pair, data: Path
) -> None:
    other = find_scene(data / "middlebury", "tsukuba").load().right
    rows, cols = other.shape[0], other.shape[1]

    with pytest.warns(ps.MatchWarning):
        result = ps.match(cones.left[:rows, :cols], other)

    assert result.rectified is None
    assert "do not show how to rectify them: only" in sentences(result)


def test_a_vertical_pair_is_matched_along_its_columns(data: Path) -> None:
    for name in ("cones", "Art"):
        scene = find_scene(data / "middlebury", name).load()
        beside = ps.match(scene.left, scene.right, right_map=True)
        above, below = np.rot90(scene.left, -1), np.rot90(scene.right, -1)

        found = ps.match(above, below, right_map=True)
        assert found.vertical
        assert not beside.vertical
        assert "one camera is above the other: by their distance" in sentences(found)
        for one, other in ((found, beside), (found.right, beside.right)):
            assert one is not None
            assert other is not None
            for label, values in other.maps.items():
                np.testing.assert_array_equal(one.maps[label], np.rot90(values, -1), label)

        checked = ps.check(above, below)
        assert any("columns are matched" in one.sentence for one in checked.findings)
        assert all(one.severity != "warning" for one in checked.findings), name

        # What is stated is obeyed, and reported.
        with pytest.warns(ps.MatchWarning, match="cameras that are not beside each other"):
            result = ps.match(above, below, vertical=False)
        assert not result.vertical
        assert "one camera seems to be above the other" in sentences(result)
        assert result.trusted.mean() < 0.5 * found.trusted.mean(), name

        with pytest.raises(ValueError, match=r"move along lines at (89|90|-89) degrees"):
            ps.rectify(above, below)


def test_a_rig_remembers_that_one_camera_is_above_the_other(cones: Pair, tmp_path: Path) -> None:
    above, below = np.rot90(cones.left, -1), np.rot90(cones.right, -1)
    rig = ps.Rig()
    first, second = rig.match(above, below), rig.match(above, below)
    assert first.vertical
    assert second.vertical
    assert any("one camera is above the other" in event.sentence for event in rig.events)
    upright = np.rot90(second.disparity)
    assert cones.truth is not None
    assert bad_pixels(upright, cones.truth, 1.0, mask=cones.masks["nonocc"]) < 15

    rig.save(tmp_path / "rig.txt")
    assert ps.Rig.load(tmp_path / "rig.txt").match(above, below).vertical

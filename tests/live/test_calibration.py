"""Cameras by pictures of a board: found as exactly as is said, and what is wrong is named."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
import phasestereo_live as live
from phasestereo.io.rigs.reading import read_cameras
from phasestereo_live.calibration.page import write_calibration_page
from phasestereo_live.calibration.solving import Fit, fit, rms, row_errors, vector
from support import Run, boards, counterpart
from support.boards import RIG, SIZE, SQUARE, cv2
from support.html_page import Page

for _module in ("yaml", "PIL", "cyclopts", "jinja2"):
    counterpart(_module)

WRONG, FAILED = 2, 1
Pairs = list[tuple[NDArray[np.uint8], NDArray[np.uint8]]]


@pytest.fixture(scope="module")
def pairs() -> Pairs:
    return boards.pairs(boards.chessboard(9, 6), 12)


@pytest.fixture(scope="module")
def found(pairs: Pairs) -> live.StereoCalibration:
    return live.calibrate(pairs, square=SQUARE)


@pytest.fixture
def folder(tmp_path: Path, pairs: Pairs) -> Path:
    """Return a folder of the pairs, as ``3_L.png`` and ``3_R.png``."""
    made = tmp_path / "boards"
    made.mkdir()
    for number, pair in enumerate(pairs):
        for side, image in zip("LR", pair, strict=True):
            ps.io.write_image(made / f"{number}_{side}.png", image)
    return made


def deviation(found: live.StereoCalibration) -> NDArray[np.float64]:
    """Return by how many of their standard deviations the numbers differ from the true ones."""
    spread = np.sqrt(np.diag(found.covariance))
    free = spread > 0
    return (vector(found.matrices) - vector(RIG))[free] / spread[free]


def test_rendered_boards_give_the_cameras_they_were_seen_by(found: live.StereoCalibration) -> None:
    assert (found.size, found.unit) == (SIZE, "m")
    assert found.board == "chessboard of 9 x 6 inner corners"
    assert all(view.used for view in found.views)
    assert found.error < 0.06
    assert found.held_out is not None
    assert found.rows <= found.held_out < 0.06

    assert np.abs(deviation(found)).max() < 4
    assert found.deviations["fx1"] < 1
    assert found.baseline == pytest.approx(np.linalg.norm(RIG["T"]), abs=3e-4)
    assert found.angles["yaw"] == pytest.approx(-0.9, abs=0.03)

    # A board half a meter to a meter away, and tilted by 15 to 35 degrees.
    assert all(0.5 < view.distance < 1.1 for view in found.views)
    assert np.abs([view.tilt for view in found.views]).max() > 15


def test_a_charuco_board_need_not_be_seen_whole() -> None:
    pairs = boards.pairs(boards.charuco(6, 5, "DICT_4X4_50"), 12, boards.LARGE)
    found = live.calibrate(pairs, board="6x5", square=boards.LARGE, charuco="DICT_4X4_50")
    assert min(len(view.ids) for view in found.views) < 20  # of 5 x 4
    assert np.abs(deviation(found)).max() < 4

    mirrored = [(left, right[:, ::-1].copy()) for left, right in pairs]
    with pytest.raises(ValueError, match=r"of 0 of 12 pairs; .* right image 0 is mirrored"):
        live.calibrate(mirrored, board="6x5", charuco="DICT_4X4_50")


def test_standard_deviations_are_those_of_repeated_calibrations(
    found: live.StereoCalibration,
) -> None:
    """Of cameras, and of the depths that they give."""
    fits = [
        fit(boards.sights(12, np.random.default_rng(seed), noise=0.1), SIZE, 4)
        for seed in range(25)
    ]
    assert {len(each.errors) for each in fits} == {12}
    made = [
        replace(found, covariance=each.covariance, **cast("Any", each.matrices)) for each in fits
    ]
    assert 0.6 < np.mean([deviation(each) ** 2 for each in made]) < 1.6

    expected = np.median([each.depth_error([1, 10]).calibration for each in made], axis=0)
    apart = np.std([depths_of(each, (1.0, 10.0)) for each in made], axis=0)
    np.testing.assert_allclose(apart, expected, rtol=0.4)


def depths_of(found: live.StereoCalibration, depths: Sequence[float]) -> list[float]:
    """Return the depths by these cameras of points that the true ones have at these depths."""
    seen = []
    for depth in depths:
        point = np.array([[0.0, 0.0, depth]])
        turn = cv2.Rodrigues(RIG["R"])[0]
        left = cv2.projectPoints(point, np.zeros(3), np.zeros(3), RIG["K1"], RIG["D1"])[0]
        right = cv2.projectPoints(point, turn, RIG["T"], RIG["K2"], RIG["D2"])[0]
        ahead = np.hstack([np.eye(3), np.zeros((3, 1))]), np.hstack([found.R, found.T])
        rays = (
            cv2.undistortPoints(left, found.K1, found.D1)[0].T,
            cv2.undistortPoints(right, found.K2, found.D2)[0].T,
        )
        point = cv2.triangulatePoints(*ahead, *rays)[:, 0]
        seen.append(float(point[2] / point[3]))
    return seen


@pytest.mark.parametrize(
    ("bent", "asked", "count"),
    [((-0.1, 0.05), None, 4), ((-0.45, 0.35), None, 5), ((-0.1, 0.05), 8, 8)],
)
def test_lenses_have_as_many_coefficients_as_they_need(
    monkeypatch: pytest.MonkeyPatch, bent: tuple[float, ...], asked: Any, count: int
) -> None:
    lens = np.zeros((1, 8))
    lens[0, :2] = bent
    lens[0, 5] = 0.6 * (count == 5)
    for name in ("D1", "D2"):
        monkeypatch.setitem(RIG, name, lens)
    found = fit(boards.sights(16, np.random.default_rng(0), noise=0.02), SIZE, asked)
    assert found.lens == count
    assert found.matrices["D1"].shape == (1, max(count, 5))
    assert found.errors.max() < 0.04
    assert np.isfinite(found.covariance).all()


def test_fisheyes_are_fitted_where_other_lenses_leave_rows() -> None:
    sights = boards.wide_sights(24, np.random.default_rng(3), noise=0.1)
    bent = fit(sights, SIZE, 8)
    assert rms(bent.rows) > 3 * rms(bent.errors)

    found = fit(sights, SIZE)
    assert found.lens == "fisheye"
    assert rms(found.errors) < 0.15
    assert rms(found.rows) < 0.15
    spread = np.sqrt(np.diag(found.covariance))
    off = (vector(found.matrices) - vector(boards.FISHEYES)) / spread
    assert np.abs(off).max() < 4
    assert spread[0] < 0.2


def test_a_calibration_of_fisheyes_is_one_that_rectify_reads(
    tmp_path: Path, found: live.StereoCalibration
) -> None:
    sights = boards.wide_sights(24, np.random.default_rng(3), noise=0.1)
    wide = fit(sights, SIZE, "fisheye")
    made = replace(found, **cast("Any", wide.matrices), covariance=wide.covariance, fisheye=True)
    errors = made.depth_error([0.5, 1.0])
    assert (errors.calibration > 0).all()
    assert (errors.calibration < 0.02 * errors.distance).all()

    made.save(tmp_path / "wide.yaml")
    given = [made.matrices[name] for name in ("K1", "D1", "K2", "D2")]
    r1, r2, p1, p2, *_ = cv2.fisheye.stereoRectify(
        *given, SIZE, made.R, made.T, flags=cv2.CALIB_ZERO_DISPARITY
    )
    for source in (tmp_path / "wide.yaml", made.matrices):
        read = read_cameras(source)
        assert read.fisheye
        for maps, k, d, r, p in zip(
            read.warp(SIZE, None).maps, given[::2], given[1::2], (r1, r2), (p1, p2), strict=True
        ):
            wanted = cv2.fisheye.initUndistortRectifyMap(k, d, r, p, SIZE, cv2.CV_32FC1)
            np.testing.assert_array_equal(np.array(maps), np.array(wanted))


def test_rigs_whose_rows_are_far_worse_than_their_corners_are_refused(
    pairs: Pairs, monkeypatch: pytest.MonkeyPatch
) -> None:
    def bad(*given: Any) -> Fit:
        made = fit(*given)
        return replace(made, rows=made.rows + 2.06)

    monkeypatch.setattr("phasestereo_live.calibration.calibrating.fit", bad)
    with pytest.raises(ValueError, match=r"rows of the rectified pair would be off by 2\.\d+ px"):
        live.calibrate(pairs, square=SQUARE)


def test_errors_of_depths_have_their_parts(found: live.StereoCalibration) -> None:
    errors = found.depth_error([1.0, 2.0], 0.5)
    np.testing.assert_allclose(
        errors.disparity, [0.5 / (found.K1[0, 0] * found.baseline) * z**2 for z in (1, 2)]
    )
    np.testing.assert_allclose(errors.total**2, errors.disparity**2 + errors.calibration**2)
    for part in (errors.focal, errors.baseline, errors.yaw):
        assert (part > 0).all()

    with pytest.raises(ValueError, match=r"^distances: got \[0\]"):
        found.depth_error([0])
    with pytest.raises(ValueError, match="^disparity_error: "):
        found.depth_error([1], -1)


def test_one_pair_that_is_none_is_left_out_and_named(pairs: Pairs) -> None:
    mixed = [(left, pairs[4][1] if at == 3 else right) for at, (left, right) in enumerate(pairs)]
    found = live.calibrate(mixed, square=SQUARE)
    assert [view.used for view in found.views] == [at != 3 for at in range(12)]
    assert found.views[3].reason.startswith("left image 3 and right image 3 are off by ")
    assert np.abs(deviation(found)).max() < 4


WRONGS: dict[str, tuple[Callable[[Pairs], Any], str]] = {
    "swapped": (
        lambda pairs: [(right, left) for left, right in pairs],
        "left image 0 and right image 0, .* the left camera is on the right of the other one",
    ),
    "mirrored": (
        lambda pairs: [(left, right[:, ::-1].copy()) for left, right in pairs],
        "one camera's pictures are mirrored",
    ),
    "turned": (
        lambda pairs: [(left, right[::-1, ::-1].copy()) for left, right in pairs],
        "one camera's pictures are upside down",
    ),
    "above": (
        lambda pairs: [(left.T.copy(), right.T.copy()) for left, right in pairs],
        "one camera is above the other; accepts cameras side by side",
    ),
    "same": (
        lambda pairs: [(left, np.clip(left, 3, 250)) for left, _ in pairs],
        "left image 0 and right image 0: both views are the same camera's",
    ),
    "moments": (
        lambda pairs: [(pairs[at][0], pairs[at - 1][1]) for at in range(6)],
        "no two cameras see this, corners are off by .* px: pairs are not of the same moment",
    ),
    "few": (
        lambda pairs: [*pairs[:5], (pairs[5][0], 0 * pairs[5][1])],
        "in both views of 5 of 6 pairs; accepts 6 or more: no board is found in right image 5",
    ),
    "sizes": (
        lambda pairs: [*pairs[:5], (pairs[5][0], pairs[5][1][:-2])],
        "right image 5: got 640 x 478 pixels; accepts 640 x 480",
    ),
    "no pairs": (lambda _: [], "of 0 of 0 pairs; accepts 6 or more"),
    "other board": (
        lambda pairs: [(np.zeros_like(left), np.zeros_like(right)) for left, right in pairs],
        "of 0 of 6 pairs; accepts 6 or more; without a given board its size is found: no board",
    ),
}


@pytest.mark.parametrize("case", WRONGS)
def test_what_is_wrong_with_the_pictures_is_said(pairs: Pairs, case: str) -> None:
    spoil, message = WRONGS[case]
    with pytest.raises(ValueError, match=message):
        live.calibrate(spoil(pairs[:6]), board="9x6", square=SQUARE)


def test_pairs_without_a_board_are_refused_whatever_resembles_one(
    pairs: Pairs, monkeypatch: pytest.MonkeyPatch
) -> None:
    def finds(_image: object, _size: object, flags: int) -> tuple[bool, Any, Any]:
        """Find 3 x 3 corners in the search that is thorough, as in photographs of anything."""
        grid = np.stack(np.meshgrid(np.arange(3.0), np.arange(3.0)), axis=2).reshape(-1, 1, 2)
        return bool(flags & cv2.CALIB_CB_EXHAUSTIVE), grid, np.zeros((3, 3), np.uint8)

    monkeypatch.setattr(cv2, "findChessboardCornersSBWithMeta", finds)
    message = (
        "^left: the chessboard is found in both views of 0 of 6 pairs; accepts 6 or more; give"
    )
    with pytest.raises(ValueError, match=message):
        live.calibrate(pairs[:6])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"board": "9"}, "board: got '9'; accepts corners as '9x6'"),
        ({"board": (2, 6)}, "board: got 2; accepts 3 to 64"),
        ({"square": 0}, "square: got 0"),
        ({"marker": 0.01}, "marker: has no effect without charuco"),
        ({"charuco": "DICT"}, "charuco: got 'DICT'; accepts DICT_"),
        ({"charuco": "DICT_4X4_50"}, "board: got None; accepts the squares of a ChArUco board"),
        (
            {"board": "6x5", "charuco": "DICT_4X4_50", "square": 1, "marker": 1},
            "marker: got 1; accepts less than the square's 1",
        ),
    ],
)
def test_boards_that_are_none_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match="^" + message):
        live.calibrate([], **arguments)
    with pytest.raises(TypeError, match="^left: accepts a folder, a video, or a list of pairs"):
        live.calibrate([np.zeros((4, 4))])  # type: ignore[list-item]


def test_the_advice_names_what_was_not_seen(found: live.StereoCalibration) -> None:
    """Of a few views in which the board is hardly tilted."""
    flat = boards.pairs(boards.chessboard(9, 6), 6, tilted=0.1)
    said = " ".join(live.calibrate(flat).advice)
    for words in (
        "take more pairs: 6 were used",
        "in the lower right corner of the left image",
        "tilt the board by about 30 degrees, its left edge nearer",
        "the focal length is known to",
        "give the side of a square",
    ):
        assert words in said

    said = " ".join(found.advice)
    assert "take some views from nearer and some from farther away (so far from 0.6" in said
    # The left camera alone sees what is on the left of its image, the right one the other edge.
    absent = "left edge of the left", "right edge of the right", "tilt", "focal length", "give"
    assert [words for words in absent if words in said] == []


def test_a_calibration_on_the_command_line_is_one_that_everything_reads(
    run: Callable[..., Run], folder: Path, tmp_path: Path
) -> None:
    target, page = tmp_path / "rig.yaml", tmp_path / "page.html"
    ps.io.write_image(folder / "3_R.png", np.zeros((480, 640), np.uint8))
    code, out, err = run(
        "calibrate", folder, "--square", "30mm", "-o", target, "--page", page, "--json"
    )
    assert (code, err) == (0, "")
    said = json.loads(out)
    assert said["files"] == [str(target), str(page)]
    assert [view["used"] for view in said["views"]].count(False) == 1
    assert f"no board is found in {folder / '3_R.png'}" in {v["reason"] for v in said["views"]}
    assert said["depth_error"]["distance"] == [1, 3, 10]

    storage = cv2.FileStorage(str(target), cv2.FILE_STORAGE_READ)
    matrices = {name: storage.getNode(name).mat() for name in ("K1", "D1", "K2", "D2", "R", "T")}
    np.testing.assert_array_equal(matrices["K1"], said["K1"])
    exact = boards.sights(12, np.random.default_rng(0), noise=0)
    assert row_errors(matrices, exact, SIZE, 8).max() < 0.1

    rectified = ps.rectify(folder / "0_L.png", folder / "0_R.png", target)
    assert rectified.Q is not None
    assert 1 / rectified.Q[3, 2] == pytest.approx(said["baseline"])
    assert rectified.unit == "m"
    with pytest.raises(ValueError, match="got that of 640 x 480 pixels; accepts"):
        ps.rectify(np.zeros((64, 64), np.uint8), np.zeros((64, 64), np.uint8), target)

    code, out, err = run("calibrate", folder, "--square", "30mm")
    assert (code, err) == (0, "")
    assert out.startswith("11 of 12 pairs used, chessboard of 9 x 6 inner corners\nleft out: no ")
    assert "\ndepth error at 10 m: " in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("boards --square 25", "25; accepts a length with its unit"),
        ("boards --board 9", "error: --board: got '9'"),
        ("boards -o rig.txt", "--output: got rig.txt; accepts .yaml, .yml, .xml"),
        ("boards --page boards", "--page: boards is an input or another"),
        ("boards/0_L.png", "boards/0_L.png: is neither a folder nor a video"),
        ("nowhere", "nowhere: No such file or directory"),
    ],
)
def test_wrong_words_are_refused_in_a_line(
    run: Callable[..., Run], folder: Path, monkeypatch: pytest.MonkeyPatch,
    words: str, message: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(folder.parent)
    ended, out, err = run("calibrate", *words.split())
    assert (ended, out) == (WRONG if words.startswith("boards ") else FAILED, "")
    assert message in err


def test_a_video_is_calibrated_by_frames_in_which_the_board_stands_still(
    tmp_path: Path, pairs: Pairs
) -> None:
    frames = [np.hstack(pairs[at // 6]) for at in range(6 * 7)]
    left = [np.hsplit(frame, 2)[0] for frame in frames[:24]]
    written = write_video(tmp_path / "both.avi", frames), write_video(tmp_path / "left.avi", left)

    found = live.calibrate(written[0], square=SQUARE)
    assert 6 <= len(found.views) <= 7
    assert found.views[0].names[0] == f"{written[0]}, frame 0 (left)"
    assert np.abs(deviation(found)).max() < 5  # compressed

    with pytest.raises(ValueError, match=r"left\.avi: is of one camera"):
        live.calibrate(written[1], square=SQUARE)
    moving = [np.roll(frame, 4 * at, axis=0) for at, frame in enumerate(frames[:24])]
    with pytest.raises(ValueError, match=r"moving\.avi: no frame shows the board, held still"):
        live.calibrate(write_video(tmp_path / "moving.avi", moving))


def write_video(path: Path, frames: Sequence[NDArray[np.uint8]]) -> Path:
    size = frames[0].shape[::-1]
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 12, size, False)  # noqa: FBT003
    for frame in frames:
        video.write(frame)
    video.release()
    return path


def test_the_page_has_all_of_it_and_needs_nothing(
    tmp_path: Path, found: live.StereoCalibration
) -> None:
    out = replace(found.views[2], used=False, reason="<b>off</b>")
    views = (*found.views[:2], out, *found.views[3:])
    said = replace(found, advice=("take <more> views",), views=views)
    write_calibration_page(tmp_path / "page.html", said, title="<Rig>")

    text = (tmp_path / "page.html").read_text("utf-8")
    page = Page(tmp_path / "page.html")
    assert page.sources == []
    assert page.open == []
    for words in ("<Rig>", "11 of 12 pairs", "Take <more> views.", "left out: <b>off</b>", "10 m"):
        assert words in page.text
    assert text.count('<circle class="corner"') == 2 * 11 * 54
    assert text.count("<polyline") == 3

    with pytest.raises(ValueError, match=r"must end in \.html or \.htm, got '\.txt'"):
        write_calibration_page(tmp_path / "page.txt", found)


def test_a_real_rig_has_rows_of_views_that_took_no_part(data: Path) -> None:
    """Its own calibration leaves 0.17 px of the same corners, of which it was made."""
    if not (data / "homemade" / "boards").is_dir():
        pytest.skip("no boards of a real rig")
    found = live.calibrate(data / "homemade" / "boards", square=0.06)
    own = json.loads((data / "homemade" / "rig.json").read_text("utf-8"))
    assert found.held_out is not None
    assert found.held_out < 0.2
    assert found.K1[0, 0] == pytest.approx(own["intrinsic1"][0][0], rel=0.01)
    assert found.T.ravel() == pytest.approx(np.array(own["T"]).ravel() / 1000, abs=1.5e-3)
    assert pytest.approx(np.array(own["R"]), abs=2e-3) == found.R

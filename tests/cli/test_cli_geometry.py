"""Points and depths through the command line: from every form of geometry, or a clear refusal."""

import json
import os
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo import io
from phasestereo.result import MAPS
from support import Run, counterpart

cli = pytest.importorskip("phasestereo.cli")

WRONG, FAILED = 2, 1
SHIFT, COUNT = 5, 16
CALIB = """\
cam0=[100 0 32; 0 100 20; 0 0 1]
cam1=[100 0 34; 0 100 20; 0 0 1]
doffs=2
baseline=70
width=65
height=40
"""
RIG = "--focal 100 --baseline 70"
# One geometry in each of its forms -> millimetres per unit of its baseline
GEOMETRIES = {
    "--calib calib.txt": 1,
    "--calib meters.txt --unit m": 1000,
    "--calib q.npy --unit cm": 10,
    "--focal 100 --baseline 0.07 --doffs 2 --cx 32 --cy 20 --unit m": 1000,
}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder: a pair, everywhere at disparity SHIFT, and what calibrates it."""
    monkeypatch.chdir(tmp_path)

    scene = np.random.default_rng(0).integers(0, 256, (40, 70, 3), dtype=np.uint8)
    io.write_image("left.png", scene[:, :-SHIFT])
    io.write_image("right.png", scene[:, SHIFT:])

    Path("calib.txt").write_text(CALIB, encoding="utf-8")
    Path("K.txt").write_text("100 0 32 0 100 20 0 0 1\n0.07\n", encoding="utf-8")
    Path("meters.txt").write_text(CALIB.replace("=70", "=0.07"), encoding="utf-8")

    rig = io.read_calibration("calib.txt")
    np.save("q.npy", replace(rig, baseline=7).q)
    return tmp_path


@pytest.fixture
def match(run: Callable[..., Run]) -> Callable[[str], Run]:
    """Return a function that matches the pair here: exit code, standard output, error."""
    arguments = "match", "left.png", "right.png", "--num-disparities", COUNT
    return lambda options: run(*arguments, *options.split())


@pytest.mark.parametrize(("geometry", "scale"), GEOMETRIES.items())
def test_points_come_out_in_color(match: Callable[[str], Run], geometry: str, scale: int) -> None:
    trimesh = counterpart("trimesh")

    code, out, err = match(f"--ply out.ply -o out.npy {geometry}")
    assert (code, err) == (0, "")
    assert "wrote out.ply" in out

    disparity = io.read_disparity("out.npy")
    calibration = io.read_calibration("calib.txt")
    expected = ps.point_cloud(disparity, calibration, image=io.read_image("left.png"))

    read = trimesh.load("out.ply")
    assert len(read.vertices) == disparity.size
    np.testing.assert_allclose(read.vertices * scale, expected.points, rtol=1e-6, atol=1e-4)
    np.testing.assert_array_equal(np.asarray(read.colors)[:, :3], expected.colors)

    depth = 70 * 100 / (SHIFT + 2)
    assert np.median(read.vertices[:, 2]) * scale == pytest.approx(depth, rel=0.01)


@pytest.mark.parametrize(("geometry", "scale"), GEOMETRIES.items())
def test_depths_come_out_as_millimetres_and_as_floats(
    match: Callable[[str], Run], geometry: str, scale: int
) -> None:
    for name in ("out.png", "out.tif"):
        assert match(f"--depth {name} -o out.npy {geometry}")[0] == 0
    expected = io.read_calibration("calib.txt").depth(io.read_disparity("out.npy"))
    np.testing.assert_allclose(io.read_depth("out.tif") * scale, expected, rtol=1e-6)
    assert io.read_image("out.png").dtype == np.uint16
    np.testing.assert_allclose(io.read_depth("out.png"), expected, rtol=0, atol=0.501)


def test_maps_and_error_bars_come_out(match: Callable[[str], Run]) -> None:
    files = "-o all.npz --depth depth.npz --uncertainty-output bar.pfm --confidence-output c.tif"
    code, out, err = match(f"{files} --flags-output f.png --calib calib.txt --yaw 0.5 --keep all")
    assert (code, err) == (0, "")
    assert "a yaw of up to 0.5 degrees is allowed for, 0.87 px" in out

    maps = np.load("all.npz")
    assert list(maps) == list(MAPS)
    for name, path in (("uncertainty", "bar.pfm"), ("confidence", "c.tif"), ("flags", "f.png")):
        stored = io.read_image(path)
        known = np.isfinite(maps[name])
        np.testing.assert_array_equal(stored[known], maps[name][known], strict=True)

    depths = np.load("depth.npz")
    wanted = ps.depth_interval(
        maps["disparity"],
        io.read_calibration("calib.txt"),
        uncertainty=maps["uncertainty"],
        yaw=0.5,
        finite=True,
    )
    for name, values in wanted._asdict().items():
        np.testing.assert_array_equal(depths[name], values)


def test_what_is_kept_is_the_same_in_every_file(match: Callable[[str], Run]) -> None:
    trimesh = counterpart("trimesh")
    files = "-o all.npz --ply out.ply --depth depth.npz --calib calib.txt"
    for keep in ("trusted", "checked", "all"):
        code, out, err = match(f"{files} --keep {keep} --decimate 2")
        assert (code, err) == (0, "")
        assert f"of the pixels ({keep}" in out
        depth = np.load("depth.npz")["depth"]
        assert depth.shape == (20, 32)
        assert len(trimesh.load("out.ply").vertices) == np.isfinite(depth).sum()
    maps = np.load("all.npz")
    wanted = ps.depth_interval(
        maps["disparity"],
        io.read_calibration("calib.txt"),
        uncertainty=maps["uncertainty"],
        decimate=2,
    )
    np.testing.assert_array_equal(depth, wanted.depth)
    summary = json.loads(match(f"{files} --min-depth 900 --max-depth 1100 --json")[1])
    assert summary["geometry"]["kept"]["keep"] == "trusted"
    known = np.load("depth.npz")["depth"]
    assert known.shape == (40, 65)
    assert np.nanmin(known) >= 900
    assert np.nanmax(known) <= 1100

    far = f"{files} --min-depth {np.nanmedian(known)}"
    kept = json.loads(match(f"{far} --json")[1])["geometry"]["kept"]
    share = np.isfinite(np.load("depth.npz")["depth"]).mean()
    assert 0.3 < share < 0.7
    assert kept["share"] == pytest.approx(share)
    assert f"depths and points: {share:.1%} of the pixels (trusted" in match(far)[1]

    code, _, err = match(f"{files} --min-depth 9 --max-depth 5")
    assert (code, err) == (
        WRONG,
        "phasestereo: error: --min-depth: got 9; accepts at most --max-depth, which is 5\n",
    )
    assert (
        match(f"{files} --decimate 41")[2]
        == "phasestereo: error: --decimate: got 41; accepts 1 to 40\n"
    )


def test_depths_are_written_for_a_third_camera(match: Callable[[str], Run]) -> None:
    third: dict[str, Any] = {
        "K1": np.array([[100.0, 0, 32], [0, 100, 20], [0, 0, 1]]), "D1": np.zeros(5),
        "K2": np.array([[150.0, 0, 50], [0, 150, 30], [0, 0, 1]]), "D2": np.zeros(5),
        "R": np.eye(3), "T": np.array([15.0, 2, 0]),
    }  # fmt: skip
    np.savez("third.npz", **third)
    options = "--calib calib.txt --register third.npz --register-size 100,60"
    code, out, err = match(f"-o all.npz --depth depth.npz {options}")
    assert (code, err) == (0, "")
    assert "wrote depth.npz" in out
    maps, depths = np.load("all.npz"), np.load("depth.npz")
    result = ps.Result(
        maps["disparity"], maps["flags"], maps["confidence"], ps.Settings(), {},
        uncertainty=maps["uncertainty"],
    )  # fmt: skip
    camera = ps.ThirdCamera.of_pair(third, size=(100, 60))
    wanted = ps.register(result, io.read_calibration("calib.txt"), camera).maps
    assert {*depths} == {*wanted}
    for name, values in wanted.items():
        np.testing.assert_array_equal(depths[name], values)
    assert depths["depth"].shape == (60, 100)
    assert np.nanmedian(depths["depth"]) == pytest.approx(1000, rel=0.01)

    assert match(f"--depth depth.png {options}")[0] == 0
    assert io.read_image("depth.png").shape == (60, 100)
    for wrong, message in (
        ("--register-size 100,60", "--register-size: has no effect without --register"),
        ("--register third.npz", "error: --register-size: got None, and a calibration without one"),
        ("--register calib.txt", "error: --register: accepts K1, D1, K2, D2, R, T"),
        ("--register left.png", "--register: "),
    ):
        code, _, err = match(f"--depth depth.png --calib calib.txt {wrong}")
        assert code == WRONG
        assert message in err
    assert "has no effect without a geometry" in match("--report a.html --register third.npz")[2]


def test_depths_that_a_png_does_not_hold_are_said(match: Callable[[str], Run]) -> None:
    assert match("--depth out.tif --calib calib.txt --keep all")[0] == 0
    depth = io.read_depth("out.tif") / 1000  # m
    end = (float(np.nanmin(depth)) + float(np.nanmax(depth))) / 2
    options = f"--depth out.png --calib calib.txt --keep all --depth-scale {65535.5 / end!r}"
    code, _, err = match(options)
    assert code == 0
    lost = io.read_image("out.png") == 0
    np.testing.assert_array_equal(lost, ~(depth < end))
    share = (depth >= end).mean()
    assert 0 < share < 1
    assert f"note: {share:.1%} of the pixels are beyond {end:.1f} m, where a .png has 0" in err


def test_an_anchor_sets_its_depth_right_in_every_file(match: Callable[[str], Run]) -> None:
    trimesh = counterpart("trimesh")
    options = "--depth out.tif --ply out.ply --calib calib.txt --anchor 40,20,1750 --json"
    code, out, _ = match(options)
    assert code == 0
    assert io.read_depth("out.tif")[20, 40] == pytest.approx(1750, rel=1e-6)
    depths = trimesh.load("out.ply").vertices[:, 2]
    assert np.median(depths) == pytest.approx(1750, rel=0.01)
    # What is SHIFT, and 2 px of doffs, is to be 100 * 70 / 1750 = 4 px.
    assert json.loads(out)["geometry"]["moved"] == pytest.approx(4 - SHIFT - 2, abs=0.1)


def test_what_has_no_depth_or_is_too_far_is_left_out(match: Callable[[str], Run]) -> None:
    trimesh = counterpart("trimesh")

    valid = np.ones((40, 65), np.uint8)
    valid[:10] = 0
    io.write_image("mask.png", valid)

    options = "--left-mask mask.png --ply out.ply --depth out.tif --calib calib.txt"
    assert match(options)[0] == 0

    depth = io.read_depth("out.tif")
    assert np.isnan(depth[:10]).all()
    assert len(trimesh.load("out.ply").vertices) == np.isfinite(depth).sum() > 0

    limit = float(np.nanmedian(depth))
    assert match(f"{options} --max-depth {limit!r}")[0] == 0

    expected = np.where(depth <= limit, depth, np.nan)
    assert 0 < np.isfinite(expected).sum() < np.isfinite(depth).sum()
    np.testing.assert_array_equal(io.read_depth("out.tif"), expected)
    assert len(trimesh.load("out.ply").vertices) == np.isfinite(expected).sum()


@pytest.mark.parametrize(
    ("geometry", "is_doubtful"),
    [
        ("--calib calib.txt --unit m", True),
        ("--calib calib.txt --unit mm", False),
        ("--calib calib.txt", False),
        ("--focal 100 --baseline 0.07 --unit mm", True),
        ("--focal 100 --baseline 0.07 --unit m", False),
    ],
)
def test_a_baseline_in_an_unlikely_unit_is_doubted(
    match: Callable[[str], Run], geometry: str, *, is_doubtful: bool
) -> None:
    code, out, _ = match(f"--depth out.tif {geometry}")
    assert code == 0
    assert ("is the unit right?" in out) == is_doubtful


def test_a_calibration_says_its_unit_and_what_was_assumed(match: Callable[[str], Run]) -> None:
    code, out, err = match("--depth z.png --calib K.txt")
    assert (code, err) == (0, "")
    assert "baseline 0.07, and depths, in m; focal length 100 px" in out
    expected = 1000 * 0.07 * 100 / SHIFT
    assert np.nanmedian(io.read_depth("z.png")) == pytest.approx(expected, rel=0.01)

    Path("double.txt").write_text(CALIB.replace("=65", "=130").replace("=40", "=80"), "utf-8")
    code, out, err = match("--depth z.npy --calib double.txt --json")
    assert code == 0
    assert "note: the calibration of 130 x 80 pixels is scaled to 65 x 40" in err
    geometry = json.loads(out)["geometry"]
    assert (geometry["focal"], geometry["baseline"], geometry["unit"]) == (50, 70, "mm")


REFUSALS = [
    (
        "--ply a.ply",
        WRONG,
        "--ply: needs a geometry: give --calib, --rectify FILE, or --focal",
    ),
    ("--depth a.tif", WRONG, "--depth: needs a geometry"),
    ("--report a.html --yaw 0.1", WRONG, "--yaw: has no effect without a geometry"),
    (f"--depth a.tif {RIG} --yaw 11", WRONG, "yaw"),
    ("--depth a.tif --focal inf --baseline 1", WRONG, "--focal: got inf; accepts a positive, fin"),
    ("--depth a.tif --focal 9 --baseline inf", WRONG, "--baseline: got inf; accepts"),
    (f"--depth a.tif {RIG} --anchor 4,5", WRONG, "anchor"),
    (f"--depth a.tif {RIG} --anchor 65,5,9", WRONG, "--anchor: got 65; accepts 0 to 64"),
    ("-o a.npy --anchor 4,5,9", WRONG, "--anchor: has no effect without --ply, --mesh"),
    (
        "--confidence-output a.tif --preset fast",
        WRONG,
        "--confidence-output: got a file, and settings that work none out",
    ),
    (f"--mesh a.obj {RIG}", WRONG, "--mesh: path of a surface must end in .glb"),
    ("--mesh a.glb", WRONG, "--mesh: needs a geometry: give --calib, --rectify FILE"),
    ("--ply a.ply --calib calib.txt --focal 9", WRONG, "--focal: got --calib, too; accepts one"),
    (f"--ply a.ply --calib q.npy {RIG}", WRONG, "--focal: got --calib, too; accepts one geometry"),
    ("--ply a.ply --focal 100", WRONG, "--focal: needs --baseline"),
    ("--ply a.ply --baseline 70", WRONG, "--baseline: has no effect without --focal"),
    ("--ply a.ply --calib calib.txt --cx 3", WRONG, "--cx: has no effect without --focal"),
    ("--json --calib calib.txt", WRONG, "--calib: has no effect without --ply"),
    ("--json --max-depth 5", WRONG, "--max-depth: has no effect without --ply"),
    ("--ply a.ply --focal 0 --baseline 70", WRONG, "--focal"),
    ("--ply a.ply --focal 100 --baseline -7", WRONG, "--baseline"),
    (f"--ply a.ply {RIG} --doffs nan", WRONG, "--doffs: got nan; accepts a finite number"),
    (f"--ply a.ply {RIG} --doffs -99", FAILED, "no disparity up to 15 has a depth .* -99"),
    (f"--ply a.ply {RIG} --max-depth 1", WRONG, "--max-depth: got 1; .* nothing is nearer than"),
    (f"--ply a.ply {RIG} --unit inch", WRONG, "--unit"),
    ("--depth a.png --calib K.txt --unit mm", WRONG, "--unit: got mm; accepts m, which the"),
    ("--depth a.png --calib K.txt --calib K.txt --calib K.txt", WRONG, "--calib: got 3 files"),
    ("--depth a.png --calib q.npy", WRONG, "--depth: a .png is in units of a meter: give --unit"),
    (f"--depth a.png {RIG} --unit m", WRONG, "--depth: .*is the unit right"),
    (f"--depth a.jpg {RIG}", WRONG, "--depth: path of a depth map must end in"),
    (f"--ply a.obj {RIG}", WRONG, "--ply: path of a point cloud must end in .ply"),
    (f"--depth a.tif -o ./a.tif {RIG}", WRONG, "--depth: a.tif is an input or another"),
    ("--depth calib.tif --calib calib.tif", WRONG, "--depth: calib.tif is an input or another"),
    (f"--ply sub.ply {RIG}", FAILED, "--ply: sub.ply is a folder"),
    (f"--ply left.png/a.ply {RIG}", FAILED, "left.png: File exists"),
    ("--ply a.ply --calib none.txt", FAILED, "none.txt: No such file"),
    (
        "--ply a.ply --calib other.txt",
        FAILED,
        "other.txt: .*that of 80 x 40 pixels.*proportions of 65 x 40",
    ),
    ("--ply a.ply --calib left.png", WRONG, "--calib: got left.png, which is a picture"),
    ("--ply a.ply --calib three.npy", FAILED, "three.npy: q must be 4 x 4"),
    ("--ply a.ply --calib turned.npy", FAILED, "turned.npy: .*Y down"),
]


@pytest.mark.parametrize("geometry", ["--calib q.npy --unit cm", f"{RIG} --doffs 2 --unit mm"])
def test_a_range_is_found_beside_a_geometry(run: Callable[..., Run], geometry: str) -> None:
    scene = np.random.default_rng(1).integers(0, 256, (120, 170), dtype=np.uint8)
    io.write_image("left.png", scene[:, :-SHIFT])
    io.write_image("right.png", scene[:, SHIFT:])

    files = "--depth out.png --ply out.ply -o out.npy --json"
    code, out, err = run("match", "left.png", "right.png", *f"{files} {geometry}".split())
    assert code == 0, err
    assert json.loads(out)["search"]["origin"] == "found"
    assert np.nanmedian(io.read_depth("out.png")) == pytest.approx(100 * 70 / (SHIFT + 2), rel=0.01)

    # What is found may have no depth: nothing is nearer than the point that cameras look at.
    code, _, err = run(
        "match", "left.png", "right.png", *f"{files} {RIG} --unit mm --doffs -50".split()
    )
    assert (code, "no disparity up to" in err) == (FAILED, True)


def test_surface_is_written(match: Callable[[str], Run]) -> None:
    trimesh = counterpart("trimesh")

    code, out, err = match(f"--mesh out.glb -o out.npy {RIG} --keep all")
    assert (code, err) == (0, "")
    assert "wrote out.glb" in out

    (surface,) = trimesh.load("out.glb").geometry.values()
    image = io.read_image("left.png")
    assert surface.visual.material.baseColorTexture.size == image.shape[1::-1]

    expected = ps.surface_mesh(
        np.load("out.npy"), io.Calibration.from_focal(100, 70, width=65, height=40)
    )
    assert len(surface.faces) == len(expected.faces) > 1000


@pytest.mark.parametrize(("options", "code", "message"), REFUSALS)
def test_refusals_come_before_the_match_and_leave_nothing(
    match: Callable[[str], Run],
    monkeypatch: pytest.MonkeyPatch,
    options: str,
    code: int,
    message: str,
) -> None:
    Path("sub.ply").mkdir()
    Path("calib.tif").write_text(CALIB, encoding="utf-8")
    Path("other.txt").write_text(CALIB.replace("=65", "=80"), encoding="utf-8")
    np.save("three.npy", np.eye(3))
    np.save("turned.npy", np.load("q.npy") * [[1], [-1], [-1], [1]])

    before = sorted(os.listdir())  # noqa: PTH208 - names, hidden ones too
    monkeypatch.setattr("phasestereo.cli.match.match_pair", lambda *_, **__: pytest.fail("matched"))

    got, out, err = match(options)
    assert (got, out) == (code, "")
    assert re.fullmatch(rf"phasestereo: error: .*{message}.*\n", err), err
    assert sorted(os.listdir()) == before  # noqa: PTH208 - names, hidden ones too

"""``phasestereo check``: what it prints and writes, and what it refuses."""

import importlib
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import phasestereo as ps
from phasestereo import io
from phasestereo.rig.blur import Blur, BlurEstimate
from support import Run

cli = pytest.importorskip("phasestereo.cli")

WRONG = 2
FAILED = 1


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder, which holds a pair at disparity 6."""
    monkeypatch.chdir(tmp_path)
    scene = np.random.default_rng(0).integers(0, 256, (80, 126, 3), dtype=np.uint8)
    io.write_image("left.png", scene[:, :-6])
    io.write_image("right.png", scene[:, 6:])
    return tmp_path


@pytest.fixture
def blurred(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the left image be softer in the left half, the right one a little in the right half."""
    estimate = BlurEstimate(
        blurs=(Blur("left", "disk", 4.0, 0.0), Blur("right", "gaussian", 1.0, 0.0)),
        labels=np.array([[0, 1]], np.uint8),
        tile=60,  # the second row of tiles, of 20 pixels, is left to the first
        certainty=1.0,
        contrast=1.0,
        gain=1.0,
        gamma=1.0,
        noise=(1.0, 1.0),
    )

    module = importlib.import_module("phasestereo.rig.diagnosis")
    found = module.estimate_pair
    monkeypatch.setattr(
        module, "estimate_pair", lambda *a, **b: replace(found(*a, **b), blur=estimate)
    )


def test_a_pair_that_cannot_be_matched_is_warned_of_first(
    run: Callable[..., Run], folder: Path
) -> None:
    """Two walls without texture: whatever estimates say, a match of them fails."""
    random = np.random.default_rng(0)
    for name in ("left.png", "right.png"):
        wall = 128 + random.normal(0, 1, (640, 720))
        if name == "left.png":
            wall[:40] += random.normal(0, 30, (40, 720))
        io.write_image(folder / name, np.rint(wall).clip(0, 255).astype(np.uint8))

    code, out, _ = run("check", "left.png", "right.png", "--strict")
    first = out.splitlines()[0]
    assert re.match(r"warning: about \d+ % of the pixels are probably wrong", first)
    assert "(a copy of 360 x 320 pixels was matched)" in first
    assert code == 3


def test_sentences_are_those_of_the_library(run: Callable[..., Run]) -> None:
    code, out, err = run("check", "left.png", "right.png")
    assert (code, err) == (0, "")
    check = importlib.import_module("phasestereo.rig.diagnosis").check
    said = str(check(io.read_image("left.png"), io.read_image("right.png")))
    for name in ("min_disparity", "num_disparities"):
        assert said.count(name) == 1
        said = said.replace(name, f"--{name.replace('_', '-')}")
    assert out == f"{said}\n"


@pytest.mark.parametrize(
    ("sentence", "expected"),
    [
        ("match with vertical=True, the upper", "match with --vertical, the upper"),
        ("(x, y - d); vertical=False matches rows", "(x, y - d); --no-vertical matches rows"),
        ("got 5; at most max_depth, which is 2", "got 5; at most --max-depth, which is 2"),
        ("or leave num_disparities out", "or leave --num-disparities out"),
        ("0 where num_disparities is None, since", "0 without --num-disparities, since"),
        ("min_confidence: needs confidence=True.", "--min-confidence: needs --confidence."),
        ("a window of 5, vertical, in camera_info", "a window of 5, vertical, in camera_info"),
        ("left_mask.png: damaged; /a/left_mask/b", "left_mask.png: damaged; /a/left_mask/b"),
        ("columns 'num_disparities', `left_mask`", "columns 'num_disparities', `left_mask`"),
        (r"C:\left_mask: x; my-left_mask", r"C:\left_mask: x; my-left_mask"),
    ],
)
def test_arguments_in_sentences_are_options(sentence: str, expected: str) -> None:
    errors = importlib.import_module("phasestereo.cli.errors")
    assert errors.spelled(sentence) == expected
    finding = ps.Finding("match", "note", sentence)
    assert errors.worded([finding]) == [f"note: {expected}"]


def test_faults_are_no_failure(run: Callable[..., Run]) -> None:
    code, out, _ = run("check", "right.png", "left.png")
    assert code == 0
    assert "note: nearly all disparities are negative" in out


def test_gray_levels_have_their_scale(run: Callable[..., Run]) -> None:
    assert ", on a scale of 255" in run("check", "left.png", "right.png")[1]
    for name in ("left", "right"):
        io.write_image(f"{name}.tif", io.read_image(f"{name}.png").astype(np.uint16) * 257)
    assert ", on a scale of 65535" in run("check", "left.tif", "right.tif")[1]


def test_json_is_one_object_and_nothing_else(run: Callable[..., Run]) -> None:
    code, out, err = run("check", "left.png", "right.png", "--json")
    assert (code, err) == (0, "")
    said = json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
    assert said["version"] == ps.__version__
    assert (said["width"], said["height"]) == (120, 80)
    assert said["search"]["swapped"] is False


@pytest.mark.usefixtures("blurred")
def test_blur_map_is_red_and_blue(run: Callable[..., Run]) -> None:
    code, _, _ = run("check", "left.png", "right.png", "--blur-map", "map.png")
    assert code == 0
    picture = io.read_image("map.png").astype(float)
    assert picture.shape == (80, 120, 3)
    red, _, blue = np.moveaxis(picture, 2, 0)
    assert (red - blue)[:, :60].min() > 100
    assert 20 < (blue - red)[:, 60:].min() < 100  # a weaker blur, a weaker tint


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        ("left.png", WRONG, "--layout: got None for left.png"),
        ("left.png right.png --jsn", WRONG, "--jsn"),
        ("left.png right.png --blur-map map.pfm", WRONG, "--blur-map: got map.pfm; accepts .png"),
        ("left.png right.png --blur-map right.png", WRONG, "right.png is an input"),
        ("left.png right.png --blur-map left.png/map.png", FAILED, "left.png: File exists"),
        ("left.png right.png --blur-map sub.png", FAILED, "sub.png exists and is not"),
        ("none.png right.png", FAILED, "none.png: No such file"),
        ("left.png small.png", FAILED, "right: got 4 x 64 .*up to 8 times"),
        ("left.png text.png", FAILED, "text.png: not an image"),
        ("inf.npy inf.npy", FAILED, "left: got inf"),
    ],
)
def test_refusals_are_one_line_and_leave_nothing(
    folder: Path, run: Callable[..., Run], arguments: str, code: int, message: str
) -> None:
    Path("sub.png").mkdir()
    Path("text.png").write_text("not an image at all")
    io.write_image("small.png", np.zeros((4, 64), np.uint8))
    io.write_image("inf.npy", np.full((60, 65), np.inf, np.float32))

    before = {path.name: path.stat().st_mtime_ns for path in folder.iterdir()}

    got, out, err = run("check", *arguments.split())
    assert (got, out) == (code, "")
    assert re.fullmatch(rf"phasestereo: error: .*{message}.*\n", err)
    assert {path.name: path.stat().st_mtime_ns for path in folder.iterdir()} == before

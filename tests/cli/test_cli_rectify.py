"""``phasestereo rectify``, and raw pairs and stereo photographs in the other commands."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo import io
from phasestereo_bench.rendering import render_pair
from support import Run, counterpart
from support.rigs import SIZE, cv2, made_up

counterpart("scipy")

UNTRUSTED, WRONG, FAILED = 3, 2, 1


@pytest.fixture(scope="module")
def scene() -> tuple[Any, Any]:
    pair = render_pair(3, height=SIZE[1], width=SIZE[0], num_disparities=24)
    turn = cv2.getRotationMatrix2D((SIZE[0] / 2, SIZE[1] / 2), 2, 1)
    return pair.left, cv2.warpAffine(pair.right, turn, SIZE, borderMode=cv2.BORDER_REFLECT)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, scene: tuple[Any, Any]) -> Path:
    """Return the current folder: a raw pair, both of it in one file, and a calibration."""
    monkeypatch.chdir(tmp_path)
    io.write_image("left.png", scene[0])
    io.write_image("right.png", scene[1])
    io.write_image("both.png", np.concatenate(scene, axis=1))
    np.savez("rig.npz", allow_pickle=False, **made_up())
    return tmp_path


def test_a_calibration_gives_what_the_library_gives(run: Callable[..., Run]) -> None:
    code, out, err = run(
        "rectify", "left.png", "right.png", "-o", "l.png", "r.png", "--calibration", "rig.npz",
        "--masks", "lm.png", "rm.png", "--save", "saved.npz", "--alpha", "1",
    )  # fmt: skip

    assert (code, err) == (0, "")

    expected = ps.rectify("left.png", "right.png", "rig.npz", alpha=1)
    assert out.splitlines()[: len(expected.sentences)] == list(expected.sentences)
    assert [f"wrote {name}" for name in ("l.png", "r.png", "lm.png", "rm.png", "saved.npz")] == (
        out.splitlines()[-5:]
    )

    np.testing.assert_array_equal(io.read_image("l.png"), expected.left)
    np.testing.assert_array_equal(io.read_image("r.png"), expected.right)
    np.testing.assert_array_equal(io.read_image("lm.png"), 255 * expected.left_mask)

    saved = ps.Rectification.load("saved.npz")
    np.testing.assert_array_equal(saved.maps[1], expected.maps[1])


def test_alpha_that_hides_something_is_dropped_with_a_word(
    run: Callable[..., Run], scene: tuple[Any, Any]
) -> None:
    alpha = np.full(SIZE[::-1], 255, np.uint8)
    alpha[:60] = 0
    io.write_image("alpha.png", np.dstack([scene[0], alpha]))
    command = (
        "rectify",
        "alpha.png",
        "right.png",
        "--calibration",
        "rig.npz",
        "-o",
        "l.png",
        "r.png",
    )
    code, _, err = run(*command)
    assert (code, err.count("note: alpha is dropped")) == (0, 1)
    assert run(*command, "--masks", "lm.png", "rm.png")[::2] == (0, "")
    assert io.read_image("l.png").shape == scene[0].shape
    expected = ps.rectify("alpha.png", "right.png", "rig.npz").left_mask
    np.testing.assert_array_equal(io.read_image("lm.png"), 255 * expected)


def test_images_alone_and_json(run: Callable[..., Run]) -> None:
    code, out, err = run(
        "rectify", "left.png", "right.png", "--json", "--images-from", "left.png", "right.png"
    )

    assert (code, err) == (0, "")

    content = json.loads(out)
    assert content["method"] == "images"
    assert (content["width"], content["height"]) == SIZE
    assert content["error"] < 0.5
    assert "of 2 pairs" in content["sentences"][0]
    assert content["q"] is None
    assert content["files"] == []


def test_a_photograph_of_both_views(run: Callable[..., Run]) -> None:
    layout = "--layout", "side-by-side"
    expected = ps.rectify("left.png", "right.png")

    code, _, err = run("rectify", "both.png", *layout, "-o", "l.png", "r.png")
    assert code == 0, err
    np.testing.assert_array_equal(io.read_image("r.png"), expected.right)

    code, out, _ = run("check", "both.png", *layout)
    assert (code, out) == (0, run("check", "left.png", "right.png")[1])

    for arguments in (("both.png", *layout), ("left.png", "right.png")):
        code, _, _ = run(
            "match", *arguments, "--num-disparities", 32, "-o", f"{len(arguments)}.npy"
        )
        assert code == 0
    np.testing.assert_array_equal(np.load("3.npy"), np.load("2.npy"))


def test_an_mpo_file_is_known_by_itself(run: Callable[..., Run], scene: tuple[Any, Any]) -> None:
    image = counterpart("PIL.Image")

    first, second = (image.fromarray(part) for part in scene)
    first.save("photo.mpo", format="MPO", save_all=True, append_images=[second])

    left, right = io.read_pair("photo.mpo")
    for name, view in (("l.png", left), ("r.png", right)):
        io.write_image(name, view)
    assert run("check", "photo.mpo") == run("check", "l.png", "r.png")

    code, out, _ = run("match", "photo.mpo", "--num-disparities", 32, "--json")
    assert (code, json.loads(out)["width"]) == (0, SIZE[0])


@pytest.mark.parametrize("sources", [["auto"], ["rig.npz"], ["saved.npz"]])
def test_a_raw_pair_is_matched(run: Callable[..., Run], sources: list[str]) -> None:
    rig = ps.rectify("left.png", "right.png", None if sources != ["rig.npz"] else "rig.npz")
    rig.save("saved.npz")
    words = [word for name in sources for word in ("--rectify", name)]

    code, out, err = run(
        "match", "left.png", "right.png", "--num-disparities", 48, "-o", "o.npy", *words
    )

    assert code == 0, err
    if sources == ["saved.npz"]:  # which is a calibration then
        assert "rows correspond as the calibration says" in out
    else:
        assert rig.sentences[0] in out

    expected = ps.match(
        rig.left, rig.right, num_disparities=48, left_mask=rig.left_mask, right_mask=rig.right_mask
    )
    np.testing.assert_array_equal(np.load("o.npy"), expected.disparity)


@pytest.mark.parametrize("lower", [0, 5])
def test_a_calibration_that_the_images_refute_is_a_warning(
    run: Callable[..., Run], lower: int
) -> None:
    pair = render_pair(3, height=SIZE[1], width=SIZE[0], num_disparities=24)
    io.write_image("left.png", pair.left)
    io.write_image("right.png", np.roll(pair.right, lower, axis=0))
    ideal = np.array([[150.0, 0, SIZE[0] / 2], [0, 150, SIZE[1] / 2], [0, 0, 1]])
    rig = made_up() | {"K1": ideal, "K2": ideal, "D1": np.zeros(5), "D2": np.zeros(5)}
    np.savez("ideal.npz", allow_pickle=False, **rig | {"R": np.eye(3), "T": [-0.1, 0, 0]})
    found = ps.rectify("left.png", "right.png", "ideal.npz")
    found.save("saved.npz")
    assert found.refuted == bool(lower)

    for source in ("ideal.npz", "saved.npz"):
        arguments = "match", "left.png", "right.png", "--num-disparities", 32, "--rectify", source
        code, _, err = run(*arguments, "--strict")
        assert code == (UNTRUSTED if lower else 0)
        assert (f"phasestereo: warning: {found.sentences[0]}\n" in err) == bool(lower)
        code, out, _ = run(*arguments, "--json")
        assert code == 0
        said = [one["sentence"] for one in json.loads(out)["findings"]]
        assert (found.sentences[0] in said) == bool(lower)


@pytest.mark.parametrize(("fault", "finding"), [
    ("none", None), ("turned", "and are not a depth"), ("cut", "disparities are not a depth"),
])  # fmt: skip
def test_depths_of_disparities_that_are_not_a_depth_are_a_warning(
    run: Callable[..., Run], fault: str, finding: str | None
) -> None:
    size = 320, 240
    pair = render_pair(3, height=size[1], width=size[0], num_disparities=24)
    turn = cv2.getRotationMatrix2D((size[0] / 2, size[1] / 2), 8, 1)
    right = {
        "none": pair.right,
        "turned": cv2.warpAffine(pair.right, turn, size, borderMode=cv2.BORDER_REFLECT),
        "cut": pair.right[20:-20],
    }[fault]
    io.write_image("left.png", pair.left)
    io.write_image("right.png", right)

    arguments = "match", "left.png", "right.png", "--num-disparities", 32, "--strict"
    code, _, err = run(*arguments, "-o", "d.npy")
    assert (code, "warning" in err) == (0, False)
    assert finding is None or finding in err

    code, _, err = run(*arguments, "--depth", "z.npy", "--focal", 100, "--baseline", 1)
    assert Path("z.npy").exists()
    assert code == (UNTRUSTED if finding else 0)
    assert ("warning: depths and points are wrong" in err) == bool(finding)


def test_q_of_a_calibration_is_the_geometry(run: Callable[..., Run]) -> None:
    arguments = "match", "left.png", "right.png", "--num-disparities", 48, "--rectify", "rig.npz"
    code, out, err = run(*arguments, "--depth", "z.npy", "-o", "d.npy", "--json", "--keep", "all")
    assert code == 0, err
    assert json.loads(out)["rectification"]["method"] == "calibration"

    rig = ps.rectify("left.png", "right.png", "rig.npz")
    known = io.Calibration.from_q(rig.Q, width=SIZE[0], height=SIZE[1])

    expected = known.depth(np.load("d.npy"))
    expected[~np.isfinite(expected)] = np.nan
    np.testing.assert_array_equal(np.load("z.npy"), expected)


def test_masks_are_those_of_the_raw_images(run: Callable[..., Run]) -> None:
    mask = np.full(SIZE[::-1], 255, np.uint8)
    mask[:60] = 0
    io.write_image("mask.png", mask)

    code, _, err = run(
        "match", "left.png", "right.png", "--num-disparities", 48, "-o", "o.npy",
        "--rectify", "rig.npz", "--left-mask", "mask.png",
    )  # fmt: skip
    assert code == 0, err

    rig = ps.rectify("left.png", "right.png", "rig.npz", left_mask=mask > 0)
    assert np.isnan(np.load("o.npy")[~rig.left_mask]).all()
    assert 0.2 < rig.left_mask.mean() < 0.7


def test_a_folder_of_frames_is_rectified(run: Callable[..., Run], scene: tuple[Any, Any]) -> None:
    for side, image in zip(("left", "right"), scene, strict=True):
        Path(side).mkdir()
        io.write_image(f"{side}/0.png", image)

    rig = ps.rectify(*scene)
    rig.save("saved.npz")

    for source in ("auto", "saved.npz"):
        code, _, err = run(
            "live", "left", "right", "--num-disparities", 48, "--preset", "fast",
            "--frames", f"{source}-%d.npy", "--rectify", source,
        )  # fmt: skip
        assert code == 0, err
        expected = ps.match(
            rig.left, rig.right, num_disparities=48, preset="fast",
            left_mask=rig.left_mask, right_mask=rig.right_mask,
        )  # fmt: skip
        np.testing.assert_array_equal(np.load(f"{source}-0.npy"), expected.disparity)


@pytest.mark.parametrize(("line", "code", "message"), [
    ("rectify left.png right.png", WRONG, "nothing to do: give -o LEFT RIGHT, --save or --json"),
    ("rectify left.png right.png -o l.png", WRONG, "-o requires 2"),
    ("rectify left.png right.png -o left.png r.png", WRONG, "--output: left.png is an input"),
    ("rectify left.png right.png -o l.png l.png", WRONG, "--output: l.png is an input or another"),
    ("rectify left.png right.png -o l.png r.xyz", WRONG, "--output: path must end in one of .png"),
    ("rectify left.png right.png --save rig.txt", WRONG, "--save: got rig.txt; accepts .npz"),
    ("rectify left.png right.png --masks a.png b.png --json", WRONG, "--masks: has no effect"),
    ("rectify left.png right.png --json --images-from left.png", WRONG, "--images-from: accepts"),
    ("rectify left.png right.png --json --images-from left.png right.png --calibration rig.npz",
     WRONG, "--images-from: has no effect beside --calibration"),
    ("rectify left.png right.png --json --calibration no.yml", FAILED, "no.yml: No such file"),
    ("rectify left.png right.png --json --calibration a b c", WRONG, "--calibration: got tuple"),
    ("rectify left.png right.png --json --alpha 3", WRONG, "--alpha"),
    ("rectify left.png right.png --json --alpha 0.5", WRONG, "--alpha: got 0.5; accepts None"),
    ("rectify left.png nowhere.png --json", FAILED, "nowhere.png: No such file"),
    ("rectify left.png both.png --json", FAILED, "images that do not show how to rectify them"),
    ("rectify left.png --json", WRONG, "--layout: got None for left.png"),
    ("rectify left.png right.png --layout top-bottom --json", WRONG, "--layout: has no effect"),
    ("match left.png right.png --num-disparities 9 --json --rectify a --rectify auto", WRONG,
     "--rectify: got a auto; accepts auto, a file, or the files of both cameras"),
    ("match left.png right.png --num-disparities 9 --json --rectify left.png", WRONG,
     "--rectify: got left.png, which is a picture"),
    ("match left.png right.png --num-disparities 9 -o rig.npz --rectify rig.npz", WRONG,
     "--output: rig.npz is an input or another"),
    ("match left.png --bands 1 --num-disparities 9 --json", WRONG, "--bands: has no effect"),
    ("rectify left.png right.png --calibration left.png --json", WRONG,
     "--calibration: got left.png, which is a picture"),
    ("check left.png right.png --layout top-bottom", WRONG, "--layout: has no effect"),
    ("live left.png right.png --num-disparities 9 --json --rectify no.npz", FAILED,
     "no.npz: No such file"),
])  # fmt: skip
def test_refusals_are_one_line_and_leave_nothing(
    run: Callable[..., Run], folder: Path, line: str, code: int, message: str
) -> None:
    before = sorted(folder.iterdir())
    got, out, err = run(*line.split())
    assert (got, out) == (code, "")
    assert err.startswith("phasestereo: error: ")
    assert message in err
    assert (err.count("\n"), sorted(folder.iterdir())) == (1, before)


def test_images_that_tell_nothing_are_refused(run: Callable[..., Run]) -> None:
    io.write_image("noise.png", np.random.default_rng(0).integers(0, 256, SIZE[::-1], np.uint8))
    io.write_image("gray.png", np.full(SIZE[::-1], 9, np.uint8))
    code, out, err = run("rectify", "noise.png", "gray.png", "-o", "l.png", "r.png")
    assert (code, out) == (FAILED, "")
    assert err.startswith("phasestereo: error: left, right: got images that do not")

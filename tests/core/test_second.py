"""`second=`: maps and matchers that are right, wrong, sparse, slow, or that fail."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import re
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo import io
from phasestereo.matchers import load_matcher
from phasestereo.metrics import bad_pixels
from phasestereo_bench.datasets import find_scene
from phasestereo_bench.rendering import render_pair
from phasestereo_bench.rigs.geometry import Misaligned
from support import Run, counterpart

Map = NDArray[np.float32]

HEIGHT, WIDTH, RANGE = 160, 240, 40


class Scene(NamedTuple):
    """A rendered pair, its noisy images, and its true disparities."""

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    truth: Map
    seen: NDArray[np.bool_]
    own: ps.Result


@pytest.fixture(scope="module")
def scene() -> Scene:
    pair = render_pair(3, height=HEIGHT, width=WIDTH, num_disparities=RANGE)
    rng = np.random.default_rng(1)
    noisy = [
        np.clip(image + rng.normal(0, 15, image.shape), 0, 255).astype(np.uint8)
        for image in (pair.left, pair.right)
    ]
    own = ps.match(*noisy, threads=1)
    seen = pair.masks["nonocc"] & np.isfinite(pair.truth)
    return Scene(noisy[0], noisy[1], pair.truth, seen, own)


def fused(scene: Scene, second: object, **options: object) -> ps.Result:
    return ps.match(scene.left, scene.right, second=second, threads=1, **options)  # type: ignore[arg-type]


def wrong(scene: Scene, disparity: Map) -> float:
    return float((~(np.abs(disparity - scene.truth) <= 1))[scene.seen].mean())


def same(one: ps.Result, other: ps.Result) -> bool:
    return all(
        np.array_equal(one.maps[name], other.maps[name], equal_nan=name != "flags")
        for name in other.maps
    )


def test_a_better_map_makes_the_result_better_and_says_where(scene: Scene) -> None:
    found = fused(scene, scene.truth)
    assert wrong(scene, found.disparity) < 0.92 * wrong(scene, scene.own.disparity)

    taken = (found.flags & ps.Flag.SECOND) != 0
    assert found.summary.second == pytest.approx(taken.mean())
    assert 0.02 < taken.mean() < 0.5
    assert np.array_equal(found.disparity[taken], scene.truth[taken])
    right = 1 - wrong(scene, found.disparity)
    assert found.confidence[scene.seen].mean() == pytest.approx(right, abs=0.05)
    assert (found.uncertainty[np.isfinite(found.disparity)] > 0).all()


def test_where_both_agree_the_result_is_between_them(scene: Scene) -> None:
    claims = scene.truth + np.float32(0.3)
    found, own = fused(scene, claims), scene.own.disparity
    near = np.abs(own - claims) <= 1
    low, high = np.minimum(own, claims)[near], np.maximum(own, claims)[near]
    assert ((found.disparity[near] >= low - 1e-4) & (found.disparity[near] <= high + 1e-4)).all()
    assert not (found.flags[near] & ps.Flag.SECOND).any()


def test_a_map_of_nonsense_hardly_harms(scene: Scene) -> None:
    random = np.random.default_rng(2).uniform(0, RANGE, (HEIGHT, WIDTH)).astype(np.float32)
    for claims in (random, np.full_like(random, 3)):
        found = fused(scene, claims)
        assert wrong(scene, found.disparity) < wrong(scene, scene.own.disparity) + 0.02


def test_pixels_without_a_claim_stay_as_they_are(scene: Scene) -> None:
    sparse = np.full_like(scene.truth, np.nan)
    sparse[::4, ::5] = scene.truth[::4, ::5]
    found, none = fused(scene, sparse), np.isnan(sparse)
    for name, values in scene.own.maps.items():
        assert np.array_equal(found.maps[name][none], values[none], equal_nan=name != "flags")
    assert (found.flags[~none] & ps.Flag.SECOND).any()


def test_a_function_and_its_map_give_the_same(scene: Scene) -> None:
    prepared = ps.prepare(scene.left, scene.right, threads=1)

    def network(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> Map:
        assert np.array_equal(left, prepared.left)
        assert np.array_equal(right, prepared.right)
        return scene.truth

    by_map = fused(scene, scene.truth)
    for found in (
        fused(scene, network),
        fused(scene, network, timeout=60),
        ps.Matcher(threads=2).match(scene.left, scene.right, second=network),
        ps.Rig().match(scene.left, scene.right, second=network),
    ):
        assert same(found, by_map)


def test_a_second_matcher_may_be_our_own(scene: Scene) -> None:
    def fast(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> Map:
        return ps.match(left, right, preset="fast", threads=1).disparity

    found = fused(scene, fast)  # on the threads of the match that waits for it
    assert not any(one.topic == "map" for one in found.findings)
    assert not same(found, scene.own)


def test_cameras_one_above_the_other_take_a_map_of_the_upper_image(scene: Scene) -> None:
    upper, lower, truth = (np.rot90(each, -1) for each in (scene.left, scene.right, scene.truth))
    upright = fused(scene, scene.truth).disparity
    for second in (truth, lambda _left, _right: scene.truth):  # a matcher searches along rows
        turned = ps.match(upper, lower, second=second, vertical=True, threads=1)
        assert np.array_equal(np.rot90(turned.disparity), upright)


def test_a_pair_that_is_rectified_shows_its_matcher_the_rectified_one(data: Path) -> None:
    counterpart("cv2")
    cones = find_scene(data / "middlebury", "cones").load()
    turned = Misaligned(turn=5)(cones, "right")
    prepared = ps.prepare(turned.left, turned.right, threads=1)
    network = load_matcher("sgbm")
    theirs = network(prepared.left, prepared.right, prepared.num_disparities)

    own = ps.match(turned.left, turned.right, threads=1)
    by_matcher = ps.match(turned.left, turned.right, second="sgbm", threads=1)
    by_map = ps.match(turned.left, turned.right, second=prepared.restore(theirs), threads=1)
    assert by_matcher.summary.second > 0.002
    assert (np.abs(by_matcher.disparity - by_map.disparity) < 0.1).mean() > 0.97

    mask = cones.masks["nonocc"]
    wrong = [
        bad_pixels(found.disparity, turned.truth, 1.0, mask & np.isfinite(turned.truth))
        for found in (own, by_matcher)
    ]
    assert wrong[1] < wrong[0] + 0.3


def test_hitnet_and_the_match_are_better_than_either(data: Path) -> None:
    counterpart("onnxruntime")
    network = load_matcher(f"onnx:{data / 'rivals/hitnet_eth3d.onnx'}", threads=1)
    wrong = []
    for name in ("cones", "tsukuba"):
        pair = find_scene(data / "middlebury", name).load()
        rng = np.random.default_rng(3)
        noisy = [
            np.clip(image + rng.normal(0, 20, image.shape), 0, 255).astype(np.uint8)
            for image in (pair.left, pair.right)
        ]
        prepared = ps.prepare(*noisy, threads=1)
        theirs = prepared.restore(network(prepared.left, prepared.right))
        maps = (
            ps.match(*noisy, threads=1).disparity,
            theirs,
            ps.match(*noisy, second=network, threads=1).disparity,
        )
        wrong.append([bad_pixels(found, pair.truth, 1.0, pair.masks["nonocc"]) for found in maps])
    own, theirs_wrong, both = np.mean(wrong, axis=0)
    assert both < min(own, theirs_wrong)


def test_there_are_confidences_whatever_the_settings_say(scene: Scene) -> None:
    assert fused(scene, scene.truth, preset="fast").confidence is not None


def fails(_left: object, _right: object) -> Map:
    raise RuntimeError("out of memory")


@pytest.mark.parametrize(
    ("second", "words"),
    [
        (fails, "second matcher fails failed.*RuntimeError: out of memory"),
        (lambda _left, _right: np.zeros((3, 4)), r"answer of .*: got shape \(3, 4\)"),
        (lambda left, _right: np.full(left.shape[:2], np.nan), "no pixel has a disparity"),
        (lambda _left, _right: "map", "got str; accepts an array"),
        (lambda _left, _right: None, "second matcher"),
    ],
)
def test_a_matcher_that_fails_leaves_our_own_map_and_a_finding(
    scene: Scene, second: Callable[..., object], words: str
) -> None:
    found = fused(scene, second)
    assert same(found, scene.own)
    (said,) = (one for one in found.findings if one.topic == "map")
    assert said.severity == "warning"
    np.testing.assert_array_equal(astuple(found.summary), astuple(scene.own.summary))
    assert re.search(words, said.sentence)


@pytest.mark.parametrize(
    ("meant", "words"),
    [
        (lambda truth: -truth, "sign of the map is inverted"),
        (lambda truth: np.rint(truth * 16).astype(np.int16), "16 times too large"),
    ],
)
def test_a_map_that_is_meant_otherwise_is_named_and_not_taken(
    scene: Scene, meant: Callable[[Map], NDArray[np.generic]], words: str
) -> None:
    found = fused(scene, meant(np.nan_to_num(scene.truth)))
    assert same(found, scene.own)
    assert any(words in each.sentence for each in found.findings)


def test_a_map_outside_the_right_image_is_named_and_not_taken(scene: Scene) -> None:
    found = fused(scene, np.full_like(scene.truth, 1e30))
    assert wrong(scene, found.disparity) <= wrong(scene, scene.own.disparity)
    assert not (found.flags & ps.Flag.SECOND).any()
    assert found.confidence.mean() <= scene.own.confidence.mean()
    assert any("lie outside the right image" in each.sentence for each in found.findings)


def test_a_matcher_that_hangs_is_abandoned(scene: Scene) -> None:
    end = threading.Event()

    def hangs(_left: object, _right: object) -> Map:
        end.wait()
        return scene.truth

    try:
        found = fused(scene, hangs, timeout=0.2)
    finally:
        end.set()
    assert same(found, scene.own)
    assert any("no answer within 0.2 s" in one.sentence for one in found.findings)


LEAVING = """
import threading, time
import numpy as np, phasestereo as ps

def late(left, right):
    threading.main_thread().join()  # the exit has begun
    time.sleep(0.5)
    print("returned", flush=True)
    return np.zeros(left.shape, np.float32)

pair = np.random.default_rng(0).integers(0, 256, (2, 40, 60), np.uint8)
ps.match(*pair, second=late, timeout=0.05, threads=1)
"""


def test_an_exit_waits_for_an_abandoned_matcher() -> None:
    done = subprocess.run(  # noqa: S603 -- this interpreter, our words
        [sys.executable, "-W", "ignore", "-c", LEAVING], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (0, "returned\n"), done.stderr


@pytest.mark.parametrize(
    ("second", "options", "error", "message"),
    [
        (np.zeros((3, 4)), {}, ValueError, "second: got shape"),
        (np.full((HEIGHT, WIDTH), np.nan), {}, ValueError, "second: no pixel claims"),
        (np.ones((HEIGHT, WIDTH), bool), {}, TypeError, "second: got dtype bool"),
        ("network.txt", {}, ValueError, "second: got 'network.txt'"),
        ("onnx:missing.onnx", {}, (OSError, ImportError), "missing.onnx|onnxruntime"),
        (f"onnx:{__file__}", {}, (ValueError, ImportError), "test_second.py|onnxruntime"),
        (fails, {"timeout": 0}, ValueError, "timeout: got 0"),
        (None, {"timeout": 1}, ValueError, "timeout: got one without"),
        (fails, {"timeout": "1 s"}, TypeError, "timeout: got str"),
    ],
)
def test_what_is_not_a_second_map_is_refused(
    scene: Scene,
    second: object,
    options: dict[str, object],
    error: type[Exception],
    message: str,
) -> None:
    with pytest.raises(error, match=message):
        fused(scene, second, **options)


def test_the_command_takes_a_second_matcher(
    scene: Scene, run: Callable[..., Run], tmp_path: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    counterpart("cv2")
    monkeypatch.chdir(str(tmp_path))
    io.write_image("left.png", scene.left)
    io.write_image("right.png", scene.right)
    code, _, err = run("match", "left.png", "right.png", "-o", "map.pfm", "--second", "sgbm")
    assert code == 0, err
    found = io.read_disparity("map.pfm")
    assert np.array_equal(found, fused(scene, "sgbm").disparity, equal_nan=True)
    assert not np.array_equal(found, scene.own.disparity)

    code, _, err = run("match", "left.png", "right.png", "-o", "map.pfm", "--second", "net.onnx")
    assert code == 2
    assert "second: got 'net.onnx'" in err

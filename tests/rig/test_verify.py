"""`phasestereo.verify`: maps that are right, wrong, meant otherwise, or no maps of the pair."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

import phasestereo as ps
from phasestereo import _core, io
from phasestereo.metrics import roc_area
from phasestereo_bench.degradation import Degradation, disk_psf
from phasestereo_bench.rendering import render_pair
from support import Run

Map = NDArray[np.float32]

HEIGHT, WIDTH, RANGE = 200, 280, 48
WRONG, FAILED, UNTRUSTED = 2, 1, 3


class Scene(NamedTuple):
    """A rendered pair, and its true disparities."""

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    truth: Map
    visible: NDArray[np.bool_]


@pytest.fixture(scope="module")
def scene() -> Scene:
    pair = render_pair(3, height=HEIGHT, width=WIDTH, num_disparities=RANGE)
    return Scene(pair.left, pair.right, pair.truth, pair.masks["nonocc"] & (pair.truth > 0))


@pytest.fixture(scope="module")
def spoiled(scene: Scene) -> Map:
    """Return the truth with a square that is 4 px off, and without the first rows."""
    claims = scene.truth.copy()
    claims[80:120, 120:170] += 4
    claims[:10] = np.nan
    return claims


def judge(scene: Scene, claims: object, **options: object) -> ps.Verification:
    return ps.verify(scene.left, scene.right, claims, threads=1, **options)  # type: ignore[arg-type]


def share(verification: ps.Verification, verdict: ps.Verdict, pixels: NDArray[np.bool_]) -> float:
    return float((verification.verdict[pixels] == verdict).mean())


def spread(disparities: Map) -> Map:
    """Return the range of disparities within 4 px along the row and the column."""
    rows = [np.roll(disparities, by, axis) for axis in (0, 1) for by in range(-4, 5)]
    found: Map = np.max(rows, axis=0) - np.min(rows, axis=0)
    return found


def test_verdicts_are_those_of_the_core() -> None:
    assert {each.name: each.value for each in ps.Verdict} == _core.VERDICTS


def test_what_is_wrong_is_refuted_and_what_is_right_is_not(scene: Scene, spoiled: Map) -> None:
    found = judge(scene, spoiled)
    square = np.zeros_like(scene.visible)
    square[80:120, 120:170] = True

    wrong, right = scene.visible & square, scene.visible & ~square
    assert share(found, ps.Verdict.REFUTED, wrong) > 0.8
    assert share(found, ps.Verdict.REFUTED, right & np.isfinite(spoiled)) < 0.03
    assert share(found, ps.Verdict.SUPPORTED, right & np.isfinite(spoiled)) > 0.7

    refuted = found.verdict == ps.Verdict.REFUTED
    assert np.array_equal(refuted, np.isfinite(found.better))
    better = np.abs(found.better - scene.truth)[refuted & wrong]
    assert (better <= 1).mean() > 0.9
    assert found.refuted + found.supported + found.unknown == pytest.approx(1)


def test_confidence_is_the_share_that_is_right_and_bars_hold_the_errors(scene: Scene) -> None:
    rng = np.random.default_rng(4)
    claims = scene.truth + rng.normal(0, 0.2, scene.truth.shape).astype(np.float32)
    for _ in range(25):
        y, x = rng.integers(0, HEIGHT - 25), rng.integers(0, WIDTH - 30)
        claims[y : y + 25, x : x + 30] += rng.uniform(-8, 8)
    found = judge(scene, claims)

    seen = scene.visible & np.isfinite(claims)
    errors = np.abs(claims - scene.truth)[seen]
    confidence, bars = found.confidence[seen], found.uncertainty[seen]
    assert 0.1 < (errors > 1).mean() < 0.7
    assert confidence.mean() == pytest.approx((errors <= 1).mean(), abs=0.1)
    area = roc_area(found.confidence, claims, scene.truth, mask=seen)
    assert area > 0.9
    assert (errors <= bars).mean() > 0.85
    assert np.median(bars[errors <= 1]) < 1 < np.median(bars[errors > 1])


def test_sparse_maps_are_judged_where_they_claim_something(scene: Scene, spoiled: Map) -> None:
    sparse = np.full_like(spoiled, np.nan)
    sparse[::5, ::4] = spoiled[::5, ::4]
    found, claimed = judge(scene, sparse), np.isfinite(sparse)
    assert (found.confidence[~claimed] == 0).all()
    assert np.array_equal(np.isfinite(found.uncertainty), claimed)
    square = np.zeros_like(claimed)
    square[80:120, 120:170] = True
    known = claimed & scene.visible
    assert found.confidence[known & square].mean() < 0.3
    assert found.confidence[known & ~square].mean() > 0.8


def test_hidden_pixels_are_seldom_refuted(scene: Scene) -> None:
    hidden = ~scene.visible & np.isfinite(scene.truth)
    assert hidden.sum() > 500
    assert share(judge(scene, scene.truth), ps.Verdict.REFUTED, hidden) < 0.15


def test_blur_and_light_are_no_reason_to_refute(scene: Scene) -> None:
    soft = Degradation(disk_psf(4), gain=0.7, noise=1)(scene.left)
    found = ps.verify(soft, scene.right, scene.truth, threads=1)
    inside = scene.visible & (spread(scene.truth) < 1)  # soft edges may be anybody's
    assert share(found, ps.Verdict.REFUTED, inside) < 0.05
    assert share(found, ps.Verdict.SUPPORTED, inside) > 0.6


def test_the_order_of_a_map_in_memory_has_no_effect(scene: Scene, spoiled: Map) -> None:
    expected = judge(scene, spoiled).verdict
    np.testing.assert_array_equal(judge(scene, np.asfortranarray(spoiled)).verdict, expected)


def test_what_is_not_finite_claims_nothing(scene: Scene, spoiled: Map) -> None:
    endless = spoiled.copy()
    endless[:10:2], endless[1:10:2] = np.inf, -np.inf
    found, same = judge(scene, spoiled), judge(scene, endless)
    assert np.array_equal(found.verdict == ps.Verdict.NO_CLAIM, np.isnan(spoiled))
    assert np.array_equal(found.verdict, same.verdict)


def test_the_result_depends_on_no_number_of_threads(scene: Scene, spoiled: Map) -> None:
    one = judge(scene, spoiled)
    three = ps.verify(scene.left, scene.right, spoiled, threads=3)
    assert np.array_equal(one.verdict, three.verdict)
    assert np.array_equal(one.better, three.better, equal_nan=True)
    assert np.array_equal(one.confidence, three.confidence)
    assert np.array_equal(one.uncertainty, three.uncertainty, equal_nan=True)
    assert one.findings == three.findings


@pytest.mark.parametrize(
    ("meant", "words"),
    [
        (lambda truth: -truth, "sign of the map is inverted"),
        (lambda truth: np.rint(truth * 16).astype(np.int16), "16 times too large"),
        (lambda truth: np.rint(truth * 256).astype(np.uint16), "256 times too large"),
    ],
)
def test_a_map_that_is_meant_otherwise_is_named(
    scene: Scene, meant: Callable[[Map], NDArray[np.generic]], words: str
) -> None:
    found = judge(scene, meant(np.nan_to_num(scene.truth)))
    assert found.findings[0].severity == "warning"
    assert words in found.findings[0].sentence
    # Nor does it make the search longer.
    assert found.result.search.num_disparities < 2 * RANGE


def test_disparities_beyond_the_images_are_not_searched(scene: Scene) -> None:
    claims = scene.truth.astype(np.float64)
    claims[::2] = 1e9
    claims[1, ::2] = -1e300
    found = judge(scene, claims)
    assert found.result.search.num_disparities < 2 * RANGE
    assert share(found, ps.Verdict.SUPPORTED, np.abs(claims) > WIDTH) == 0
    assert any("outside the right image" in each.sentence for each in found.findings)


@pytest.mark.parametrize("by", [0.5, 2, 3])
def test_a_wrong_map_of_a_distant_scene_is_in_pixels(scene: Scene, by: float) -> None:
    moved = ndimage.shift(scene.left.astype(np.float32), (0, -by, 0)[: scene.left.ndim], order=3)
    found = ps.verify(scene.left.astype(np.float32), moved, np.full(moved.shape[:2], 20.0))
    assert not any("times too large" in one.sentence for one in found.findings)


def test_a_claim_beyond_the_range_that_is_found_is_searched(scene: Scene) -> None:
    far = scene.truth.copy()
    far[60:140, 150:] = 110
    found = judge(scene, far)
    search = found.result.search
    assert search.min_disparity + search.num_disparities > 110
    assert share(found, ps.Verdict.REFUTED, scene.visible & (far == 110)) > 0.7


@pytest.mark.parametrize(
    ("disparity", "error", "message"),
    [
        (np.zeros((HEIGHT, WIDTH - 1)), ValueError, "disparity: got shape"),
        (np.zeros((HEIGHT, WIDTH, 1)), ValueError, "disparity: got shape"),
        (np.full((HEIGHT, WIDTH), np.nan), ValueError, "no pixel claims a disparity"),
        (np.full((HEIGHT, WIDTH), np.inf), ValueError, "no pixel claims a disparity"),
        (np.ones((HEIGHT, WIDTH), bool), TypeError, "disparity: got dtype bool"),
        (np.ones((HEIGHT, WIDTH), complex), TypeError, "disparity: got dtype complex128"),
        ("map.pfm", TypeError, "disparity: got str; accepts an array"),
        (np.ma.ones((HEIGHT, WIDTH)), TypeError, "disparity: got a masked array"),
    ],
)
def test_what_is_no_map_of_the_pair_is_refused(
    scene: Scene, disparity: object, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        judge(scene, disparity)


def test_pixels_that_a_mask_leaves_out_are_not_judged(scene: Scene, spoiled: Map) -> None:
    mask = np.ones((HEIGHT, WIDTH), bool)
    mask[90:110] = False
    found = judge(scene, spoiled, left_mask=mask)
    assert share(found, ps.Verdict.UNKNOWN, ~mask) == 1


def test_images_too_small_to_estimate_anything_are_judged_without_an_error() -> None:
    image = np.random.default_rng(0).integers(0, 256, (5, 7), np.uint8)
    found = ps.verify(image, image, np.zeros((5, 7)))
    assert found.verdict.shape == (5, 7)
    assert found.refuted == 0


def test_it_is_shown_and_pickled(scene: Scene, spoiled: Map) -> None:
    found = judge(scene, spoiled)
    assert repr(found).startswith(f"<Verification {WIDTH}x{HEIGHT}, {found.refuted:.1%} refuted, ")
    assert str(found).splitlines()[0].endswith(f"cannot judge {100 * found.unknown:.1f} %")

    again = pickle.loads(pickle.dumps(found))  # noqa: S301 - our own
    assert np.array_equal(again.verdict, found.verdict)
    with pytest.raises(ValueError, match="result: got no pair"):
        again.picture()

    picture = found.picture()
    red, _, blue = np.moveaxis(picture.astype(int), 2, 0)
    assert (red > blue)[found.verdict == ps.Verdict.REFUTED].all()
    assert (blue > red)[found.verdict == ps.Verdict.SUPPORTED].all()
    assert (blue == red)[found.verdict <= ps.Verdict.UNKNOWN].all()


# The command


@pytest.fixture
def files(scene: Scene, spoiled: Map, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder, which holds the pair and the map."""
    pytest.importorskip("phasestereo.cli")
    monkeypatch.chdir(tmp_path)
    io.write_image("left.png", scene.left)
    io.write_image("right.png", scene.right)
    io.write_disparity("map.pfm", spoiled)
    return tmp_path


PAIR = "verify", "left.png", "right.png"


def test_the_command_says_and_writes_what_the_function_returns(
    files: Path, scene: Scene, spoiled: Map, run: Callable[..., Run]
) -> None:
    found = judge(scene, spoiled)
    written = {"--picture": "seen.png", "--better": "better.pfm", "--verdict": "verdict.png"}
    arguments = [word for each in written.items() for word in each]

    code, out, err = run(*PAIR, "map.pfm", *arguments)
    assert (code, err) == (0, "")
    assert out == f"{found}\n"
    assert np.array_equal(io.read_image("verdict.png"), found.verdict)
    assert np.array_equal(io.read_image("seen.png"), found.picture())
    assert np.array_equal(io.read_disparity("better.pfm"), found.better, equal_nan=True)

    record = json.loads(run(*PAIR, "map.pfm", "--json")[1])
    assert record["refuted"] == found.refuted
    assert record["findings"][0]["sentence"] == found.findings[0].sentence
    assert (files / "seen.png").is_file()


def test_the_command_refuses_what_it_cannot_judge_or_write(
    files: Path, scene: Scene, run: Callable[..., Run]
) -> None:
    io.write_disparity("small.pfm", np.zeros((4, 5), np.float32))
    io.write_disparity("minus.pfm", -scene.truth)

    code, _, err = run(*PAIR, "small.pfm")
    assert code == FAILED
    assert "disparity: got shape (4, 5)" in err
    assert run(*PAIR, "none.pfm")[0] == FAILED
    assert run(*PAIR, "map.pfm", "--picture", "seen.jpg")[0] == WRONG
    assert run(*PAIR, "map.pfm", "--better", "map.pfm")[0] == WRONG
    assert run(*PAIR, "map.pfm", "--threads", "0")[0] == WRONG

    code, out, _ = run(*PAIR, "minus.pfm", "--strict")
    assert code == UNTRUSTED
    assert out.startswith("warning: the sign of the map is inverted")
    assert not (files / "seen.jpg").exists()

"""The range of disparities: it holds the truth, without much else; swapped pairs are recognized."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage
from test_alignment import gray

import phasestereo as ps
from phasestereo.rig.search_range import SearchRange
from phasestereo.settings import PresetName
from phasestereo_bench import degradation
from phasestereo_bench.datasets import find_scene, find_scenes
from phasestereo_bench.rigs import FAULTS, side_of
from support.estimating import estimated

Plane = NDArray[np.float32]

SCENES = "tsukuba", "cones", "Playroom", "Aloe"


def found(left: Plane, right: Plane) -> SearchRange:
    search = estimated(left, right).search
    assert search.origin == "found"
    return search


def noise(seed: int, shape: tuple[int, int] = (80, 160)) -> Plane:
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


def inside(truth: NDArray[np.floating], search: SearchRange) -> float:
    last = search.min_disparity + search.num_disparities - 1
    return float(np.mean((truth >= search.min_disparity) & (truth <= last)))


@pytest.mark.parametrize("radius", [0, 6])
def test_range_holds_the_truth_and_little_else(data: Path, radius: int) -> None:
    defocus = degradation.Degradation(degradation.disk_psf(radius), noise=1)
    for name in SCENES:
        pair = find_scene(data / "middlebury", name).load()

        search = found(gray(defocus(pair.left)), gray(pair.right))
        truth = pair.truth[np.isfinite(pair.truth)]
        assert inside(truth, search) >= 0.995, name

        low, high = np.percentile(truth, [0.25, 99.75])
        assert search.num_disparities <= 2.5 * (high - low) + 4, name
        assert (search.swapped, search.mixed) == (False, False), name


def test_noise_hides_no_end_of_the_range(data: Path) -> None:
    scene = find_scene(data / "middlebury", "Lampshade1")
    pair = FAULTS["webcam"](scene.load(), side_of(scene))
    search = ps.match(pair.left, pair.right).search
    assert inside(pair.truth[pair.masks["nonocc"]], search) >= 0.99


def test_exchanged_images_are_reported_and_their_range_found(data: Path) -> None:
    for name in SCENES:
        pair = find_scene(data / "middlebury", name).load()
        search = found(gray(pair.right), gray(pair.left))
        assert search.swapped, name
        assert inside(-pair.truth[np.isfinite(pair.truth)], search) >= 0.995, name


def test_toed_in_cameras_are_not_called_swapped() -> None:
    far, near = noise(0, (80, 200)), noise(1, (80, 200))
    left, right = far[:, 10:-10].copy(), far[:, :-20].copy()  # disparity -10 ...
    left[20:60, 60:120] = near[20:60, 60:120]
    right[20:60, 52:112] = near[20:60, 60:120]  # ... and 8
    search = found(left, right)
    assert search.mixed
    assert not search.negative


def test_no_order_of_the_cameras_is_reported_that_is_wrong(data: Path) -> None:
    scenes = [scene.load() for scene in find_scenes(data / "middlebury")]
    pairs = [(gray(scene.left), gray(scene.right)) for scene in scenes]
    assert not any(found(left, right).swapped for left, right in pairs)
    exchanged = [found(right, left) for left, right in pairs]
    assert all(search.negative for search in exchanged)
    assert sum(search.swapped for search in exchanged) >= 0.8 * len(scenes)


def test_cropped_images_are_not_called_swapped(data: Path) -> None:
    for name in ("tsukuba", "cones", "Playroom"):
        scene = find_scene(data / "middlebury", name).load()
        beyond = scene.num_disparities + 10
        left, right = scene.left[:, beyond:], scene.right[:, :-beyond]
        search = found(gray(left), gray(right))
        assert search.negative, name
        assert not search.swapped, name


@pytest.mark.parametrize("share", [0.42, 0.5, 0.6, -0.5])
def test_ranges_beyond_45_percent_of_the_width_are_found(data: Path, share: float) -> None:
    for name in ("cones", "Moebius", "Rocks1"):
        pair = find_scene(data / "middlebury", name).load()
        middle = float(np.median(pair.truth[np.isfinite(pair.truth)]))
        # Cropped so that the median disparity is this share of the width that remains.
        width = int((pair.left.shape[1] + np.sign(share) * middle) / (1 + abs(share)))
        by = pair.left.shape[1] - width
        left, right = np.s_[:, :width], np.s_[:, by:]
        if share < 0:
            left, right, by = right, left, -by
        truth = pair.truth[left] + by

        result = ps.match(pair.left[left], pair.right[right])
        assert result.search.origin == "found", name
        at = np.arange(width) - truth
        is_seen = np.isfinite(truth) & (at >= 0) & (at < width)
        assert inside(truth[is_seen], result.search) >= 0.98, name
        assert np.mean(np.abs(result.disparity - truth)[is_seen] <= 1) > 0.9, name


def far_and_near(
    size: tuple[int, int], far: tuple[float, float], thing: tuple[slice, slice], near: int
) -> tuple[Plane, Plane]:
    """Return a ramp of disparities from top to bottom, and a thing before it."""
    rows, columns = size
    right = ndimage.gaussian_filter(noise(0, size), 0.7)
    places = np.arange(columns)
    ramp = np.linspace(*far, rows)
    left = np.array(
        [np.interp(places - d, places, row) for d, row in zip(ramp, right, strict=True)]
    )
    left = left.astype(np.float32)

    if near:
        where_rows, where = thing
        patch = 1.4 * ndimage.gaussian_filter(noise(1, left[thing].shape), 0.7)
        left[thing] = patch
        right[where_rows, where.start - near : where.stop - near] = patch
    return left, right


NOTHING = np.s_[0:0, 0:0]


@pytest.mark.parametrize(
    ("size", "thing", "near"),
    [
        ((380, 560), np.s_[100:130, 300:336], 90),  # half a percent
        ((380, 430), np.s_[100:240, 250:258], 46),  # a pole
        ((370, 1240), np.s_[100:240, 700:709], 90),
        ((370, 1240), np.s_[200:226, 500:526], 45),
        ((370, 620), np.s_[200:205, 200:440], 70),  # a bar across
        ((370, 620), np.s_[200:212, 300:312], 70),
        ((370, 620), np.s_[100:240, 300:304], 90),
    ],
)
def test_what_is_near_and_small_belongs_to_the_range(
    size: tuple[int, int], thing: tuple[slice, slice], near: int
) -> None:
    left, right = far_and_near(size, (4, 12), thing, near)
    # The noise of each image is its own.
    search = found(left + 0.02 * noise(5, size), right + 0.02 * noise(6, size))
    assert search.min_disparity <= 4
    assert search.min_disparity + search.num_disparities > near
    assert search.left_out == ()


@pytest.mark.parametrize(("period", "disparity"), [(25, 47), (40, 12), (40, 90), (60, 130)])
def test_a_wall_that_repeats_itself_is_not_trusted(period: int, disparity: int) -> None:
    tile = ndimage.gaussian_filter(noise(period, (200, period)), 1.5, mode=("reflect", "wrap"))
    wall = np.tile(tile / tile.std(), (1, 2 + (640 + disparity) // period))
    left, right = wall[:, :640], wall[:, disparity:][:, :640]
    result = ps.match(
        left + 0.04 * noise(1, left.shape), right + 0.04 * noise(2, left.shape), threads=1
    )
    is_wrong = np.abs(result.disparity - disparity) > 2
    assert np.mean(is_wrong & (result.confidence > 0.5)) < 0.01
    topics = {one.topic for one in result.findings if one.severity == "warning"}
    assert "repetition" in topics
    assert "swap" not in topics


@pytest.mark.parametrize("columns", [450, 1077, 2154])
@pytest.mark.parametrize("far", [(-3, 3), (-6, 18), (-25, 5)])
def test_both_ends_are_found_whatever_their_sign(columns: int, far: tuple[int, int]) -> None:
    search = found(*far_and_near((200, columns), far, NOTHING, 0))
    last = search.min_disparity + search.num_disparities - 1
    assert search.min_disparity <= far[0]
    assert far[1] <= last
    assert last - search.min_disparity <= 1.6 * (far[1] - far[0]) + 10
    assert not search.swapped
    assert not search.identical


@pytest.mark.parametrize("sigma", [0.0, 0.05])
def test_the_same_image_twice_is_recognized(sigma: float) -> None:
    left, _ = far_and_near((200, 450), (4, 12), NOTHING, 0)
    search = found(left, left + np.float32(sigma) * noise(3, left.shape))
    assert search.identical
    assert (search.min_disparity, search.num_disparities) == (-2, 5)


def test_a_match_of_the_same_image_twice_leads_with_that() -> None:
    left, right = far_and_near((200, 450), (4, 12), NOTHING, 0)
    assert ps.match(left, left).verdict.startswith("both images are the same")
    assert "probably wrong" in ps.match(left, right).verdict


@pytest.mark.parametrize("preset", ["robust", "fast"])
def test_the_same_image_twice_is_not_trusted(preset: PresetName) -> None:
    left, _ = far_and_near((200, 450), (4, 12), NOTHING, 0)
    result = ps.match(left, left, preset=preset)
    assert result.summary.wrong >= 0.6
    assert [one.topic for one in result.findings if one.severity == "warning"] == ["match"]
    assert result.verdict.startswith("both images are the same")
    if result.confidence is not None:
        assert not result.trusted.any()
        assert np.nanmin(result.uncertainty) > 10


def test_a_pair_without_parallax_is_no_image_twice() -> None:
    search = found(*far_and_near((200, 450), (-0.3, 0.3), NOTHING, 0))
    assert not search.identical
    assert search.min_disparity <= 0 < search.min_disparity + search.num_disparities


def test_what_a_given_range_leaves_out_is_reported() -> None:
    thing = np.s_[100:150, 300:350]
    pair = far_and_near((380, 560), (4, 12), thing, 90)

    search = ps.match(*pair, num_disparities=24).search
    (place,) = search.left_out
    assert place.low <= 90 <= place.high
    assert abs(place.rows[0] - 100) <= 8
    assert abs(place.columns[1] - 350) <= 8

    told = ps.match(*pair, num_disparities=100).search
    assert told.left_out == ()


@pytest.mark.parametrize("count", [1, 2])
def test_few_candidates_have_confidences(count: int) -> None:
    scene = ndimage.gaussian_filter(noise(0), 1)  # as it is, it would be taken for noise
    left, right = scene[:, :-5], scene[:, 5:]  # disparity 5
    for preset in ("robust", "paper"):
        near = ps.match(left, right, min_disparity=5, num_disparities=count, preset=preset)
        far = ps.match(left, right, min_disparity=20, num_disparities=count, preset=preset)
        assert np.median(near.confidence) > 0.6
        assert np.median(far.confidence) < 0.2


@pytest.mark.parametrize(
    "pair",
    [
        (noise(0), noise(1)),
        (noise(0), np.zeros((80, 160), np.float32)),
        (noise(0, (30, 30)), noise(0, (30, 30))),
        (np.repeat(noise(0)[:, :1], 160, axis=1), np.repeat(noise(0)[:, :1], 160, axis=1)),
        (noise(0, (1, 1)), noise(0, (1, 1))),
    ],
)
def test_nothing_is_found_in_what_is_no_pair(pair: tuple[Plane, Plane]) -> None:
    assert estimated(*pair).search.origin == "default"

"""The suite "rigs": every fault is what its page says, the same every time."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage
from test_bench_cases import plant, run_middlebury

from phasestereo_bench.cases import SUITE_SCENES, SUITES, Case
from phasestereo_bench.datasets import Pair, find_scene, find_scenes
from phasestereo_bench.methods import Method
from phasestereo_bench.middlebury import matched_pair
from phasestereo_bench.rigs import FAULTS, QUICK_SCENES, RIGS, side_of
from phasestereo_bench.rigs.depth import DepthOfField, Raised, filled, seen_from_right
from phasestereo_bench.rigs.geometry import Misaligned

DOCS = Path(__file__).parents[2] / "docs"
PAGE = "suites.md"
ALL = {name: fault for faults in RIGS.values() for name, fault in faults.items()}
ROWS, COLS = 96, 128
ONE_SIDED = (
    "one noise 20",
    "dead columns",
    "one jpeg 30",
    "motion 30",
    "annulus 6 3",
    "annulus 6 4.5",
    "depth 4",
    *(name for name, fault in FAULTS.items() if fault.group == "light"),
    *["one h264 33", "over-exposed 1.6", "over-exposed 2.5", "near infrared"],
    *["half resolution", "third resolution"],
)
MOVED = [
    name
    for name, fault in ALL.items()
    if any(isinstance(step, Misaligned | Raised) for step in fault.steps)
]


def photograph(*, gray: bool = False) -> Pair:
    """Return a pair of smooth texture, its truth a slanted plane of 10 to 20 px."""
    rng = np.random.default_rng(5)
    texture = ndimage.gaussian_filter(rng.normal(0, 1, (ROWS, COLS, 3)), (2, 2, 0))
    right = np.clip(128 + 300 * texture, 0, 255).astype(np.uint8)

    truth = np.broadcast_to(np.linspace(10, 20, ROWS)[:, np.newaxis], (ROWS, COLS))
    y, x = np.mgrid[0:ROWS, 0:COLS].astype(float)

    left = np.stack(
        [
            ndimage.map_coordinates(plane, (y, x - truth), order=3)
            for plane in np.moveaxis(right, 2, 0)
        ],
        axis=2,
    )

    images = (left[..., 0], right[..., 0]) if gray else (left, right)
    mask = x >= truth
    masks = {"nonocc": mask, "all": mask}
    return Pair(
        "made", images[0].copy(), images[1].copy(), truth.astype(np.float32), None, masks, 32, None
    )


PAIR = photograph()


def same(one: Pair, other: Pair) -> bool:
    """Tell whether two pairs are the same to the bit."""
    images = np.array_equal(one.left, other.left) and np.array_equal(one.right, other.right)
    masks = all(np.array_equal(one.masks[name], other.masks[name]) for name in one.masks)
    return images and masks and np.array_equal(one.truth, other.truth)


# The registry


@pytest.mark.parametrize("suite", RIGS)
def test_the_page_defines_every_fault_and_shows_every_table(suite: str) -> None:
    page = (DOCS / PAGE).read_text("utf-8")
    defined = set(re.findall(r"(?<!`)`([^`\n]+)`(?!`)", page))
    assert set(RIGS[suite]) <= defined

    for group in {fault.group for fault in RIGS[suite].values()} - {"sharp"}:
        assert f"<!-- bench:rigs-{group} -->" in page
    count = len(set(RIGS[suite]) - {"sharp"})
    assert re.search(rf"\b{count} (more )?faults\b", page)
    assert SUITES[suite] is RIGS[suite]


def test_all_faults_differ_and_names_are_their_own() -> None:
    assert len(ALL) == sum(map(len, RIGS.values()))
    spoiled = [fault(PAIR, "left") for fault in ALL.values()]
    for number, one in enumerate(spoiled):
        assert not any(same(one, other) for other in spoiled[:number])
    assert all(name == fault.name for name, fault in ALL.items())
    assert same(FAULTS["sharp"](PAIR, "left"), PAIR)


def test_sides_alternate_over_the_scenes(data: Path) -> None:
    scenes = [s for s in find_scenes(data / "middlebury") if str(s) in SUITE_SCENES["rigs"]]
    sides = {str(scene): side_of(scene) for scene in scenes}
    assert sorted(sides.values()) == ["left"] * 6 + ["right"] * 6
    assert {sides[name] for name in QUICK_SCENES} == {"left", "right"}
    assert (sides["scenes2001/tsukuba"], sides["scenes2001/venus"]) == ("left", "right")
    assert set(sides) >= QUICK_SCENES


# All faults


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("name", ALL)
def test_faults_are_the_same_every_time_and_keep_shape_and_type(name: str, side: str) -> None:
    for pair in (PAIR, photograph(gray=True)):
        before = replace(pair, left=pair.left.copy(), right=pair.right.copy())
        one, again = ALL[name](pair, side), ALL[name](pair, side)
        assert same(one, again)
        assert same(pair, before)  # what it was given is not changed
        assert one.left.shape == one.right.shape == pair.left.shape
        assert one.left.dtype == one.right.dtype == np.uint8


@pytest.mark.parametrize("name", ALL)
def test_the_other_image_is_left_alone_where_one_is_worse(name: str) -> None:
    for side, other in (("left", "right"), ("right", "left")):
        spoiled = ALL[name](PAIR, side)
        alone = np.array_equal(getattr(spoiled, other), getattr(PAIR, other))
        changed = not np.array_equal(getattr(spoiled, side), getattr(PAIR, side))

        if name in ONE_SIDED:
            assert alone
            assert changed
        elif name not in MOVED and name != "sharp":
            assert changed
            assert not alone


def test_the_sums_of_the_documentation_are_those_of_the_suite(data: Path) -> None:
    scene = find_scene(data / "middlebury", "cones")
    pair, side = scene.load(), side_of(scene)

    _, *lines = (DOCS / "rigs-sums.csv").read_text("utf-8").splitlines()
    documented = {line.partition(",")[0]: line.partition(",")[2] for line in lines}
    assert set(documented) == set(FAULTS)

    for name, fault in FAULTS.items():
        if "jpeg" in name or name in ("webcam", "two phones"):
            continue  # codecs differ by a level

        spoiled = fault(pair, side)
        sums = [int(image.sum(dtype=np.int64)) for image in (spoiled.left, spoiled.right)]
        assert documented[name] == ",".join(map(str, [*sums, spoiled.masks["nonocc"].sum()]))


# Rows


@pytest.mark.parametrize(("side", "down"), [("right", 1), ("left", -1)])
def test_rows_move_by_whole_pixels_exactly(side: str, down: int) -> None:
    spoiled = FAULTS["rows 1"](PAIR, side)
    inner = slice(2, -2)
    np.testing.assert_array_equal(spoiled.right[inner], np.roll(PAIR.right, down, axis=0)[inner])
    np.testing.assert_array_equal(spoiled.left, PAIR.left)
    np.testing.assert_array_equal(spoiled.truth, PAIR.truth)
    lost = PAIR.masks["nonocc"] & ~spoiled.masks["nonocc"]
    assert set(np.nonzero(lost)[0]) == {ROWS - 1 if down > 0 else 0}


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("name", [n for n in MOVED if ALL[n].group == "rows"])
def test_the_truth_moves_with_the_image(name: str, side: str) -> None:
    spoiled, (step,) = FAULTS[name](PAIR, side), FAULTS[name].steps

    assert isinstance(step, Misaligned)

    y, x = np.mgrid[0:ROWS, 0:COLS].astype(float)
    before = x - PAIR.truth
    at_x, at_y = step.moved(before, y, (ROWS, COLS), 1.0 if side == "right" else -1.0)
    np.testing.assert_allclose(x - spoiled.truth, at_x, atol=1e-4)

    inside = spoiled.masks["nonocc"] & (at_x > 4) & (at_y > 4) & (at_y < ROWS - 5)
    inside &= (before > 4) & (at_x < COLS - 5)
    assert inside.mean() > 0.5

    shows = ndimage.map_coordinates(spoiled.right[..., 0].astype(float), (at_y, at_x), order=3)
    showed = ndimage.map_coordinates(PAIR.right[..., 0].astype(float), (y, before), order=3)
    assert (
        np.quantile(np.abs(shows - showed)[inside], 0.999) < 3
    )  # a level for each rounding, and clipping

    assert np.abs(at_y - y)[inside].max() > 0.1  # or nothing has moved
    assert spoiled.truth[spoiled.masks["nonocc"]].min() > 0
    assert spoiled.truth.max() < spoiled.num_disparities
    assert spoiled.num_disparities == PAIR.num_disparities + 2 * step.margin


def test_turns_are_clockwise_and_focal_lengths_enlarge() -> None:
    size, middle = (101, 201), np.array([[100.0]])
    right = np.array([[190.0]])

    _, y = Misaligned(turn=1).moved(right, np.array([[50.0]]), size)
    assert y.item() == pytest.approx(50 + 90 * np.sin(np.deg2rad(1)))

    x, y = Misaligned(focal=0.02).moved(right, np.array([[90.0]]), size)
    assert (x.item(), y.item()) == pytest.approx((100 + 90 * 1.02, 50 + 40 * 1.02))

    _, y = Misaligned(keystone=4).moved(np.array([[200.0]]), np.array([[100.0]]), size)
    assert y.item() == pytest.approx(104)

    x, _ = Misaligned(distortion=0.03).moved(np.array([[200.0]]), np.array([[50.0]]), size)
    assert x.item() == pytest.approx(100 + 100 * (1 + 0.03 * 100**2 / 201**2))

    x, _ = Misaligned(margin=8).moved(middle, middle / 2, size)
    assert x.item() == 92


# Sensors and codecs


def flat(level: int) -> Pair:
    """Return a pair of gray, large enough for statistics."""
    image = np.full((200, 300, 3), level, np.uint8)
    return replace(PAIR, left=image, right=image.copy(), truth=None, masks={})


def test_a_mosaic_keeps_colors_and_codecs_lose_more_at_higher_factors() -> None:
    colors = replace(flat(0), left=np.full((200, 300, 3), (200, 120, 40), np.uint8))
    mosaic = ALL["bayer noise 6"](colors, "left").left
    np.testing.assert_allclose(mosaic.mean(axis=(0, 1)), (200, 120, 40), atol=0.5)

    for codec in ("h264", "h265"):
        seen = [ALL[f"{codec} {crf}"](PAIR, "left").left.astype(float) for crf in (23, 28, 33)]
        lost = [np.abs(image - PAIR.left).mean() for image in seen]
        assert lost[0] < lost[1] < lost[2]


@pytest.mark.parametrize(
    "name", ["both barrel 0.2", "elastic", "raised 5%", "range -3..9", "near things"]
)
def test_the_truth_takes_the_right_image_to_the_left_one(name: str) -> None:
    spoiled = ALL[name](PAIR, "right")
    mask = spoiled.masks["nonocc"]
    assert mask.mean() > 0.6
    assert np.nanmax(spoiled.truth[mask]) < spoiled.num_disparities

    y, x = np.nonzero(mask)
    errors = []
    for off in (0, 2, -2):
        at = np.clip(np.rint(x - spoiled.truth[y, x] + off), 0, COLS - 1).astype(int)
        errors.append(np.abs(spoiled.left[y, x].astype(float) - spoiled.right[y, at]).mean())
    assert errors[0] < 0.5 * min(errors[1:])


def test_only_those_who_know_the_range_have_its_start_taken_off() -> None:
    pair = replace(ALL["range -3..9"](PAIR, "left"), left=PAIR.left)
    for told, start, shift in ((True, 0, 0), (False, -3, 3)):
        seen: list[NDArray[Any]] = []

        def match(left: Any, right: Any, _count: int, seen: Any = seen) -> NDArray[Any]:
            seen.append(right)
            return np.full(left.shape[:2], 4.0)

        found = matched_pair(Method("mine", match, told=told), pair)
        assert (found.disparity == 4 - start).all()
        np.testing.assert_array_equal(seen[0], np.roll(pair.right, shift, axis=1))


# Lenses and light


def test_maps_are_filled_from_behind() -> None:
    gap = np.nan
    rows = np.array([[gap, 9, gap, gap, 3, gap], [gap] * 6, [5, 5, 5, 5, 5, 5]])
    expected = [[9, 9, 3, 3, 3, 3], [5] * 6, [5] * 6]
    np.testing.assert_array_equal(filled(rows), expected)
    seen = seen_from_right(np.array([[0.0, 0, 0, 2, 0, 0]]))
    np.testing.assert_array_equal(seen, [[0, 2, 0, gap, 0, 0]])


def test_depth_blurs_what_is_not_in_focus() -> None:
    truth = np.full((ROWS, COLS), 10, np.float32)
    truth[: ROWS // 2] = 30

    pair = replace(PAIR, truth=truth)
    soft = DepthOfField(6)(pair, "left").left.astype(float)
    near, far = slice(8, ROWS // 2 - 12), slice(ROWS // 2 + 12, -8)

    change = np.abs(soft - PAIR.left)
    assert change[far].mean() < 1.5  # noise of one gray level
    assert change[near].mean() > 4

    both = DepthOfField(6, opposite=True)(pair, "left")
    assert np.abs(both.right.astype(float) - PAIR.right)[far].mean() > 4


def test_light_is_as_it_says() -> None:
    gray = flat(100)
    assert (FAULTS["inverted"](gray, "left").left == 155).all()

    dim = FAULTS["vignette"](gray, "left").left[..., 0].astype(float)
    assert (dim[100, 150], dim[0, 0]) == (100, 30)

    bright = FAULTS["clipped 20%"](PAIR, "left").left
    assert (bright == 255).mean() == pytest.approx(0.2, abs=0.02)

    assert FAULTS["haze"](gray, "left").left.max() > 190
    assert FAULTS["dirt"](gray, "left").left.min() < 60
    np.testing.assert_array_equal(FAULTS["rain"](gray, "left").left, gray.left)  # nothing to blur


# In the harness


def test_the_suite_runs_in_the_harness(tmp_path: Path) -> None:
    scene = find_scenes(plant(tmp_path, "one"))[0]
    names = ["sharp", "rows 1", "focal 2%"]

    records = run_middlebury([scene], ["fast"], names, suite="rigs", workers=0)
    assert [record["status"] for record in records] == ["ok"] * 3
    assert {record["side"] for record in records} == {"alternating"}
    assert [record["num_disparities"] for record in records] == [32, 32, 48]

    case = Case(scene, "rigs", "rows 1", "right")
    spoiled: NDArray[Any] = case.pair(true_blur=False).right
    np.testing.assert_array_equal(spoiled[1:], scene.load().right[:-1])

    with pytest.raises(ValueError, match="no true blur of 'rows 1'"):
        case.pair(true_blur=True)

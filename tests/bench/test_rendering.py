"""Rendered pairs: what is exact must be so, and the images must agree with it."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from phasestereo_bench.datasets import Pair
from phasestereo_bench.rendering import ROOMS, render_pair, render_room
from phasestereo_bench.rendering.camera import LEFT, RIGHT, Camera
from phasestereo_bench.rendering.casting import (
    cast,
    disparities,
    near_jumps,
    visible_in_both,
    windows,
)
from phasestereo_bench.rendering.light import Scenery
from phasestereo_bench.rendering.rooms import furnish_room
from phasestereo_bench.rendering.scenery import furnish
from phasestereo_bench.rendering.shapes import Ellipsoid, Frustum, Patch, Shape

SIZE = {"height": 121, "width": 163, "num_disparities": 40}


@pytest.fixture(scope="module")
def pair() -> Pair:
    return render_pair(2, **SIZE)


@pytest.fixture(scope="module")
def camera() -> Camera:
    return Camera(height=60, width=80, near=1.3, near_disparity=20.0)


@pytest.fixture(scope="module")
def scene(camera: Camera) -> Scenery:
    return furnish(np.random.default_rng(4), camera)


def away_from_jumps(truth: NDArray[np.float32], reach: int) -> NDArray[np.bool_]:
    steep = ndimage.maximum_filter(truth, 3) - ndimage.minimum_filter(truth, 3) > 1
    away: NDArray[np.bool_] = ~ndimage.maximum_filter(steep, 2 * reach + 1)
    return away


def warped(values: NDArray[Any], disparity: NDArray[np.float32]) -> NDArray[np.float64]:
    """Look up every row of the right view at x - d, between pixels linearly."""
    columns = np.arange(disparity.shape[1]) - disparity.astype(np.float64)
    left = np.clip(np.floor(columns).astype(int), 0, disparity.shape[1] - 2)
    rows, share = np.arange(disparity.shape[0])[:, None], columns - left
    if values.ndim == 3:
        share = share[..., None]
    result: NDArray[np.float64] = values[rows, left] * (1 - share) + values[rows, left + 1] * share
    return result


def test_shapes_types_and_ranges(pair: Pair) -> None:
    size = (SIZE["height"], SIZE["width"])
    assert pair.num_disparities == SIZE["num_disparities"]
    for image in (pair.left, pair.right):
        assert image.shape == (*size, 3)
        assert image.dtype == np.uint8

    for truth in (pair.truth, pair.truth_right):
        assert truth.shape == size
        assert truth.dtype == np.float32
        assert truth.min() > 1
        assert truth.max() <= SIZE["num_disparities"] - 2

    assert set(pair.masks) == {"nonocc", "all", "disc"}
    assert all(mask.shape == size and mask.dtype == bool for mask in pair.masks.values())
    assert pair.masks["all"].all()
    assert not (pair.masks["disc"] & ~pair.masks["nonocc"]).any()


def test_same_seed_same_bits_other_seed_other_scene(pair: Pair) -> None:
    again, other = render_pair(2, **SIZE), render_pair(3, **SIZE)
    for name in ("left", "right", "truth", "truth_right"):
        np.testing.assert_array_equal(getattr(again, name), getattr(pair, name))

    for name, mask in pair.masks.items():
        np.testing.assert_array_equal(again.masks[name], mask)

    assert (abs(other.truth - pair.truth) > 1).mean() > 0.1


def test_warping_by_the_truth_gives_the_left_image_where_both_see_it(pair: Pair) -> None:

    residual = abs(warped(pair.right, pair.truth) - pair.left).mean(axis=2)
    smooth = away_from_jumps(pair.truth, 2)
    seen = pair.masks["nonocc"] & smooth
    inside = np.arange(pair.truth.shape[1]) - pair.truth >= 0
    hidden = ~pair.masks["nonocc"] & inside

    wrong = abs(warped(pair.right, pair.truth + 3) - pair.left).mean(axis=2)
    assert np.median(residual[seen]) < 3  # noise of both, and bilinear look-up
    assert np.median(wrong[seen]) > 2 * np.median(residual[seen])
    assert np.median(residual[hidden]) > 4 * np.median(residual[seen])


def test_both_truths_pass_the_cross_check(pair: Pair) -> None:
    smooth = away_from_jumps(pair.truth, 1) & pair.masks["nonocc"]
    smooth &= warped(away_from_jumps(pair.truth_right, 1).astype(float), pair.truth) == 1

    back = warped(pair.truth_right, pair.truth)
    assert smooth.mean() > 0.5

    difference = abs(back - pair.truth)[smooth]
    assert (difference < 0.05).mean() > 0.99
    assert difference.max() < 0.6


def test_depths_follow_from_the_calibration(pair: Pair, camera: Camera) -> None:

    depth = pair.calibration.depth(pair.truth)
    assert pair.calibration.ndisp == SIZE["num_disparities"]
    assert 1000 < depth.min() < 1500  # the floor at the lower edge, in mm
    assert depth.max() < 25_000
    # The floor at the lower edge in the middle, by hand: eye height over the ray's fall.
    focal = pair.calibration.focal
    down = (SIZE["height"] - 1) / 2 / focal
    fall = down * np.cos(camera.pitch) + np.sin(camera.pitch)
    assert depth[-1, 81] == pytest.approx(1000 * camera.eye / fall, rel=1e-4)


def facing(camera: Camera, depth: float, columns: list[float], rows: list[float]) -> Patch:
    """Return a card parallel to the image between columns and rows of the left view."""
    x = depth * (np.array(columns) - (camera.width - 1) / 2) / camera.focal
    cos, sin = float(np.cos(camera.pitch)), float(np.sin(camera.pitch))
    down = depth * (np.array(rows) - (camera.height - 1) / 2) / camera.focal
    middle = float(down.mean())
    center = (
        float(x.mean()),
        camera.eye - middle * cos - depth * sin,
        depth * cos - middle * sin,
    )

    up = (0.0, -cos, -sin)
    return Patch(center, (1.0, 0.0, 0.0), up, float(np.ptp(x)) / 2, float(np.ptp(down)) / 2)


def test_mask_and_truth_of_a_card_before_a_wall_by_hand() -> None:
    camera = Camera(height=24, width=40, near=1.0, near_disparity=10.0)
    wall = facing(camera, 2.5, [-100, 200], [-100, 200])  # disparity 4
    card = facing(camera, 1.0, [19.5, 29.5], [9.5, 15.5])  # disparity 10
    truth = disparities([wall, card], camera, LEFT)

    expected = np.full((24, 40), 4.0)
    expected[10:16, 20:30] = 10
    np.testing.assert_allclose(truth, expected, rtol=1e-12)
    # On the right the card hides columns 10 to 19, which the wall has at 14 to 23 on the left.
    visible = np.ones((24, 40), dtype=bool)
    visible[:, :4] = False
    visible[10:16, 14:20] = False
    np.testing.assert_array_equal(visible_in_both([wall, card], camera, truth), visible)

    expected_right = np.full((24, 40), 4.0)
    expected_right[10:16, 10:20] = 10
    np.testing.assert_allclose(disparities([wall, card], camera, RIGHT), expected_right)


def test_disc_reaches_four_pixels_either_side_of_a_jump() -> None:
    truth = np.full((9, 24), 5.0)
    truth[:, 10:] = 7.5
    columns = np.flatnonzero(near_jumps(truth)[4])
    np.testing.assert_array_equal(columns, np.arange(6, 14))
    assert near_jumps(truth.T)[6:14].all()
    assert not near_jumps(np.where(truth > 6, 7.0, 5.0)).any()  # 2 px is not more than 2 px


SHAPES: list[Shape] = [
    Patch((0.1, 0.5, 2.0), (0.8, 0.0, 0.6), (0.0, -1.0, 0.0), 0.4, 0.2),
    Patch((0.1, 0.4, 2.0), (1.0, 0.0, 0.0), (0.0, 0.6, -0.8), 0.4, 0.2, "ellipse"),
    Patch((-0.2, 0.5, 1.5), (0.6, 0.8, 0.0), (0.8, -0.6, 0.0), 0.3, 0.1, "leaf"),
    Ellipsoid((0.1, 0.4, 2.0), (0.3, 0.2, 0.4)),
    Frustum((-0.1, 0.0, 2.2), 0.7, 0.2, 0.3),
]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
@pytest.mark.parametrize("side", [LEFT, RIGHT])
def test_windows_miss_nothing_that_is_seen(shape: Shape, side: int, camera: Camera) -> None:
    x, y = np.arange(80.0)[None], np.arange(60.0)[:, None]
    rays, everywhere = camera.rays(x, y, side), [(0, 60, 0, 80)]

    whole, _ = cast([shape], rays, everywhere, 0)
    bounded, _ = cast([shape], rays, windows([shape], camera, side), 0)
    assert np.isfinite(whole).sum() > 50
    np.testing.assert_array_equal(bounded, whole)

    x, y, z = rays.at(np.where(np.isfinite(whole), whole, 1))
    low, high = shape.corners().min(axis=0) - 1e-6, shape.corners().max(axis=0) + 1e-6
    points = np.stack([x, y, z], axis=-1)[np.isfinite(whole)]
    assert ((points >= low) & (points <= high)).all()


@pytest.mark.parametrize(
    ("seed", "size"), [(0, (16, 16, 8)), (1, (33, 90, 45)), (2, (140, 40, 16))]
)
def test_every_size_renders_within_its_range(seed: int, size: tuple[int, int, int]) -> None:
    height, width, count = size
    result = render_pair(seed, height=height, width=width, num_disparities=count)
    assert result.left.shape == (height, width, 3)
    assert result.truth.min() > 0
    assert result.truth.max() <= count - 2


# Rooms


@pytest.fixture(scope="module", params=ROOMS)
def room(request: pytest.FixtureRequest) -> Pair:
    return render_room(3, request.param, height=150, width=200)


def test_a_table_top_has_the_disparities_of_its_plane() -> None:
    pair = render_room(5, "table", height=120, width=160)

    # The table is at height 0: a ray that falls by `fall` a unit of depth meets it at eye / fall.
    (scene_seed, *_) = np.random.SeedSequence([5, ROOMS.index("table")]).spawn(3)
    made = furnish_room(np.random.default_rng(scene_seed), "table")
    focal, baseline = pair.calibration.focal, pair.calibration.baseline / 1000
    down = (np.arange(120) - 59.5) / focal
    fall = down * np.cos(made.pitch) + np.sin(made.pitch)
    plane = np.repeat((focal * baseline * fall / made.eye)[:, None], 160, axis=1)

    on_table = abs(pair.truth - plane) < 1e-4
    assert on_table[-1].all()
    assert on_table.mean() > 0.5
    np.testing.assert_allclose(np.diff(plane, n=2, axis=0), 0, atol=1e-12)
    # All else on the lower half stands on it, so it is nearer.
    assert (pair.truth > plane - 1e-4)[60:].all()


def test_the_views_of_a_room_fit_by_its_truth(room: Pair) -> None:
    assert room.truth.max() <= room.num_disparities - 1

    smooth = away_from_jumps(room.truth, 1) & room.masks["nonocc"]
    smooth &= warped(away_from_jumps(room.truth_right, 1).astype(float), room.truth) == 1
    assert smooth.mean() > 0.5
    difference = abs(warped(room.truth_right, room.truth) - room.truth)[smooth]
    assert (difference < 0.05).mean() > 0.98

    # Plain surfaces look alike everywhere, so only pixels with texture count.
    gray = room.left.astype(float).mean(axis=2)
    steep = abs(np.gradient(ndimage.gaussian_filter(gray, 1), axis=1)) > 4
    residual, wrong = (
        abs(warped(room.right, room.truth + shift) - room.left).mean(axis=2) for shift in (0, 2)
    )
    assert np.median(residual[smooth]) < 2.5
    assert (smooth & steep).sum() > 30
    assert np.median(wrong[smooth & steep]) > 2 * np.median(residual[smooth & steep])


def test_a_room_has_the_noise_that_is_asked_for_and_the_bits_of_its_seed() -> None:
    clean, noisy, again = (
        render_room(0, "curved", height=60, width=80, noise=noise) for noise in (0, 3, 3)
    )
    difference = noisy.left.astype(float) - clean.left
    assert difference.std() == pytest.approx(np.sqrt(9 + 1 / 12), rel=0.05)
    np.testing.assert_array_equal(noisy.left, again.left)
    np.testing.assert_array_equal(noisy.right, again.right)

    other = render_room(1, "curved", height=60, width=80)
    assert (abs(other.truth - clean.truth) > 1).mean() > 0.1


def test_most_of_a_room_is_plain_and_curved_things_are_marked(room: Pair) -> None:
    gray = room.left.astype(float).mean(axis=2)
    rough = ndimage.generic_filter(gray, np.std, 3)
    assert (rough < 3).mean() > 0.6

    # Disparities of a plane have no second differences, those of a ball or a cylinder have.
    bend = np.zeros(room.truth.shape)
    bend[:, 1:-1] = abs(np.diff(room.truth.astype(float), n=2, axis=1))
    curved, inner = room.masks["curved"], away_from_jumps(room.truth, 2)
    assert not (curved & ~room.masks["nonocc"]).any()
    assert (bend[inner & room.masks["nonocc"] & ~curved] < 1e-3).mean() > 0.95
    if room.name.startswith("curved"):
        assert (bend[inner & curved] > 1e-3).mean() > 0.6


@pytest.mark.parametrize(
    ("render", "arguments", "error", "name"),
    [
        (render_pair, {"seed": -1}, ValueError, "seed"),
        (render_pair, {"seed": 1.5}, TypeError, "seed"),
        (render_pair, {"seed": True}, TypeError, "seed"),
        (render_pair, {"height": 15}, ValueError, "height"),
        (render_pair, {"height": 10_000}, ValueError, "height"),
        (render_pair, {"width": "480"}, TypeError, "width"),
        (render_pair, {"width": 0}, ValueError, "width"),
        (render_pair, {"num_disparities": 7}, ValueError, "num_disparities"),
        (render_pair, {"num_disparities": 241}, ValueError, "num_disparities"),
        (render_pair, {"num_disparities": None}, TypeError, "num_disparities"),
        (render_room, {"seed": -1}, ValueError, "seed"),
        (
            render_room,
            {"kind": "cellar"},
            ValueError,
            "kind: got 'cellar'; accepts table, room",
        ),
        (render_room, {"height": 15}, ValueError, "height"),
        (render_room, {"width": 9000}, ValueError, "width"),
        (render_room, {"noise": -1}, ValueError, "noise"),
        (render_room, {"noise": float("nan")}, ValueError, "noise"),
        (render_room, {"noise": "much"}, TypeError, "noise"),
    ],
)
def test_arguments_are_checked(
    render: Any, arguments: dict[str, Any], error: type[Exception], name: str
) -> None:
    with pytest.raises(error, match=name):
        render(**arguments)

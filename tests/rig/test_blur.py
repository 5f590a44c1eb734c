"""The estimation of relative blur: as the oracle has it, and as it was made."""

from __future__ import annotations

import pickle
import sys
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo_bench.degradation import Degradation, disk_psf, gaussian_psf, motion_psf, suite
from phasestereo_bench.rigs.suite import FAULTS
from support import oracle, oracle_blur

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from phasestereo_bench.datasets import Pair

    Image = NDArray[np.uint8]

for module in ("scipy", "PIL"):
    pytest.importorskip(module)

SIZE, SHIFT, COUNT = (160, 224), 6, 16


@cache
def scene(shift: int = 0) -> Image:
    """Return squares of many sizes, seen from the left or, moved, from the right."""
    rng = np.random.default_rng(7)
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    image = np.zeros(SIZE)
    for side, weight in ((13, 0.3), (7, 0.25), (4, 0.2), (2, 0.15), (1, 0.1)):
        image += weight * rng.integers(0, 256, (200, 260))[y // side, (x + shift) // side]
    return np.rint(image).astype(np.uint8)


def shots(psf: NDArray[np.float64] | None, side: str = "left") -> tuple[Image, Image]:
    """Return the scene from both sides, of which one is blurred, with a little noise."""
    recipes = {name: Degradation(psf if name == side else None, noise=1) for name in SIDES}
    return recipes["left"](scene()), recipes["right"](scene(SHIFT))


SIDES = "left", "right"
SCENES = ("tsukuba", "cones", "Art", "Lampshade1", "Motorcycle", "Piano")


def arc(length: int, turn: float) -> NDArray[np.float64]:
    """Return the kernel of a shake along a circle, by this many degrees."""
    steps = np.linspace(-0.5, 0.5, 16 * length + 1)
    angle = np.deg2rad(turn) * steps
    y, x = (
        np.cumsum(part) * (length - 1) / (16 * length) for part in (np.sin(angle), np.cos(angle))
    )

    reach = length // 2 + 1
    kernel: NDArray[np.float64] = np.zeros((2 * reach + 1, 2 * reach + 1))

    for down, along in zip(y - y.mean() + reach, x - x.mean() + reach, strict=True):
        top, left = int(down), int(along)
        fy, fx = down - top, along - left
        kernel[top : top + 2, left : left + 2] += np.outer((1 - fy, fy), (1 - fx, fx))

    normal: NDArray[np.float64] = kernel / kernel.sum()
    return normal


def likeness(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Return the best correlation of two kernels, which may be a pixel apart."""
    side = max(a.shape[0], b.shape[0])
    one, other = (np.pad(each, (side - each.shape[0]) // 2 + 1) for each in (a, b))
    moves = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
    products = [(one * np.roll(other, move, (0, 1))).sum() for move in moves]
    return float(max(products) / np.sqrt((one**2).sum() * (other**2).sum()))


def load(data: Path, name: str) -> Pair:
    from phasestereo_bench.datasets import find_scene  # noqa: PLC0415  # needs Pillow, which may be missing

    return find_scene(data / "middlebury", name).load()


# As the oracle has it


def agree(found: ps.BlurEstimate, expected: oracle_blur.Estimate) -> None:
    blurs = [(blur.side, blur.kind) for blur in found.blurs]
    assert blurs == [(kind.side, kind.psf[0]) for kind in expected.kinds]

    for blur, kind in zip(found.blurs, expected.kinds, strict=True):
        assert blur.size == pytest.approx(kind.psf[1], rel=0.02)
        assert blur.angle == pytest.approx(kind.psf[2], abs=1)
        assert (blur.other is None) is (kind.other is None)
        if blur.other is not None and kind.other is not None:
            assert {blur.side, blur.other.side} == {"left", "right"}
            assert blur.other.kind == kind.other[0]
            assert blur.other.size == pytest.approx(kind.other[1], rel=0.02)
        if kind.psf[0] == "other":
            assert kind.kernel is not None
            assert blur.psf is not None
            np.testing.assert_allclose(blur.psf, kind.kernel, atol=2e-3)

    assert (found.tile, found.labels.shape) == (expected.tile, expected.labels.shape)
    assert np.mean(found.labels == expected.labels) >= 0.97

    assert found.certainty == pytest.approx(expected.certainty, abs=0.01)
    assert found.contrast == pytest.approx(expected.contrast, rel=0.01)
    assert found.noise == pytest.approx(expected.noise, rel=0.01)


@pytest.mark.parametrize(
    ("name", "row", "side"),
    [
        ("tsukuba", "sharp", "left"),
        ("tsukuba", "mixed", "left"),
        ("tsukuba", "motion 15", "right"),
        ("venus", "disk 6", "left"),
        ("venus", "contrast 1.5 0.6", "right"),
        ("cones", "gauss 2", "right"),
    ],
)
def test_real_pairs_are_as_the_oracle_has_them(data: Path, name: str, row: str, side: str) -> None:
    pair = load(data, name)
    images = {"left": pair.left, "right": pair.right}
    images[side] = suite()[row](images[side])

    search = (0, pair.num_disparities)
    found = ps.estimate_blur(images["left"], images["right"], num_disparities=search[1])

    agree(
        found,
        oracle_blur.estimate(oracle_blur.scene_of(images["left"], images["right"], search=search)),
    )


@pytest.mark.parametrize(
    ("name", "row", "side"), [("cones", "depth 8 opposite", "left"), ("venus", "depth 4", "right")]
)
def test_blur_that_follows_depth_is_as_the_oracle_has_it(
    data: Path, name: str, row: str, side: str
) -> None:
    pair = FAULTS[row](load(data, name), side)
    search = (0, pair.num_disparities)
    found = ps.estimate_blur(pair.left, pair.right, num_disparities=search[1])
    expected = oracle_blur.estimate(oracle_blur.scene_of(pair.left, pair.right, search=search))

    signs = {"left": 1, "none": 0, "right": -1}
    radii = np.array([signs[blur.side] * blur.size for blur in found.blurs])[found.labels]
    others = np.array([signs[kind.side] * kind.psf[1] for kind in expected.kinds])
    assert len(found.blurs) >= 3
    assert {blur.kind for blur in found.blurs} <= {"disk", "none"}
    # The maps by which blocks are found differ a little, and so do the blocks.
    assert np.mean(np.abs(radii - others[expected.labels])) < 0.5
    assert found.contrast == pytest.approx(expected.contrast, rel=0.1)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("psf", [None, gaussian_psf(1.7), motion_psf(12, 37), arc(15, 270)])
def test_made_pairs_are_as_the_oracle_has_them(psf: NDArray[np.float64] | None, side: str) -> None:
    images = shots(psf, side)
    # A kernel whose middle lies above or below its center shifts an image, which rows would follow.
    found = ps.match(*images, num_disparities=COUNT, align_rows=False).blur
    assert found is not None
    agree(found, oracle_blur.estimate(oracle_blur.scene_of(*images, search=(0, COUNT))))


@pytest.mark.parametrize(
    ("left", "right"),
    [
        (motion_psf(15, 0), motion_psf(15, 90)),
        (motion_psf(11, 45), disk_psf(3)),
        (disk_psf(3), disk_psf(5)),
    ],
)
def test_blurs_of_both_images_are_as_the_oracle_has_them(
    left: NDArray[np.float64], right: NDArray[np.float64]
) -> None:
    # Noise of their own: what is the same in both would be subtracted.
    others = Degradation(right, noise=1, seed=1)(scene(SHIFT))
    images = shots(left)[0], others
    found = ps.match(*images, num_disparities=COUNT, align_rows=False)
    assert found.blur is not None
    agree(found.blur, oracle_blur.estimate(oracle_blur.scene_of(*images, search=(0, COUNT))))

    # Each image is convolved with what it lacks.
    blur = found.blur.blur
    assert blur.other is not None
    compensation = found.blur_compensation
    assert compensation is not None
    (for_left, for_right), *more = compensation.kernels
    assert not more
    own, other = (for_right, for_left) if blur.side == "left" else (for_left, for_right)
    for kernel, psf in ((own, blur.psf), (other, blur.other.psf)):
        assert kernel is not None
        assert psf is not None
        np.testing.assert_allclose(np.asarray(kernel), psf, atol=1e-6)


@pytest.mark.parametrize("name", SCENES)
def test_two_shakes_along_different_ways_are_told_apart(data: Path, name: str) -> None:
    pair = load(data, name)
    left = Degradation(motion_psf(15, 0), noise=1, seed=1)(pair.left)
    right = Degradation(motion_psf(15, 90), noise=1, seed=2)(pair.right)
    found = ps.estimate_blur(left, right, num_disparities=pair.num_disparities)

    assert len(found.blurs) == 1
    assert found.blur.other is not None
    both = {str(blur.side): blur for blur in (found.blur, found.blur.other)}
    assert [both[side].kind for side in SIDES] == ["motion", "motion"]
    assert [both[side].size for side in SIDES] == pytest.approx([15, 15], abs=3)
    assert abs((both["left"].angle + 90) % 180 - 90) <= 3
    assert abs(both["right"].angle - 90) <= 3


def test_masks_and_other_searches_are_as_the_oracle_has_them() -> None:
    rng = np.random.default_rng(1)
    right, left = shots(disk_psf(3))  # seen the other way round: disparities are negative

    masks = rng.random((2, *SIZE)) > 0.03
    masks[0, :30] = masks[1, :, 200:] = False
    search = (-15, 17)

    found = ps.estimate_blur(
        *(left, right),
        min_disparity=search[0],
        num_disparities=search[1],
        left_mask=masks[0],
        right_mask=masks[1],
    )

    known = oracle_blur.scene_of(left, right, search=search, masks=(masks[0], masks[1]))
    agree(found, oracle_blur.estimate(known))
    assert found.blur.side == "right"


# As it was made


def trial(data: Path, name: str, blur: tuple[str, float, float], *, side: str, noise: float) -> Any:
    from phasestereo_bench import blur as bench  # noqa: PLC0415  # needs Pillow, which may be missing
    from phasestereo_bench.datasets import find_scene  # noqa: PLC0415  # likewise

    family, size, angle = blur

    tried = bench.BlurTrial(find_scene(data / "middlebury", name), family, size, angle, side, noise)

    key = {"family": family, "size": size, "angle": angle, "side": side}
    record = key | bench.try_out(tried)
    return bench.verdict(record), record


@pytest.mark.parametrize(
    ("name", "blur", "side", "noise"),
    [
        ("tsukuba", ("gaussian", 1.0, 0.0), "left", 2.0),
        ("Aloe", ("gaussian", 4.0, 0.0), "right", 1.0),
        ("Rocks1", ("gaussian", 2.0, 0.0), "right", 2.0),
        ("venus", ("disk", 2.0, 0.0), "right", 1.0),
        ("Lampshade1", ("disk", 4.0, 0.0), "left", 2.0),
        ("Art", ("disk", 8.0, 0.0), "right", 1.0),
        ("Baby1", ("motion", 5.0, 135.0), "left", 2.0),
        ("cones", ("motion", 9.0, 22.0), "right", 1.0),
        ("Moebius", ("motion", 13.0, 67.0), "left", 1.0),
        ("Aloe", ("motion", 21.0, 160.0), "left", 2.0),
    ],
)
def test_known_blurs_are_found(
    data: Path, name: str, blur: tuple[str, float, float], side: str, noise: float
) -> None:
    judged, record = trial(data, name, blur, side=side, noise=noise)
    assert judged.all, record


@pytest.mark.parametrize("name", SCENES)
def test_sharp_pairs_have_none(data: Path, name: str) -> None:
    judged, record = trial(data, name, ("none", 0.0, 0.0), side="neither", noise=0.0)
    assert judged.all, record


@pytest.mark.parametrize("name", SCENES[:4])
@pytest.mark.parametrize("blur", [("gaussian", 3.0, 0.0), ("motion", 9.0, 0.0)])
def test_pairs_that_are_equally_soft_have_none(
    data: Path, name: str, blur: tuple[str, float, float]
) -> None:
    judged, record = trial(data, name, blur, side="both", noise=1.0)
    assert judged.all, record


@pytest.mark.parametrize("name", ["tsukuba", "cones", "Aloe"])
def test_areas_are_where_they_are(data: Path, name: str) -> None:
    pair = load(data, name)
    left = suite()["mixed"](pair.left)
    found = ps.estimate_blur(left, pair.right, num_disparities=pair.num_disparities)

    kinds = {blur.kind for blur in found.blurs}
    assert kinds == {"none", "motion", "disk"}
    assert {blur.side for blur in found.blurs if blur.kind != "none"} == {"left"}

    rows, cols = left.shape[:2]
    y, x = np.ogrid[:rows, :cols]
    truth = np.array(["none", "motion", "none", "disk"])[(4 * y // rows + 4 * x // cols) % 4]

    names = np.array([blur.kind for blur in found.blurs])
    drawn = oracle.class_map(found.labels, found.tile, (rows, cols))
    assert np.mean(names[drawn] == truth) > 0.75

    assert found.areas() == pytest.approx(
        [np.mean(found.labels == n) for n in range(len(found.blurs))]
    )
    assert sum(found.areas()) == pytest.approx(1)
    assert found.areas() == tuple(sorted(found.areas(), reverse=True))


@pytest.mark.parametrize("name", ["cones", "Aloe"])
@pytest.mark.parametrize("side", SIDES)
def test_a_curved_path_is_measured(data: Path, name: str, side: str) -> None:
    pair, kernel = load(data, name), arc(15, 270)
    images = {"left": pair.left, "right": pair.right}
    images[side] = Degradation(kernel, noise=1)(images[side])

    found = ps.estimate_blur(
        images["left"], images["right"], num_disparities=pair.num_disparities
    ).blur

    assert (found.side, found.kind, found.angle) == (side, "other", 0)
    assert found.psf is not None
    assert found.psf.sum() == pytest.approx(1)
    assert found.size == pytest.approx(oracle_blur.radius(found.psf))

    assert likeness(found.psf, kernel) > 0.8
    assert likeness(found.psf, kernel) > likeness(found.psf, kernel[::-1, ::-1]) + 0.2


# What is found


@pytest.mark.parametrize(
    ("kind", "sizes"), [("gaussian", (1.3, 3.1)), ("disk", (2.6, 5.2)), ("motion", (7.7, 14))]
)
def test_the_kernel_is_that_of_the_size(kind: str, sizes: tuple[float, ...]) -> None:
    makers: dict[str, Any] = {
        "gaussian": lambda size, _: gaussian_psf(size),
        "disk": lambda size, _: disk_psf(size),
        "motion": motion_psf,
    }

    for size in sizes:
        angle = 25 if kind == "motion" else 0
        blur = ps.estimate_blur(*shots(makers[kind](size, angle)), num_disparities=COUNT).blur
        assert blur.kind == kind
        assert blur.psf is not None
        assert blur.psf.dtype == np.float64

        wanted = makers[kind](blur.size, blur.angle)
        inner, outer = sorted((blur.psf, wanted), key=len)
        margin = (len(outer) - len(inner)) // 2
        np.testing.assert_allclose(np.pad(inner, margin), outer, atol=1e-6)


def test_an_estimate_tells_itself() -> None:
    found = ps.estimate_blur(*shots(motion_psf(11, 30)), num_disparities=COUNT)
    assert found.blur is found.blurs[0]

    assert repr(found.blur).startswith("<Blur: left, motion 1")
    assert repr(found.blur).endswith(" px at 30 degrees>")
    assert found.labels.dtype == np.uint8
    assert (found.labels.tolist(), found.areas()) == ([[0]], (1.0,))
    assert found.tile >= max(SIZE)

    none = ps.estimate_blur(*shots(None), num_disparities=COUNT).blur
    assert (none.side, none.kind, none.size, none.angle, none.psf) == ("none", "none", 0, 0, None)
    assert repr(none) == "<Blur: none>"

    copy = pickle.loads(pickle.dumps(found))  # noqa: S301  # our own
    assert (copy.blur.size, copy.noise) == (found.blur.size, found.noise)


def test_by_default_a_third_of_the_width_is_searched() -> None:
    images = shots(disk_psf(3))
    third = -(-SIZE[1] // 3)
    estimates = [ps.estimate_blur(*images, **kwargs) for kwargs in ({}, {"num_disparities": third})]
    assert estimates[0].noise == estimates[1].noise
    assert estimates[0].blur.size == estimates[1].blur.size


def crossings(call: Callable[[], ps.Result]) -> tuple[list[str], ps.Result]:
    """Return the functions of the core that are called meanwhile, without checks of values."""
    seen: list[str] = []

    def note(_: object, event: str, function: object) -> None:
        if event == "c_call" and getattr(function, "__module__", None) == "phasestereo._core":
            seen.append(getattr(function, "__name__", ""))

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        result = call()
    finally:
        sys.setprofile(before)
    return [name for name in seen if not name.startswith("check_")], result


@pytest.mark.parametrize("psf", [None, disk_psf(3)], ids=["sharp", "blurred"])
def test_a_default_match_is_one_call_of_the_core(psf: NDArray[np.float64] | None) -> None:
    left, right = shots(psf)
    seen, result = crossings(lambda: ps.match(left, right))
    assert seen == ["match_pair"]
    assert result.blur is not None
    assert (result.blur.blur.kind == "none") is (psf is None)

    matcher = ps.Matcher()
    assert crossings(lambda: matcher.match(left, right, num_disparities=48))[0] == ["match_pair"]


def test_what_the_core_found_cannot_be_written_to() -> None:
    result = ps.match(*shots(disk_psf(4)))
    compensation = result.blur_compensation
    assert compensation is not None
    assert result.settings.neighborhood > ps.Settings().neighborhood
    with pytest.raises(ValueError, match="read-only"):
        compensation.labels[0, 0] = 1


def test_the_number_of_threads_changes_nothing() -> None:
    images = shots(arc(15, 270))
    one, four = (ps.estimate_blur(*images, num_disparities=COUNT, threads=n) for n in (1, 4))
    assert (one.certainty, one.contrast, one.noise) == (four.certainty, four.contrast, four.noise)
    assert one.blur.psf is not None
    np.testing.assert_array_equal(one.blur.psf, four.blur.psf)


GOOD = scene()


@pytest.mark.parametrize(
    ("arguments", "options", "error", "message"),
    [
        (("x", GOOD), {}, FileNotFoundError, "[Errno 2] No such file"),
        ((GOOD, GOOD[:9, :9]), {}, ValueError, "right: got"),
        ((GOOD[0], GOOD[0]), {}, ValueError, "left: got shape"),
        ((GOOD.astype(complex), GOOD), {}, TypeError, "left: got dtype complex128"),
        ((GOOD, GOOD), {"num_disparities": 0}, ValueError, "num_disparities: got 0"),
        ((GOOD, GOOD), {"num_disparities": 1.5}, TypeError, "num_disparities: got float"),
        ((GOOD, GOOD), {"num_disparities": 225}, ValueError, "num_disparities: got 225"),
        ((GOOD, GOOD), {"min_disparity": 10**9}, ValueError, "min_disparity: got 1000000000"),
        ((GOOD, GOOD), {"min_disparity": "0"}, TypeError, "min_disparity: got str"),
        ((GOOD, GOOD), {"threads": 0}, ValueError, "threads: got 0"),
        ((GOOD, GOOD), {"left_mask": np.ones(3, bool)}, ValueError, "left_mask: got shape"),
        ((GOOD, GOOD), {"right_mask": np.ones(SIZE)}, TypeError, "right_mask: got dtype float64"),
        (
            (np.full(SIZE, np.inf, np.float32), GOOD.astype(np.float32)),
            {},
            ValueError,
            "left: got inf",
        ),
    ],
)
def test_what_is_refused(
    arguments: tuple[Any, Any], options: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error) as raised:
        ps.estimate_blur(*arguments, **options)
    assert str(raised.value).startswith(message)

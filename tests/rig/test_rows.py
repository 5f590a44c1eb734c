"""Told nothing: rows are straightened, ranges found, and what went wrong is said."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy import ndimage

import phasestereo as ps
import phasestereo_large as large
from phasestereo.metrics import bad_pixels
from phasestereo.rig.findings import untrusted
from phasestereo_bench import degradation
from phasestereo_bench.datasets import find_scene
from phasestereo_bench.rigs.geometry import Misaligned
from phasestereo_large import bands
from support.estimating import estimated
from support.warping import moved

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from phasestereo_bench.datasets import Pair

SCENES = "tsukuba", "cones"


@pytest.fixture(scope="module")
def load(data: Path) -> Callable[[str], Pair]:
    """Return a function that loads a scene."""
    return lambda name: find_scene(data / "middlebury", name).load()


def bad(pair: Pair, result: ps.Result) -> float:
    assert pair.truth is not None
    return bad_pixels(result.disparity, pair.truth, 1.0, mask=pair.masks["nonocc"])


def lowered(image: NDArray[np.uint8], **how: float) -> NDArray[np.uint8]:
    channels = [moved(image[..., c].astype(np.float32), **how) for c in range(3)]
    lowered: NDArray[np.uint8] = np.rint(np.stack(channels, 2)).clip(0, 255).astype(np.uint8)
    return lowered


def grave(result: ps.Result) -> list[str]:
    return [found.topic for found in untrusted(result.findings)]


def assert_same(one: ps.Result, other: ps.Result) -> None:
    np.testing.assert_array_equal(one.disparity, other.disparity)
    np.testing.assert_array_equal(one.flags, other.flags)
    np.testing.assert_array_equal(one.confidence, other.confidence)


# --- rows ---


def of_even_rows(image: NDArray[Any]) -> NDArray[Any]:
    """Return the even rows, and between two of them their mean, rounded down."""
    merged = image.copy()
    for y in range(1, len(image), 2):
        below = min(y + 1, len(image) - 2 + len(image) % 2)
        if image.dtype == bool:
            merged[y] = image[y - 1] & image[below]
        else:
            both = image[y - 1].astype(float) + image[below]
            merged[y] = both // 2 if image.dtype.kind == "u" else both / 2
    return merged


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("sides", [(0, 3), (-2, 0), (3, 3)])
def test_of_interlaced_images_the_even_rows_are_matched(
    load: Callable[[str], Pair], dtype: type[Any], sides: tuple[int, int]
) -> None:
    pair = load("cones")
    rows = pair.left.shape[0] - (dtype is np.uint16)  # even, and odd
    images, masks, expected, expected_masks = [], [], [], []
    for image, shift in zip((pair.left, pair.right), sides, strict=True):
        # Gray, whose means are rounded as here. Floats that are multiples of a step would be taken
        # for bytes.
        gray = image[:rows, :, 1]
        fields = (np.sqrt(gray) if dtype is np.float32 else gray).astype(dtype)
        fields[1::2] = np.roll(fields, shift, axis=1)[1::2]
        mask = np.ones(fields.shape[:2], bool)
        mask[100:111, 200:230] = False
        images.append(fields)
        masks.append(mask)
        expected.append(of_even_rows(fields) if shift else fields)
        expected_masks.append(of_even_rows(mask) if shift else mask)

    found = ps.match(*images, left_mask=masks[0], right_mask=masks[1])
    same = ps.match(*expected, left_mask=expected_masks[0], right_mask=expected_masks[1])
    if dtype is np.float32:  # whose scale is that of all pixels, with the odd rows
        assert np.mean(found.disparity != same.disparity) < 0.02
    else:
        assert_same(found, same)
    (said,) = (one for one in found.findings if one.topic == "interlacing")
    assert "a match uses only the even rows" in said.sentence

    left_alone = ps.match(*images, align_rows=False)
    assert (left_alone.disparity != found.disparity).mean() > 0.2


def test_interlaced_pairs_are_matched_about_as_well_as_progressive_ones(
    load: Callable[[str], Pair],
) -> None:
    pair = load("cones")
    fields = pair.right.copy()
    fields[1::2] = np.roll(fields, 4, axis=1)[1::2]
    assert bad(pair, ps.match(pair.left, fields)) < bad(pair, ps.match(pair.left, pair.right)) + 2


def raw(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the raw image of a sensor with the pattern RGGB; its green is twice as sensitive."""
    mosaic = image[:, :, 1].copy()
    mosaic[::2, ::2] = image[::2, ::2, 0] // 2
    mosaic[1::2, 1::2] = image[1::2, 1::2, 2] // 2
    return mosaic


@pytest.mark.parametrize("sides", [(True, True), (False, True)])
def test_raw_mosaics_are_matched_about_as_well_as_gray_images(
    load: Callable[[str], Pair], sides: tuple[bool, bool]
) -> None:
    pair = load("cones")
    images = [
        raw(image) if is_raw else image[:, :, 1]
        for image, is_raw in zip((pair.left, pair.right), sides, strict=True)
    ]
    gray = bad(pair, ps.match(pair.left[:, :, 1], pair.right[:, :, 1]))
    found = ps.match(*images)
    assert bad(pair, found) < gray + 2 < bad(pair, ps.match(*images, align_rows=False))
    (said,) = (one.sentence for one in found.findings if one.topic == "interlacing")
    assert f"{'the images are' if sides[0] else 'the right image is'} a mosaic" in said
    photometry = estimated(*images).photometry
    assert photometry is not None
    assert photometry.mosaic == sides

    done = ps.prepare(*images).done
    assert f"the mosaic of {'both images' if sides[0] else 'the right image'} is smoothed" in done

    rig = ps.Rig()
    assert all(bad(pair, rig.match(*images)) < gray + 2 for _ in range(3))


@pytest.mark.parametrize(
    "how", [{"down": 1.0}, {"down": -4.0}, {"clockwise": 0.5}, {"scale": 1.02}]
)
@pytest.mark.parametrize("name", SCENES)
def test_rows_are_straightened(
    load: Callable[[str], Pair], name: str, how: dict[str, float]
) -> None:
    pair = load(name)
    crooked = pair.left, lowered(pair.right, **how)

    low, count = -6, pair.num_disparities + 12
    straight = ps.match(pair.left, pair.right, min_disparity=low, num_disparities=count)
    aligned = ps.match(*crooked, min_disparity=low, num_disparities=count)
    left = ps.match(*crooked, min_disparity=low, num_disparities=count, align_rows=False)

    assert aligned.alignment is not None
    assert aligned.alignment.applied
    assert aligned.alignment.residual < 0.2 < aligned.alignment.rms

    assert aligned.confidence is not None
    assert left.confidence is not None
    assert aligned.confidence.mean() > left.confidence.mean() + 0.02

    if "down" in how:  # else what is right lies elsewhere along the rows
        assert bad(pair, aligned) < bad(pair, straight) + 0.8
        assert bad(pair, left) > bad(pair, aligned) + 3
    assert "alignment" in [found.topic for found in aligned.findings]


@pytest.mark.parametrize("name", SCENES)
def test_rows_that_sway_are_straightened_row_by_row(load: Callable[[str], Pair], name: str) -> None:
    straight, shaken = load(name), Misaligned(wobble=2)(load(name), "right")
    low, count = -6, straight.num_disparities + 12
    result = ps.match(shaken.left, shaken.right, min_disparity=low, num_disparities=count)
    before = ps.match(straight.left, straight.right, min_disparity=low, num_disparities=count)
    left = ps.match(
        shaken.left, shaken.right, min_disparity=low, num_disparities=count, align_rows=False
    )

    found = result.alignment
    assert found is not None
    assert found.applied
    assert len(found.sway) == 19

    rows, cols = shaken.left.shape[:2]
    y, x = np.mgrid[20 : rows - 20 : 5, 0:cols:50].astype(float)
    waves = found.offsets(x, y) - 2 * np.sin(3 * np.pi * y / rows)
    assert np.sqrt(np.mean(waves**2)) < 0.2  # those of the scene itself are up to 0.1 off
    assert max(found.errors) < 0.5

    assert bad(shaken, result) < bad(straight, before) + 0.8
    assert bad(shaken, left) > bad(shaken, result) + 3
    assert any(one.sentence.startswith("rows sway by up to 2.") for one in result.findings)


@pytest.mark.parametrize(
    ("sway", "error"),
    [((0.0,) * 18, TypeError), ("sway", TypeError), ((float("nan"),) * 19, ValueError)],
)
def test_illegal_splines_are_refused(sway: Any, error: type[Exception]) -> None:
    field = ps.Alignment((0.0,) * 8, 0.1, 50, 0.1, (0.1,) * 16, (90, 90), applied=True, sway=sway)
    with pytest.raises(error, match="^alignment: got .*; accepts"):
        large.halo(ps.PRESETS["robust"], None, field)


@pytest.mark.parametrize("name", SCENES)
def test_what_is_aligned_is_not_touched(load: Callable[[str], Pair], name: str) -> None:
    pair = load(name)
    count = pair.num_disparities
    result = ps.match(pair.left, pair.right, num_disparities=count)
    assert result.alignment is not None
    assert not result.alignment.applied
    left = ps.match(pair.left, pair.right, align_rows=False, num_disparities=count)
    assert_same(result, left)


def test_rows_are_straightened_beside_blur(load: Callable[[str], Pair]) -> None:
    pair = load("cones")

    soft = degradation.suite()["disk 3"](pair.left)
    count = pair.num_disparities
    straight = ps.match(soft, pair.right, num_disparities=count)
    result = ps.match(soft, lowered(pair.right, down=2.0), num_disparities=count)

    assert result.blur is not None
    assert result.blur.blur.side == "left"
    assert bad(pair, result) < bad(pair, straight) + 1.5


def test_rows_are_straightened_with_versions_that_are_given(load: Callable[[str], Pair]) -> None:
    pair = load("cones")
    crooked = lowered(pair.right, down=2.0)
    given = ps.BlurCompensation(noise=(1.0, 1.0))
    result = ps.match(pair.left, crooked, known=ps.Known(blur_compensation=given))

    assert result.alignment is not None
    assert result.alignment.applied
    assert result.blur_compensation is given

    noisy = ps.match(pair.left, crooked, known=ps.Known(noise=1.0))
    assert noisy.alignment is not None
    assert noisy.alignment.applied


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32", "float64"])
def test_parts_of_a_crooked_pair_are_those_of_the_whole(dtype: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    layers = [
        np.kron(rng.normal(size=(400 // n, 300 // n)), np.ones((n, n))) for n in (1, 2, 4, 10)
    ]

    scene = np.sum([layer[:400, :300] for layer in layers], axis=0)
    left = np.asarray(scene[30:-30, 20:-20], np.float32)
    right = moved(np.asarray(scene[30:-30, 29:-11], np.float32), down=1.4, clockwise=0.3)
    y, x = np.mgrid[0:340, 0:260].astype(float)
    right = ndimage.map_coordinates(right, (y - np.sin(y / 30), x), mode="nearest")
    images = [np.rint(20 * image + 110).clip(0, 255).astype(dtype) for image in (left, right)]

    mask = np.ones(left.shape, bool)
    mask[100:120, 40:90] = False

    def read(first: int, last: int) -> Any:
        return *(image[first:last] for image in images), None, mask[first:last]

    whole = ps.match(*images, right_mask=mask)
    assert whole.alignment is not None
    assert whole.alignment.applied
    assert whole.search is not None
    assert whole.search.origin == "found"

    assert whole.alignment.sway

    large.pair_statistics(read, left.shape).save(tmp_path / "statistics")
    statistics = bands.load(tmp_path / "statistics")
    assert (statistics.alignment, statistics.search) == (whole.alignment, whole.search)

    for first, last in ((0, 40), (90, 170), (300, 340)):
        part = large.match_rows(read, statistics, first, last)
        np.testing.assert_array_equal(part.disparity, whole.disparity[first:last])
        np.testing.assert_array_equal(part.flags, whole.flags[first:last])
        assert whole.confidence is not None
        np.testing.assert_array_equal(part.confidence, whole.confidence[first:last])

    around = large.halo(statistics.settings, statistics.blur_compensation, statistics.alignment)
    assert around > large.halo(statistics.settings, statistics.blur_compensation)


# --- ranges ---


@pytest.mark.parametrize("name", SCENES)
def test_the_range_need_not_be_given(load: Callable[[str], Pair], name: str) -> None:
    pair = load(name)

    given = ps.match(pair.left, pair.right, num_disparities=pair.num_disparities)
    found = ps.match(pair.left, pair.right)

    assert found.search is not None
    assert found.search.origin == "found"
    assert given.search is not None
    assert (given.search.origin, given.search.num_disparities) == ("given", pair.num_disparities)

    assert bad(pair, found) < bad(pair, given) + 0.5

    assert_same(
        found,
        ps.match(
            pair.left,
            pair.right,
            min_disparity=found.search.min_disparity,
            num_disparities=found.search.num_disparities,
        ),
    )


def test_images_that_tell_no_range_are_searched_over_a_third() -> None:
    result = ps.match(np.zeros((60, 90), np.uint8), np.zeros((60, 90), np.uint8))
    assert result.search is not None
    assert (result.search.origin, result.search.num_disparities) == ("default", 30)


# --- findings ---


def test_good_pairs_are_not_accused(data: Path) -> None:
    good = accused = 0
    for name in (*SCENES, "Motorcycle", "Aloe"):
        pair = find_scene(data / "middlebury", name).load()
        assert pair.truth is not None
        for blur in ("sharp", "disk 6", "motion 15", "contrast 1.5 0.6"):
            left = pair.left if blur == "sharp" else degradation.suite()[blur](pair.left)
            for count in (None, pair.num_disparities):
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", ps.MatchWarning)
                    result = ps.match(left, pair.right, num_disparities=count)
                seen = pair.masks["nonocc"]
                wrong = np.mean(~(np.abs(result.disparity - pair.truth)[seen] <= 1))
                if wrong < 0.15:
                    good += 1
                    accused += bool(grave(result))
    assert good >= 25
    assert accused <= 0.05 * good, "where 14 % are wrong, 25 % may be expected"


def faults(pair: Pair) -> dict[str, tuple[Any, Any, dict[str, Any], str]]:
    count = pair.num_disparities
    noise = np.random.default_rng(0).integers(0, 256, pair.left.shape, np.uint8)
    search = {"num_disparities": count}
    crooked = lowered(pair.right, down=2.0)

    return {
        "swapped": (pair.right, pair.left, search, "swap"),
        "swapped, range to be found": (pair.right, pair.left, {}, "swap"),
        "a third of the range": (pair.left, pair.right, {"num_disparities": count // 3}, "range"),
        "noise": (pair.left, noise, search, "match"),
        "noise, range to be found": (pair.left, noise, {}, "match"),
        "black": (pair.left, np.zeros_like(pair.left), search, "match"),
        "rows": (pair.left, crooked, {**search, "align_rows": False}, "match"),
        "upside down": (pair.left, pair.right[::-1], search, "match"),
        "inverted": (pair.left, 255 - pair.right, {**search, "compensate_blur": False}, "match"),
        "inverted, range to be found": (
            pair.left,
            255 - pair.right,
            {"compensate_blur": False},
            "match",
        ),
    }


@pytest.mark.parametrize("name", ["cones", "Motorcycle", "Aloe"])
def test_what_went_wrong_is_said(load: Callable[[str], Pair], name: str) -> None:
    for fault, (left, right, options, topic) in faults(load(name)).items():
        with pytest.warns(ps.MatchWarning):
            result = ps.match(left, right, **options)
        assert topic in grave(result), (fault, result.findings)
        assert result.search is not None
        assert result.search.inverted == fault.startswith("inverted"), fault


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_the_negative_of_an_inverted_image_is_matched(
    load: Callable[[str], Pair], dtype: type[Any]
) -> None:
    pair = load("cones")

    scale, white = {np.uint8: (1, 255), np.uint16: (257, 65535), np.float32: (1 / 255, 1.0)}[dtype]
    left, right = ((image * dtype(scale)).astype(dtype) for image in (pair.left, pair.right))
    for count in (None, pair.num_disparities):
        straight = ps.match(left, right, num_disparities=count)
        inverted = ps.match(left, white - right, num_disparities=count)

        assert inverted.search is not None
        assert inverted.search.inverted
        assert not grave(inverted)
        assert any("is dark in the other" in one.sentence for one in inverted.findings)

        known = np.isfinite(straight.disparity) & np.isfinite(inverted.disparity)
        apart = np.abs(straight.disparity - inverted.disparity)[known] > 1
        assert apart.mean() < 0.01, count


def test_a_negative_is_known_by_its_gray_levels_where_few_disparities_are_searched(
    load: Callable[[str], Pair],
) -> None:
    pair = load("tsukuba")
    straight = ps.match(pair.left, pair.right, num_disparities=16)
    inverted = ps.match(pair.left, 255 - pair.right, num_disparities=16)
    assert straight.search is not None
    assert inverted.search is not None
    assert not straight.search.inverted
    assert inverted.search.inverted
    assert bad(pair, inverted) < bad(pair, straight) + 0.5


def test_a_rig_goes_on_with_the_negative(load: Callable[[str], Pair]) -> None:
    pair = load("cones")
    rig = ps.Rig()
    before = rig.match(pair.left, 255 - pair.right)
    again = rig.match(pair.left, 255 - pair.right)
    np.testing.assert_array_equal(again.disparity, before.disparity)


def test_a_matcher_warns_too_and_a_summary_is_what_it_says() -> None:
    images = np.random.default_rng(0).integers(0, 256, (2, 90, 120), np.uint8)

    with pytest.warns(ps.MatchWarning, match="without texture"):
        result = ps.Matcher().match(*images, num_disparities=30)

    assert result.summary is not None
    assert result.confidence is not None
    assert result.summary.confidence == pytest.approx(float(result.confidence.mean()), abs=1e-5)

    failed = ps.Flag.OCCLUDED | ps.Flag.MISMATCHED | ps.Flag.SPECKLE
    assert result.summary.flagged == ((result.flags & failed) != 0).mean()
    assert result.summary.estimated == np.isfinite(result.disparity).mean()

"""Whole matches: on real pairs, against the oracle, with masks, in any type and layout."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st
from test_descriptor import decoded
from test_refinement import two_surfaces

import phasestereo as ps
from phasestereo.metrics import bad_pixels
from phasestereo.settings import PresetName
from phasestereo_bench.datasets import find_scene
from support import oracle, oracle_refinement as refinement
from support.pairs import noise_pair

if TYPE_CHECKING:
    from pathlib import Path

PAPER: dict[str, Any] = {
    "neighborhood": 7,
    "window": 9,
    "frequencies": (2, 1),
    "power": 1,
    "bits": 2,
}


# The oracle gives 5.645, 2.674 and 7.393 %: the bounds leave room for ties alone.
@pytest.mark.parametrize(("name", "bound"), [("tsukuba", 6.0), ("venus", 3.0), ("cones", 7.6)])
def test_the_paper_preset_on_real_pairs(data: Path, name: str, bound: float) -> None:
    pair = find_scene(data / "middlebury", name).load()
    result = ps.match(
        pair.left, pair.right, num_disparities=pair.num_disparities, preset="paper", **PAPER
    )
    assert pair.truth is not None
    assert bad_pixels(result.disparity, pair.truth, 1.0, pair.masks["nonocc"]) <= bound


@settings(max_examples=60)
@given(
    seed=st.integers(0, 1000),
    shape=st.tuples(st.integers(1, 9), st.integers(1, 11)),
    low=st.integers(-6, 6),
    bits=st.integers(1, 4),
    radius=st.integers(0, 4),
    shiftable=st.booleans(),
    precision=st.sampled_from(["full", "byte"]),
    optimizer=st.sampled_from(["dp", "so", "wta"]),
    penalties=st.sampled_from([(0, 0), (0.5, 0.5), (2, 2), (0, 5), (0.5, 0)]),
)
def test_codes_to_disparities_equal_the_oracle(
    seed: int,
    shape: tuple[int, int],
    low: int,
    bits: int,
    radius: int,
    *,
    shiftable: bool,
    precision: str,
    optimizer: str,
    penalties: tuple[float, float],
) -> None:
    count, window = min(4, shape[1]), 2 * radius + 1
    assume(-shape[1] - count + 1 < low < shape[1])

    left, right = np.random.default_rng(seed).integers(0, 256, (2, *shape), np.uint8)
    aggregation: dict[str, Any] = {
        "window": window,
        "shiftable": shiftable,
        "precision": precision,
    }
    choice: dict[str, Any] = {"optimizer": optimizer, "p1": penalties[0], "p2": penalties[1]}
    options: dict[str, Any] = {"num_disparities": count, "min_disparity": low, "bits": bits}
    options["preset"] = "paper"

    result = ps.match(left, right, **options, **aggregation, **choice)

    levels = [decoded(ps.descriptor(image, bits=bits), 7, bits) for image in (left, right)]
    costs = oracle.phase_costs(levels[0], levels[1], low, count, bits)
    # Seven components, each of which differs by half the number of levels at most.

    byte = precision == "byte"
    dropped = oracle.dropped_bits(window, 7 * 2 ** (bits - 1), penalties[1]) if byte else 0
    volume = oracle.aggregate(costs, window, shiftable=shiftable, dropped=dropped)
    p1, p2 = (oracle.window_penalty(each, window, dropped) for each in penalties)

    evidence = {
        "dp": lambda: refinement.of_scanlines(volume, oracle.scanline(volume, p1, p2)),
        "so": lambda: refinement.of_paths(volume, oracle.row_means(volume, p1, p2)),
        "wta": lambda: refinement.of_scanlines(volume, oracle.winner_takes_all(volume)),
    }[optimizer]()

    np.testing.assert_array_equal(result.disparity, evidence.chosen + low)
    unit = window**2 / 2**dropped
    unrelated = np.floor(7 * 2 ** (bits - 1) / 3 * unit)
    reliable = refinement.reliability(evidence, unit, unrelated)
    raw = refinement.confidence(result.disparity, reliable, left.astype(np.int64))
    assert result.confidence is not None
    assert result.uncertainty is not None
    # Single precision may put a raw confidence into the step beside.
    around = [
        refinement.calibrated(
            raw + by,
            result.disparity,
            result.flags.astype(np.int64),
            low=low,
            number=count,
            optimizer=optimizer,
        )
        for by in (-1e-5, 1e-5)
    ]
    for found, (one, other) in zip(
        (result.confidence, result.uncertainty), zip(*around, strict=True), strict=True
    ):
        assert (found >= np.minimum(one, other) * (1 - 1e-3)).all()
        assert (found <= np.maximum(one, other) * (1 + 1e-3)).all()

    without = ps.match(left, right, **options, **aggregation, **choice, confidence=False)
    assert without.confidence is None
    np.testing.assert_array_equal(without.disparity, result.disparity)


def test_fast_with_masks_equals_the_oracle() -> None:
    rng = np.random.default_rng(5)

    left, right = noise_pair(24, 40, 3)
    masks = [rng.random((24, 40)) > 0.3 for _ in range(2)]
    masks[0][:12, :20] = False

    fast = replace(ps.PRESETS["fast"], adaptive_p2=0, median=0)

    result = ps.match(
        left, right, num_disparities=7, settings=fast, left_mask=masks[0], right_mask=masks[1]
    )

    codes = [
        decoded(ps.descriptor(image, mask=mask, settings=fast), 4, fast.bits)
        for image, mask in zip((left, right), masks, strict=True)
    ]

    valid = oracle.valid_candidates(masks[0], masks[1], 0, 7)
    dropped = oracle.dropped_bits(fast.window, 8, fast.p2)
    volume = oracle.aggregate(
        oracle.phase_costs(codes[0], codes[1], 0, 7, fast.bits),
        fast.window,
        shiftable=fast.shiftable,
        valid=valid,
        ceiling=8,
        dropped=dropped,
    )

    p1, p2 = (oracle.window_penalty(each, fast.window, dropped) for each in (fast.p1, fast.p2))
    chosen = oracle.free_scanline(volume, p1, p2)
    expected = np.where(valid.any(axis=2), chosen, np.nan)

    assert (expected == 3).any()
    np.testing.assert_array_equal(result.disparity, expected)


# They were 5.26, 2.80 and 8.13 %.
@pytest.mark.parametrize(("name", "bound"), [("tsukuba", 6.0), ("venus", 3.5), ("cones", 9.0)])
def test_the_fast_preset_on_real_pairs(data: Path, name: str, bound: float) -> None:
    pair = find_scene(data / "middlebury", name).load()
    result = ps.match(pair.left, pair.right, num_disparities=pair.num_disparities, preset="fast")
    assert pair.truth is not None
    assert bad_pixels(result.disparity, pair.truth, 1.0, pair.masks["nonocc"]) <= bound


def test_images_to_disparities_equal_the_oracle_but_for_rounding(data: Path) -> None:
    pair = find_scene(data / "middlebury", "cones").load()
    left, right = pair.left[150:190], pair.right[150:190]

    result = ps.match(left, right, num_disparities=64, preset="paper")

    expected = oracle.match_phase(
        left,
        right,
        min_disparity=0,
        num_disparities=64,
        L=7,
        window=9,
        r=2,
        s=1,
        k=1,
        b=2,
        p1=2,
        p2=2,
    )
    # A few components lie within rounding of a boundary: 99.9 % of the pixels were equal.
    assert (result.disparity == expected).mean() > 0.995


def test_shifted_texture_is_found_and_the_border_is_flagged() -> None:
    left, right = noise_pair(30, 60, 5)
    result = ps.match(left, right, num_disparities=16, preset="paper")
    assert (result.disparity[:, 10:] == 5).all()
    assert (result.flags[:, 10:] == 0).all()
    columns = np.arange(60) - result.disparity
    np.testing.assert_array_equal((result.flags & ps.Flag.OUTSIDE) != 0, columns < 0)


def test_robust_finds_shifted_texture_and_fills_the_border() -> None:
    left, right = noise_pair(30, 60, 5)
    result = ps.match(left, right, num_disparities=16)
    assert np.abs(result.disparity - 5).max() < 0.4, "the right border draws half-way to the next"
    assert np.abs(result.disparity[:, 10:-10] - 5).max() < 0.1
    assert (result.flags[:, 10:-5] == 0).all()
    assert (result.flags[:, :3] & ps.Flag.FILLED != 0).all()
    assert (result.flags[:, :3] & ps.Flag.OUTSIDE != 0).any()


@pytest.mark.parametrize("preset", ["paper", "fast", "robust"])
def test_negative_disparities(preset: PresetName) -> None:
    right, left = noise_pair(20, 40, 4)
    result = ps.match(left, right, num_disparities=8, min_disparity=-7, preset=preset)
    assert (np.rint(result.disparity[:, :30]) == -4).all()
    columns = np.arange(40) - np.rint(result.disparity)
    np.testing.assert_array_equal((result.flags & ps.Flag.OUTSIDE) != 0, columns > 39)


@pytest.mark.parametrize("preset", ["paper", "fast", "robust"])
def test_without_fill_flagged_estimates_are_missing(preset: PresetName) -> None:
    """Nothing else changes: not even the disparities of the others."""
    left, right = two_surfaces(0, (40, 60))
    dense = ps.match(left, right, num_disparities=12, preset=preset)
    sparse = ps.match(left, right, num_disparities=12, preset=preset, fill=False)

    assert np.isfinite(dense.disparity).all()
    assert (dense.flags != 0).any()

    np.testing.assert_array_equal(np.isnan(sparse.disparity), dense.flags != 0)
    np.testing.assert_array_equal(sparse.flags, dense.flags & ~ps.Flag.FILLED)

    known = np.isfinite(sparse.disparity)
    np.testing.assert_array_equal(sparse.disparity[known], dense.disparity[known])

    filled = dense.flags & ps.Flag.FILLED != 0
    np.testing.assert_array_equal(filled, (dense.flags != 0) & (preset == "robust"))


@pytest.mark.parametrize("preset", ["paper", "robust"])
def test_masked_pixels_neither_vote_nor_are_estimated(preset: PresetName) -> None:
    rng = np.random.default_rng(1)

    left, right = noise_pair(30, 50, 4)
    masks: dict[str, Any] = {
        "left_mask": rng.random((30, 50)) > 0.1,
        "right_mask": rng.random((30, 50)) > 0.1,
    }

    options: dict[str, Any] = {"num_disparities": 8, "preset": preset, **masks}
    result = ps.match(left, right, **options)

    garbage = [
        np.where(mask, image, 255 - image)
        for image, mask in zip((left, right), masks.values(), strict=True)
    ]
    again = ps.match(*garbage, **options)

    for field in ("disparity", "flags", "confidence"):
        np.testing.assert_array_equal(getattr(again, field), getattr(result, field))

    masked = ~masks["left_mask"]
    np.testing.assert_array_equal((result.flags & ps.Flag.MASKED) != 0, masked)
    assert np.isnan(result.disparity[masked]).all()

    without_candidate = (result.flags & ps.Flag.NO_CANDIDATE) != 0
    assert without_candidate.any()

    missing = masked | (without_candidate & (preset == "paper"))  # else it is filled
    np.testing.assert_array_equal(np.isnan(result.disparity), missing)
    assert (np.rint(result.disparity[:, 8:][~masked[:, 8:]]) == 4).mean() > 0.99


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_nan_is_a_mask(dtype: type, channels: int) -> None:
    left, right = noise_pair(60, 90, 4)
    left, right = (np.repeat(v[..., None], channels, axis=2).astype(dtype) for v in (left, right))
    holes = np.zeros((2, *left.shape[:2]), bool)
    holes[0, 20:30, 40:60] = holes[1, 5:9, 20:30] = True
    wanted = ps.match(left, right, num_disparities=16, left_mask=~holes[0], right_mask=~holes[1])
    left[..., -1][holes[0]] = right[..., 0][holes[1]] = np.nan  # in one channel
    for result in (
        ps.match(left, right, num_disparities=16),
        ps.match(left, right, num_disparities=16, left_mask=~holes[0]),
    ):
        for name, values in result.maps.items():
            np.testing.assert_array_equal(values, wanted.maps[name])
    assert (result.flags[holes[0]] == ps.Flag.MASKED).all()
    assert ps.check(left, right).search is not None


def test_what_shows_nothing_is_a_mask() -> None:
    left, right = noise_pair(60, 90, 4)
    seen = np.ones(left.shape, bool)
    seen[20:30, 40:60] = False
    rgba = np.dstack([left, left, left, 200 * seen.astype(np.uint8)])
    wanted = ps.match(left, right, num_disparities=16, left_mask=seen)

    hidden = np.repeat(~seen[..., None], 3, axis=2)
    hidden[..., 1:] = False  # masked in one channel
    for image in (rgba, np.ma.masked_array(left, ~seen), np.ma.masked_array(rgba[..., :3], hidden)):
        result = ps.match(image, right, num_disparities=16)
        for name, values in result.maps.items():
            np.testing.assert_array_equal(values, wanted.maps[name])
        assert result.pair is not None
        assert not np.ma.isMaskedArray(result.pair[0])

    # A fourth channel that is zero everywhere fills up four bytes, and says nothing.
    padded = ps.match(rgba * np.array([1, 1, 1, 0], np.uint8), right, num_disparities=16)
    assert np.isfinite(padded.disparity).all()


def test_a_black_border_is_not_matched() -> None:
    left, right = noise_pair(120, 160, 4)
    y, x = np.mgrid[:120, :160]
    shapes = {
        "frame": (x >= 20) & (x < 145) & (y >= 10),
        "circle": (y - 60) ** 2 + (x - 80) ** 2 < 55**2,
    }
    for name, inside in shapes.items():
        pair = [
            np.where(inside, np.maximum(image, 1), 0).astype(np.uint8) for image in (left, right)
        ]
        result = ps.match(*pair, num_disparities=16)
        masked = ps.match(*pair, num_disparities=16, left_mask=inside, right_mask=inside)
        np.testing.assert_array_equal(result.flags == ps.Flag.MASKED, ~inside, err_msg=name)
        for which, values in result.maps.items():
            np.testing.assert_array_equal(values, masked.maps[which])

        share = f"a black border, {100 * (~inside).mean():.0f} % of both images"
        for findings in (result.findings, ps.check(*pair).findings):
            told = [found.sentence for found in findings if found.topic == "border"]
            assert len(told) == 1
            assert told[0].startswith(share)
            assert not any("expose" in found.sentence for found in findings)

    # A white wall, and a dark area with an outline of its own, belong to the scene.
    ragged = y < 20 + np.random.default_rng(0).integers(0, 40, 160)
    for outside, value in ((y < 40, 255), (ragged, 0)):
        pair = [np.where(outside, value, np.clip(image, 1, 254)) for image in (left, right)]
        result = ps.match(*(image.astype(np.uint8) for image in pair), num_disparities=16)
        assert not (result.flags & ps.Flag.MASKED).any()


@pytest.mark.parametrize("lower", [12, -12])
def test_rows_that_the_right_image_does_not_show_are_not_trusted(lower: int) -> None:
    left, right = noise_pair(200, 260, 7)
    above, below = slice(None, -12), slice(12, None)
    pair = (left[above], right[below]) if lower > 0 else (left[below], right[above])
    result = ps.match(*pair, num_disparities=16)

    assert result.alignment is not None
    assert result.alignment.applied
    unseen = slice(None, 12) if lower > 0 else slice(-12, None)
    assert not result.trusted[unseen].any()
    assert (result.flags[unseen] & ps.Flag.NO_CANDIDATE != 0).mean() > 0.9
    assert result.trusted.mean() > 0.8


def test_matches_on_masked_pixels_are_flagged() -> None:
    left, right = noise_pair(20, 30, 3)
    right_mask = np.ones((20, 30), bool)
    right_mask[8:12, 10:13] = False

    result = ps.match(left, right, num_disparities=6, right_mask=right_mask, preset="paper")
    columns = np.clip(np.arange(30) - result.disparity, 0, 29).astype(int)
    hit = ~right_mask[np.arange(20)[:, None], columns]

    np.testing.assert_array_equal((result.flags & ps.Flag.MATCH_MASKED) != 0, hit)
    assert hit.any()

    robust = ps.match(left, right, num_disparities=6, right_mask=right_mask)
    filled = robust.flags & ps.Flag.MATCH_MASKED != 0
    assert (robust.flags[filled] & ps.Flag.FILLED != 0).all()
    assert filled[:, 13:16].any()
    assert (np.rint(robust.disparity) == 3).all()


def test_nothing_to_match_with_leaves_no_candidate() -> None:
    left, right = noise_pair(6, 9, 2)
    result = ps.match(
        left, right, num_disparities=3, right_mask=np.zeros((6, 9), bool), confidence=True
    )

    assert (result.flags == ps.Flag.NO_CANDIDATE).all()
    assert np.isnan(result.disparity).all()
    assert result.confidence is not None
    assert not result.confidence.any()


def test_nan_under_a_mask_is_welcome() -> None:
    left, right = (image.astype(np.float32) for image in noise_pair(20, 30, 3))
    left_mask = np.ones((20, 30), bool)
    left_mask[5:9, 11:17] = False
    clean = ps.match(left, right, num_disparities=6, left_mask=left_mask)
    left[5:9, 11:17] = np.nan
    holed = ps.match(left, right, num_disparities=6, left_mask=left_mask)
    np.testing.assert_array_equal(holed.disparity, clean.disparity)


@pytest.mark.parametrize("cost", ["phase", "sad", "nsad"])
def test_type_layout_and_byte_order_change_nothing(cost: str) -> None:
    rng = np.random.default_rng(2)

    left, right = rng.integers(0, 256, (2, 14, 22, 3), np.uint8)
    options: dict[str, Any] = {"num_disparities": 5, "cost": cost, "preset": "paper"}
    expected = ps.match(left, right, **options).disparity

    wide = [image.astype(np.uint16) * np.uint16(257) for image in (left, right)]
    alpha = np.dstack([left, rng.integers(0, 256, (14, 22), np.uint8)])
    unaligned = np.frombuffer(b"\0" + wide[0].tobytes(), np.uint8)[1:].view(np.uint16)

    variants: list[tuple[Any, Any]] = [
        (np.asfortranarray(left), right),
        (np.repeat(left, 2, axis=1)[:, ::2], right),
        (left[::-1, ::-1].copy()[::-1, ::-1], right),
        (alpha, right),
        (wide[0], wide[1]),
        (wide[0].astype(">u2"), wide[1].astype("<u2")),
        (unaligned.reshape(14, 22, 3), wide[1]),
        (left.astype(np.float64), right.astype(">f8")),
    ]

    for variant in variants:
        if variant[0].dtype.kind == "f":
            options["intensity_range"] = (0, 255)
        np.testing.assert_array_equal(ps.match(*variant, **options).disparity, expected)


def test_gray_and_color_may_meet() -> None:
    left, right = noise_pair(12, 20, 2)
    expected = ps.match(left, right, num_disparities=5).disparity
    color = np.repeat(left[:, :, None], 3, axis=2)
    found = ps.match(color, right[:, :, None], num_disparities=5).disparity
    np.testing.assert_array_equal(found, expected)


def test_contrast_is_left_alone() -> None:
    left, right = noise_pair(25, 40, 3)
    dim = (left // 4 + 60).astype(np.uint8)
    assert (ps.match(dim, right, num_disparities=8, preset="paper").disparity[:, 8:] == 3).all()
    assert np.abs(ps.match(dim, right, num_disparities=8).disparity - 3).max() < 0.4


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1), (2, 3)])
def test_windows_larger_than_the_image_are_fine(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    result = ps.match(image, image, num_disparities=1, window=63, neighborhood=61)
    assert (result.disparity == 0).all()


def test_what_is_trusted_is_sure_or_not_flagged() -> None:
    disparity = np.array([[1, 2, np.nan, 4]], np.float32)
    flags = np.array([[0, ps.Flag.FILLED, 0, ps.Flag.OCCLUDED]], np.uint16)
    confidence = np.array([[0.49, 0.5, 0.9, 0.1]], np.float32)
    result = ps.Result(disparity, flags, confidence, ps.Settings(), {})
    assert result.trusted.tolist() == [[False, True, False, False]]
    bare = replace(result, confidence=None)
    assert bare.trusted.tolist() == [[True, False, False, False]]
    assert list(bare.maps) == ["disparity", "flags"]


def test_results_tell_about_themselves_and_travel() -> None:
    left, right = noise_pair(10, 20, 2)
    result = ps.match(left, right, num_disparities=4, confidence=True)

    assert result.confidence is not None
    assert result.disparity.dtype == result.confidence.dtype == np.float32
    assert result.flags.dtype == np.uint16
    assert set(result.timings) == {
        "estimation",
        "description",
        "matching",
        "refinement",
        "scales",
    }
    assert "100.0% trusted" in repr(result)
    assert result.summary is not None
    told = replace(result, summary=replace(result.summary, wrong=0.374))
    assert repr(told).startswith("<Result 20x10, about 37 % of the pixels are probably wrong, ")
    assert told.verdict == "about 37 % of the pixels are probably wrong"
    told = replace(result, summary=replace(result.summary, wrong=0.004))
    assert told.verdict == "less than 1 % of the pixels are probably wrong"
    assert replace(result, summary=None).verdict == ""

    traveled = pickle.loads(pickle.dumps(result))  # noqa: S301  # our own bytes
    for field in ("disparity", "flags", "confidence"):
        np.testing.assert_array_equal(getattr(traveled, field), getattr(result, field))

    assert traveled.settings == result.settings
    assert traveled.timings == result.timings


@pytest.mark.parametrize("reused", [False, True])
def test_results_refer_to_the_images_as_given(*, reused: bool) -> None:
    left, right = noise_pair(10, 20, 2)
    match = ps.Matcher().match if reused else ps.match
    color, single = np.repeat(left[:, :, None], 4, axis=2), right[:, :, None]

    for images in ((left, right), (color, single)):
        pair = match(*images, num_disparities=4).pair
        assert pair is not None
        assert pair[0] is images[0]
        assert pair[1] is images[1]

    pair = match((left / 255).tolist(), right / 255, num_disparities=4).pair
    assert pair is not None
    np.testing.assert_array_equal(pair[0], left / 255)


def test_the_pair_does_not_travel() -> None:
    images = np.random.default_rng(0).integers(0, 256, (2, 60, 80, 3), np.uint8)
    result = ps.match(*images, num_disparities=4, compensate_blur=False)
    assert copy.copy(result).pair is result.pair is not None

    written = pickle.dumps(result)
    alone = pickle.dumps(replace(result, pair=None))

    assert len(written) == len(alone)
    assert pickle.loads(written).pair is None  # noqa: S301  # our own bytes
    assert copy.deepcopy(result).pair is None

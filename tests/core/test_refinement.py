"""Whole matches with all that refines them held to the oracle, and the oracle to maps by hand."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from test_descriptor import decoded, decoded_parts

import phasestereo as ps
from support import oracle, oracle_refinement as refinement

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Masks = tuple[NDArray[np.bool_], NDArray[np.bool_]]

NAN = np.nan
NOISE = 3.0
ROBUST = replace(ps.PRESETS["robust"], compensate_blur=False, despike=False, denoise=False)


def volume_of(
    pair: NDArray[Any], settings: ps.Settings, search: tuple[int, int], masks: Masks | None
) -> tuple[NDArray[np.int64], int, int]:
    """Return the oracle's aggregated costs of phase codes, the bits they lost, those of a code."""
    r, s = settings.frequencies
    components = r * (2 * s + 1) + s
    noise = NOISE if settings.noise_threshold else None

    codes = [
        ps.descriptor(image, mask=mask, settings=settings, noise=noise)
        for image, mask in zip(pair, masks or (None, None), strict=True)
    ]

    if settings.sizes == 2:
        # The axes of the larger neighborhood, with a weak level, then all of the smaller one.
        axes = min(r, 1) + min(s, 1)
        ceiling = 4 * axes + components * 2 ** (settings.bits - 1)
        parts = [decoded_parts(code & (1 << 4 * axes) - 1, axes) for code in codes]
        levels = [decoded(code >> 4 * axes, components, settings.bits) for code in codes]
        costs = oracle.weak_costs(parts[0], parts[1], *search)
        costs += oracle.phase_costs(levels[0], levels[1], *search, settings.bits)
    elif settings.noise_threshold:
        ceiling = 4 * components
        parts = [decoded_parts(code, components) for code in codes]
        costs = oracle.weak_costs(parts[0], parts[1], *search)
    else:
        ceiling = components * 2 ** (settings.bits - 1)
        levels = [decoded(code, components, settings.bits) for code in codes]
        costs = oracle.phase_costs(levels[0], levels[1], *search, settings.bits)

    byte = settings.precision == "byte"
    dropped = oracle.dropped_bits(settings.window, ceiling, settings.p2) if byte else 0

    volume = oracle.aggregate(
        costs,
        settings.window,
        shiftable=settings.shiftable,
        valid=None if masks is None else oracle.valid_candidates(*masks, *search),
        ceiling=ceiling,
        dropped=dropped,
    )
    return volume, dropped, ceiling


def evidence_of(
    volume: NDArray[np.int64], settings: ps.Settings, dropped: int, gray: NDArray[np.int64]
) -> tuple[refinement.Evidence, float]:
    """Return the oracle's choice, and the sum of one bit in every pixel of the window."""
    p1, p2 = (
        oracle.window_penalty(each, settings.window, dropped) for each in (settings.p1, settings.p2)
    )

    unit = settings.window**2 / 2**dropped
    if settings.optimizer in ("so", "sgm"):
        paths = oracle.row_means if settings.optimizer == "so" else oracle.path_means
        means = paths(volume, p1, p2, gray, settings.adaptive_p2)
        return refinement.of_paths(volume, means), unit

    dp = settings.optimizer == "dp"
    chosen = oracle.scanline(volume, p1, p2) if dp else oracle.winner_takes_all(volume)
    return refinement.of_scanlines(volume, chosen), unit


def assert_equals_the_oracle(
    pair: NDArray[Any], settings: ps.Settings, search: tuple[int, int], masks: Masks | None = None
) -> ps.Result:
    """Check a match against the oracle in all that it returns; return it."""
    low, number = search

    options: dict[str, Any] = {"min_disparity": low, "num_disparities": number}
    if masks is not None:
        options |= {"left_mask": masks[0], "right_mask": masks[1]}
    if settings.noise_threshold:
        options["known"] = ps.Known(noise=NOISE)

    result = ps.match(*pair, settings=settings, **options)

    everything = np.ones(pair.shape[1:3], bool)
    steps = 16 if pair.ndim == 4 else 1
    # About the middle of the range: outlines cut gray steps off that lie far from it.
    gray = np.rint(steps * (oracle.to_gray(pair[0]) - 128)).astype(np.int64)
    gray = gray if masks is None else oracle.fill_masked(gray, masks[0])

    volume, dropped, bits = volume_of(pair, settings, search, masks)
    evidence, unit = evidence_of(volume, settings, dropped, gray)

    disparity, flags = refinement.refine(
        evidence,
        gray,
        low=low,
        number=number,
        masks=masks or (everything, everything),
        settings=settings,
    )

    trust: NDArray[Any] = np.ones(disparity.shape)
    if result.confidence is not None:
        # Whether disparities agree that are one apart may depend on the last bit.
        reliable = refinement.reliability(evidence, unit, np.floor(bits / 3 * unit))
        # Where there is no valid candidate, the choice among all says nothing.
        seen = (flags & (ps.Flag.MASKED | ps.Flag.NO_CANDIDATE)) == 0
        least, most = (
            np.where(seen, refinement.confidence(disparity, reliable * seen, gray, agree), 0.0)
            for agree in (0.99999, 1.00001)
        )
        known: dict[str, Any] = {
            "low": low,
            "number": number,
            "optimizer": settings.optimizer,
            "noise": NOISE if settings.noise_threshold else 0,
        }
        around = np.array(
            [
                refinement.calibrated(raw, disparity, flags, whole=whole, **known)
                for raw in (least - 1e-5, most + 1e-5)
                for whole in (least, most)
            ]
        )
        smallest, largest = around.min(axis=0) * (1 - 1e-3), around.max(axis=0) * (1 + 1e-3)
        trust = result.confidence
        assert ((trust >= smallest[0]) & (trust <= largest[0])).all()

        bars, estimated = result.uncertainty, np.isfinite(result.disparity)
        assert bars is not None
        assert (np.isnan(bars) == ~estimated).all()
        assert (bars >= smallest[1])[estimated].all()
        assert (bars <= largest[1])[estimated].all()

    disparity, flags = refinement.invalidate(
        disparity, flags, trust, least=settings.min_confidence, filled=settings.fill
    )

    np.testing.assert_array_equal(result.flags, flags)
    np.testing.assert_allclose(result.disparity, disparity, rtol=0, atol=1e-5)
    if not settings.subpixel:
        np.testing.assert_array_equal(result.disparity, disparity)
    return result


def two_surfaces(seed: int, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return a pair: a square in front of a plane, both of random texture, with a little noise."""
    rng = np.random.default_rng(seed)
    height, width = shape[:2]

    plane, square = rng.integers(20, 230, (2, height, width + 6, *shape[2:]))
    left, right = plane[:, :width].copy(), plane[:, 1 : width + 1].copy()
    rows = slice(height // 4, 3 * height // 4 + 1)
    near = width // 2

    left[rows, near : near + 6] = square[rows, near : near + 6][:, : width - near]
    first = max(near - 3, 0)
    right[rows, first : first + 6] = square[rows, near : near + 6][:, : width - first]

    noisy = np.stack([left, right]) + rng.integers(-12, 13, (2, *left.shape))
    return np.clip(noisy, 0, 255).astype(np.uint8)


def random_masks(seed: int, shape: tuple[int, int]) -> Masks:
    """Return masks with holes, and one whole row of nothing."""
    rng = np.random.default_rng(seed)
    left, right = rng.random((2, *shape)) > 0.15
    left[shape[0] // 2] = False
    return left, right


SETTINGS = st.builds(
    partial(replace, ps.Settings.preset("paper")),
    neighborhood=st.just(3),
    frequencies=st.just((1, 1)),
    noise_threshold=st.sampled_from([0, 0.5]),
    window=st.sampled_from([1, 3, 5]),
    shiftable=st.booleans(),
    precision=st.sampled_from(["full", "byte"]),
    optimizer=st.sampled_from(["dp", "so", "wta", "sgm", "sgm", "sgm"]),
    p1=st.sampled_from([0.5, 1, 3, 4]),
    p2=st.sampled_from([1, 2, 16]),
    adaptive_p2=st.sampled_from([0, 0.3, 1]),
    subpixel=st.booleans(),
    lr_check=st.sampled_from([None, 0, 1]),
    uniqueness=st.sampled_from([0, 0, 5, 30, 100]),
    speckle_size=st.sampled_from([0, 3, 20]),
    speckle_range=st.sampled_from([0, 0.5, 1]),
    guided_median=st.booleans(),
    median=st.sampled_from([0, 3]),
    fill=st.booleans(),
    confidence=st.sampled_from([True]),
    min_confidence=st.sampled_from([0, 0, 0.37, 0.85]),
)


@settings(max_examples=80)
@given(
    seed=st.integers(0, 1000),
    shape=st.tuples(st.integers(1, 11), st.integers(1, 17)),
    low=st.integers(-3, 2),
    wanted=SETTINGS,
    masked=st.booleans(),
    colored=st.booleans(),
)
def test_matches_equal_the_oracle(
    seed: int,
    shape: tuple[int, int],
    low: int,
    wanted: ps.Settings,
    *,
    masked: bool,
    colored: bool,
) -> None:
    number = min(6, shape[1])
    low = min(max(low, 2 - shape[1] - number), shape[1] - 1)
    pair = two_surfaces(seed, (*shape, 3) if colored else shape)
    masks = random_masks(seed, shape) if masked else None
    assert_equals_the_oracle(pair, wanted, (low, number), masks)


@pytest.mark.parametrize("shape", [(150, 21), (67, 18, 3), (13, 170)])
@pytest.mark.parametrize("masked", [False, True])
def test_robust_equals_the_oracle_over_several_bands_and_panels(
    shape: tuple[int, ...], *, masked: bool
) -> None:
    """Paths begin 16 rows outside bands of 64 and 16 columns right of panels of 64."""
    masks = random_masks(3, (shape[0], shape[1])) if masked else None
    result = assert_equals_the_oracle(two_surfaces(4, shape), ROBUST, (0, 7), masks)
    kinds = ps.Flag.OUTSIDE, ps.Flag.FILLED, ps.Flag.OCCLUDED | ps.Flag.MISMATCHED
    assert all((result.flags & kind != 0).any() for kind in kinds)
    assert (result.disparity % 1 > 0).any()


@pytest.mark.parametrize(("optimizer", "least"), [("dp", 0.95), ("so", 0.8), ("wta", 0.95)])
def test_scanlines_can_be_refined_as_well(optimizer: Any, least: float) -> None:
    """Speckles without a check, which leaves few of them; then the check without speckles."""
    spotted = {"window": 3, "p1": 0.1, "p2": 0.1, "speckle_size": 12, "speckle_range": 0.5}
    unclear = {"speckle_size": 0, "lr_check": None, "uniqueness": 20}

    checks: list[tuple[dict[str, Any], int]] = [
        (unclear, ps.Flag.AMBIGUOUS),
        (spotted | {"lr_check": None}, ps.Flag.SPECKLE),
        ({"speckle_size": 0}, ps.Flag.OCCLUDED | ps.Flag.MISMATCHED),
    ]

    for check, kinds in checks:
        small = replace(ROBUST, sizes=1, p1=5.0, p2=20.0, optimizer=optimizer)
        wanted = replace(small, min_confidence=least, **check)
        result = assert_equals_the_oracle(two_surfaces(5, (40, 26)), wanted, (-1, 7))
        for kind in (kinds, ps.Flag.FILLED, ps.Flag.LOW_CONFIDENCE):
            assert (result.flags & kind != 0).any()


# --- the oracle by hand ---


def a_map(*rows: list[float]) -> NDArray[np.float32]:
    return np.array(rows, np.float32)


def chosen_for(row: list[int], own: list[int]) -> refinement.Evidence:
    """Return the choice for one row, and its cost."""
    return refinement.Evidence(
        chosen=np.array([row]),
        own=np.array([own]),
        elsewhere=np.full((1, len(row)), np.inf),
        offset=np.zeros((1, len(row)), np.float32),
    )


def test_paths_count_their_own_costs_twice_again() -> None:
    aggregated, means = np.array([[[3, 1, 2, 9]]]), np.array([[[30, 10, 14, 90]]])
    found = refinement.of_paths(aggregated, means)
    assert [int(each[0, 0]) for each in (found.chosen, found.own, found.elsewhere)] == [1, 10, 90]
    assert found.offset == refinement.offsets(np.array([[[36, 12, 18, 108]]]), found.chosen)


def test_the_check_by_hand() -> None:
    """Of left columns 2, 3 and 5, which choose right column 2, 3 owns it; of 4 and 6, 4 owns 3."""
    found = chosen_for([0, 0, 0, 1, 1, 3, 3, 0], [1, 1, 5, 4, 4, 9, 9, 1])
    none = np.zeros((1, 8), np.int64)

    flags = refinement.check(found, none, 0, 1)[0].tolist()
    mismatched = int(ps.Flag.MISMATCHED)
    assert flags == [0, 0, 0, 0, 0, mismatched, mismatched, 0]

    apart = refinement.check(found, none, 0, 0)[0].tolist()
    assert apart[2] == mismatched

    equal = chosen_for([0, 0, 0, 3], [4, 4, 4, 4])  # of equal costs the nearer one owns
    assert refinement.check(equal, none[:, :4], 0, 1)[0].tolist() == [mismatched, 0, 0, 0]
    # 2, 3, 5 and 7 own their matches; beside 0 there is none of them.
    wide = chosen_for([0, 0, 2, 2, 2, 2, 5, 5], [1] * 4 + [9] * 4)
    hidden = refinement.check(wide, none, 0, 0)[0]
    occluded = int(ps.Flag.OCCLUDED)
    assert hidden.tolist() == [occluded, mismatched, 0, 0, mismatched, 0, mismatched, 0]


def test_regions_hang_together_by_steps() -> None:
    disparity = a_map([1, 2, 3, 9], [9, 9, 9, 8])
    flags = np.zeros((2, 4), np.int64)

    small = refinement.flag_speckles(disparity, flags, 3, 1.0) != 0
    assert small.tolist() == [[True, True, True, False], [False] * 4]
    assert not refinement.flag_speckles(disparity, flags, 2, 1.0).any()
    assert refinement.flag_speckles(disparity, flags, 1, 0.5)[0, :3].all()

    flags[0, 1] = ps.Flag.OUTSIDE
    split = refinement.flag_speckles(disparity, flags, 1, 1.0)
    assert (split[0, [0, 2]] == ps.Flag.SPECKLE).all()
    assert split[0, 1] == ps.Flag.OUTSIDE


def test_votes_and_confidence_by_hand() -> None:
    found = replace(chosen_for([0, 0, 0], [10, 10, 20]), elsewhere=np.array([[50, np.inf, 10]]))
    np.testing.assert_allclose(refinement.reliability(found, 10.0), [[0.5, 0, 0]])

    reliable, gray = np.array([[0.5, 0, 1.0]]), np.zeros((1, 3), np.int64)
    cube = 0.75**3
    np.testing.assert_allclose(
        refinement.confidence(a_map([1, 1, 2]), reliable, gray)[0],
        [cube / (cube + 0.01), 0, cube / (cube + 0.01)],
    )

    apart = refinement.confidence(a_map([1, NAN, 9]), reliable, gray)[0]
    np.testing.assert_allclose(apart, [0.25**3 / (0.25**3 + 0.01), 0, 0.125 / 0.135])

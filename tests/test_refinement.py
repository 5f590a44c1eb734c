"""Whole matches with all that refines them, held to the oracle, and the oracle to hand-made maps."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oracle
import oracle_refinement as refinement
import phasestereo as ps
from test_descriptor import decoded, decoded_parts

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Masks = tuple[NDArray[np.bool_], NDArray[np.bool_]]

NAN = np.nan
NOISE = 3.0
ROBUST = replace(ps.PRESETS["robust"], equalise=False)


def volume_of(
    pair: NDArray[Any], settings: ps.Settings, search: tuple[int, int], masks: Masks | None
) -> tuple[NDArray[np.int64], int]:
    """Return the oracle's aggregated costs of phase codes, and how many bits they lost."""
    r, s = settings.frequencies
    components = r * (2 * s + 1) + s
    noise = {"noise": NOISE} if settings.weak else {}
    codes = [
        ps.descriptor(image, mask=mask, settings=settings, **noise)
        for image, mask in zip(pair, masks or (None, None), strict=True)
    ]
    if settings.weak:
        ceiling = 4 * components
        parts = [decoded_parts(code, components) for code in codes]
        costs = oracle.weak_costs(parts[0], parts[1], *search)
    else:
        ceiling = components * 2 ** (settings.bits - 1)
        levels = [decoded(code, components, settings.bits) for code in codes]
        costs = oracle.phase_costs(levels[0], levels[1], *search, settings.bits)
    byte = settings.precision == "byte"
    dropped = oracle.dropped_bits(settings.window, ceiling) if byte else 0
    volume = oracle.aggregate(
        costs,
        settings.window,
        shiftable=settings.shiftable,
        votes=None if masks is None else oracle.votes(*masks, *search),
        ceiling=ceiling,
        dropped=dropped,
    )
    return volume, dropped


def evidence_of(
    volume: NDArray[np.int64], settings: ps.Settings, dropped: int, gray: NDArray[np.int64]
) -> tuple[refinement.Evidence, float]:
    """Return what the oracle chooses, and what one bit in every pixel of the window comes to."""
    both = settings.penalty
    near, far = (
        oracle.window_penalty(each, settings.window, dropped)
        for each in (both if isinstance(both, tuple) else (both, both))
    )
    unit = settings.window**2 / 2**dropped
    if settings.optimizer == "sgm":
        sums = oracle.path_sums(volume, near, far, gray, settings.edges)
        return refinement.of_paths(volume, sums), unit * refinement.PATHS
    chosen = {
        "dp": lambda: oracle.scanline(volume, near, far),
        "so": lambda: oracle.free_scanline(volume, near, far),
        "wta": lambda: oracle.winner_takes_all(volume),
    }[settings.optimizer]()
    return refinement.of_scanlines(volume, chosen), unit


def assert_equals_the_oracle(
    pair: NDArray[Any], settings: ps.Settings, search: tuple[int, int], masks: Masks | None = None
) -> ps.Result:
    """Check a match against the oracle in all that it returns; return it."""
    low, number = search
    options: dict[str, Any] = {"min_disparity": low, "num_disparities": number}
    if masks is not None:
        options |= {"left_mask": masks[0], "right_mask": masks[1]}
    if settings.weak:
        options["noise"] = NOISE
    result = ps.match(*pair, settings=settings, **options)
    everything = np.ones(pair.shape[1:3], bool)
    thousandths = 1000 if pair.ndim == 4 else 1
    gray = np.rint(thousandths * oracle.to_gray(pair[0])).astype(np.int64)
    gray = gray if masks is None else oracle.fill_masked(gray, masks[0])
    volume, dropped = volume_of(pair, settings, search, masks)
    evidence, unit = evidence_of(volume, settings, dropped, gray)
    disparity, flags = refinement.refine(
        evidence,
        gray,
        low=low,
        number=number,
        masks=masks or (everything, everything),
        settings=settings,
    )
    trust = np.ones(disparity.shape)
    if result.confidence is not None:
        # Whether disparities agree that are one apart may depend on the last bit.
        voices = refinement.votes(evidence, unit)
        least, most = (
            refinement.confidence(disparity, voices, gray, agree) for agree in (0.99999, 1.00001)
        )
        assert (result.confidence >= least - 1e-5).all()
        assert (result.confidence <= most + 1e-5).all()
        trust = result.confidence
    disparity, flags = refinement.withdraw(
        disparity, flags, trust, least=settings.min_confidence, filled=settings.fill
    )
    np.testing.assert_array_equal(result.flags, flags)
    np.testing.assert_allclose(result.disparity, disparity, rtol=0, atol=1e-5)
    if not settings.subpixel:
        np.testing.assert_array_equal(result.disparity, disparity)
    return result


def two_surfaces(seed: int, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return a pair: a square in front of a plane, of blocks of noise, with a little noise on it."""
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
    ps.Settings,
    neighborhood=st.just(3),
    frequencies=st.just((1, 1)),
    weak=st.sampled_from([0, 0.5]),
    window=st.sampled_from([1, 3, 5]),
    shiftable=st.booleans(),
    precision=st.sampled_from(["full", "byte"]),
    optimizer=st.sampled_from(["dp", "so", "wta", "sgm", "sgm", "sgm"]),
    penalty=st.sampled_from([1, (0.5, 2), (4, 16), (3, 1)]),
    edges=st.sampled_from([0, 0.3, 1]),
    subpixel=st.booleans(),
    consistency=st.sampled_from([None, 0, 1]),
    speckle_size=st.sampled_from([0, 3, 20]),
    speckle_range=st.sampled_from([0, 0.5, 1]),
    guided=st.booleans(),
    median=st.sampled_from([0, 3]),
    fill=st.booleans(),
    confidence=st.just(True),
    min_confidence=st.sampled_from([0, 0, 0.37, 0.85]),
)


@settings(max_examples=80)
@given(
    seed=st.integers(0, 1000),
    shape=st.tuples(st.integers(1, 11), st.integers(1, 17)),
    low=st.integers(-3, 2),
    wanted=SETTINGS,
    masked=st.booleans(),
    coloured=st.booleans(),
)
def test_matches_equal_the_oracle(
    seed: int,
    shape: tuple[int, int],
    low: int,
    wanted: ps.Settings,
    *,
    masked: bool,
    coloured: bool,
) -> None:
    number = min(6, shape[1])
    low = min(max(low, 2 - shape[1] - number), shape[1] - 1)
    pair = two_surfaces(seed, (*shape, 3) if coloured else shape)
    masks = random_masks(seed, shape) if masked else None
    assert_equals_the_oracle(pair, wanted, (low, number), masks)


@pytest.mark.parametrize("shape", [(71, 21), (33, 18, 3)])
@pytest.mark.parametrize("masked", [False, True])
def test_robust_equals_the_oracle_over_several_bands(
    shape: tuple[int, ...], *, masked: bool
) -> None:
    """Paths come up from 16 rows under bands of 32, whatever rows there are."""
    masks = random_masks(3, (shape[0], shape[1])) if masked else None
    result = assert_equals_the_oracle(two_surfaces(3, shape), ROBUST, (0, 7), masks)
    kinds = ps.Flag.OUTSIDE, ps.Flag.FILLED, ps.Flag.OCCLUDED | ps.Flag.MISMATCHED
    assert all((result.flags & kind != 0).any() for kind in kinds)
    assert (result.disparity % 1 > 0).any()


@pytest.mark.parametrize("optimizer", ["dp", "so", "wta"])
def test_scanlines_can_be_refined_as_well(optimizer: Any) -> None:
    """Speckles without a check, which leaves few of them; then the check without speckles."""
    spotted = {"window": 3, "penalty": 0.1, "speckle_size": 12, "speckle_range": 0.5}
    checks: list[tuple[dict[str, Any], int]] = [
        (spotted | {"consistency": None}, ps.Flag.SPECKLE),
        ({"speckle_size": 0}, ps.Flag.OCCLUDED | ps.Flag.MISMATCHED),
    ]
    for check, kinds in checks:
        wanted = replace(ROBUST, optimizer=optimizer, min_confidence=0.5, **check)
        result = assert_equals_the_oracle(two_surfaces(5, (40, 26)), wanted, (-1, 7))
        for kind in (kinds, ps.Flag.FILLED, ps.Flag.LOW_CONFIDENCE):
            assert (result.flags & kind != 0).any()

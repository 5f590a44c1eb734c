"""Phase codes, held to the oracle: the paper's formulas in floating point."""

from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray

import phasestereo as ps
from support import oracle

Taper = Literal["uniform", "gaussian", "hann"]

# How far a component was found to be from the exact one at most, per unit of gray summed over its
# neighborhood, for L = 1: the integer tables are rounded to steps of L / 1000, and the errors of L
# taps cancel, so that what is left grows as the root of L.
TABLE_ERROR = 0.0004

FAMILIES = [
    (neighborhood, r, s, power, bits)
    for neighborhood in (3, 5, 7, 9, 15)
    for r, s in ((0, 1), (1, 0), (1, 1), (2, 1), (3, 2), (4, 4))
    for power in (1, 2)
    for bits in (1, 2, 3, 4)
    if max(r, s) <= (neighborhood - 1) // 2 and (r * (2 * s + 1) + s) << (bits - 1) <= 64
]


def decoded(codes: NDArray[Any], components: int, bits: int) -> NDArray[np.int64]:
    """Return the levels that packed Johnson codes stand for, (H, W, D) in [-2^(b-1), 2^(b-1))."""
    length = 1 << (bits - 1)
    shifts = np.arange(components, dtype=np.uint64) * np.uint64(length)
    words = (codes.astype(np.uint64)[..., None] >> shifts) & np.uint64((1 << length) - 1)

    ones = np.bitwise_count(words).astype(np.int64)
    rising = (words & np.uint64(1)).astype(bool) | (ones == 0)

    level = np.where(rising, ones, 2 * length - ones)
    signed: NDArray[np.int64] = np.where(level < length, level, level - 2 * length)
    return signed


def uncertainty(gray: NDArray[np.float64], neighborhood: int) -> NDArray[np.float64]:
    """Return the bound on errors of integer components, for every pixel."""
    absolute = np.abs(gray - gray.mean())
    half = neighborhood // 2
    padded = np.pad(absolute, half, mode="symmetric")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (neighborhood, neighborhood))
    bound: NDArray[np.float64] = (
        TABLE_ERROR * neighborhood**0.5 * windows.sum((2, 3))[..., None] + 1e-9
    )
    return bound


def assert_few(near: NDArray[Any], neighborhood: int) -> None:
    """Check that few values are so near a boundary that the rounding of tables may move them."""
    most = 0.25 if neighborhood < 15 else 0.4  # the larger it is, the coarser the tables
    assert near.mean() < most, "the bound excuses too much to be a test"


def assert_like_oracle(
    image: NDArray[Any], family: tuple[int, ...], taper: Taper = "uniform"
) -> None:
    neighborhood, r, s, power, bits = family
    codes = ps.descriptor(
        image, neighborhood=neighborhood, frequencies=(r, s), power=power, bits=bits, taper=taper
    )

    gray = oracle.to_gray(image)
    spectrum = oracle.spectrum(gray, neighborhood, r, s, taper)
    levels = decoded(codes, spectrum.shape[2], bits)

    near = oracle.boundary_distance(spectrum, power, bits) <= uncertainty(gray, neighborhood)
    expected = oracle.levels(spectrum, power, bits)

    np.testing.assert_array_equal(levels[~near], expected[~near])
    assert_few(near, neighborhood)


@pytest.mark.parametrize("family", FAMILIES)
def test_codes_follow_the_formulas(family: tuple[int, ...]) -> None:
    image = np.random.default_rng(3).integers(0, 256, (17, 23), np.uint8)
    assert_like_oracle(image, family)


@pytest.mark.parametrize("taper", ["gaussian", "hann"])
@pytest.mark.parametrize("family", [(7, 2, 1, 1, 2), (15, 4, 4, 1, 1), (9, 2, 2, 2, 3)])
def test_tapered_codes_follow_the_formulas(family: tuple[int, ...], taper: Taper) -> None:
    image = np.random.default_rng(4).integers(0, 256, (12, 19, 3), np.uint8)
    assert_like_oracle(image, family, taper)


def decoded_parts(codes: NDArray[Any], components: int) -> NDArray[np.int64]:
    """Return the levels -1, 0 and 1 that codes with a weak level stand for, (H, W, D, 2)."""
    shifts = np.arange(4 * components, dtype=np.uint64)
    ones = codes.astype(np.uint64)[..., None] >> shifts & np.uint64(1)
    each = ones.astype(np.int64).reshape(*codes.shape, components, 2, 2)
    signed: NDArray[np.int64] = each[..., 1, :] - each[..., 0, :]
    return signed


@pytest.mark.parametrize("taper", ["uniform", "gaussian", "hann"])
@pytest.mark.parametrize("weak", [0.3, 2.0, 100.0])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("family", [(7, 1, 1, 1), (9, 2, 1, 2)])
def test_weak_parts_follow_the_formulas(
    family: tuple[int, int, int, int], dtype: type[np.generic], weak: float, taper: Taper
) -> None:
    neighborhood, r, s, power = family

    unit = 255 if dtype is np.uint8 else 40_000
    image = (np.random.default_rng(7).random((14, 19, 3)) * unit).astype(dtype)
    noise = 0.13 * unit

    codes = ps.descriptor(
        image,
        neighborhood=neighborhood,
        frequencies=(r, s),
        power=power,
        taper=taper,
        noise_threshold=weak,
        noise=noise,
    )

    gray = oracle.to_gray(image)
    spectrum = oracle.spectrum(gray, neighborhood, r, s, taper)
    threshold = oracle.weak_threshold(noise, weak, neighborhood, taper)
    found = decoded_parts(codes, spectrum.shape[2])
    expected = oracle.weak_levels(spectrum, power, threshold)

    # The threshold is made of the rounded window: off by less than a part in a thousand.
    off = uncertainty(gray, neighborhood)[..., None]
    scale = power * np.abs(spectrum[..., None]) ** (power - 1)
    reach = scale * off + off**power + 1e-3 * power * threshold**power
    near = np.abs(np.abs(oracle.parts(spectrum, power)) - threshold**power) <= reach

    np.testing.assert_array_equal(found[~near], expected[~near])
    assert_few(near, neighborhood)
    assert weak == 100 or {-1, 0, 1} == set(np.unique(expected))


@pytest.mark.parametrize("weak", [0.0, 0.7])
def test_two_sizes_are_both_of_them(weak: float) -> None:
    image = np.random.default_rng(8).integers(0, 256, (15, 22, 3), np.uint8)

    options: dict[str, Any] = {"noise_threshold": weak, "noise": 20.0}
    found = ps.descriptor(image, neighborhood=5, frequencies=(2, 1), sizes=2, **options)
    larger = ps.descriptor(image, neighborhood=7, frequencies=(1, 1), **options).astype(np.uint64)
    smaller = ps.descriptor(image, neighborhood=5, frequencies=(2, 1)).astype(np.uint64)

    length = 4 if weak else 2
    ones = np.uint64((1 << length) - 1)
    # (0, 1) is the first component of the larger one, (1, 0) the third, after (1, -1).

    axes = larger & ones | (larger >> np.uint64(2 * length) & ones) << np.uint64(length)
    assert_nearly_same(found, axes | smaller << np.uint64(2 * length))


def test_a_single_axis_takes_no_room_for_the_other() -> None:
    image = np.random.default_rng(8).integers(0, 256, (15, 22), np.uint8)
    for frequencies in ((0, 1), (1, 0)):
        found = ps.descriptor(image, neighborhood=3, frequencies=frequencies, sizes=2)
        each = [ps.descriptor(image, neighborhood=n, frequencies=frequencies) for n in (5, 3)]
        assert_nearly_same(found, each[0] | each[1] << 2)


def assert_nearly_same(found: NDArray[Any], expected: NDArray[Any]) -> None:
    """Hold codes of two sizes against those of each: their tables are coarser, to fit 32 bits."""
    apart = found.astype(np.uint64) ^ expected.astype(np.uint64)
    assert not np.any(apart & (apart - (apart > 0))), "a code differs by more than one bit"
    assert (apart > 0).mean() < 0.05


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"sizes": 0}, "^sizes: got 0; accepts an integer from 1 to 2"),
        ({"sizes": 3}, "^sizes: got 3; accepts an integer from 1 to 2"),
        (
            {"sizes": 2, "neighborhood": 63},
            "^sizes: got 2 with neighborhood = 63; accepts 1 unless",
        ),
        (
            {"sizes": 2, "neighborhood": 9, "frequencies": (4, 2), "bits": 3},
            "^frequencies .* which need 96 bits",
        ),
    ],
)
def test_two_sizes_must_fit(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(ps.Settings.preset("paper"), **fields)


def test_a_weak_level_needs_the_noise() -> None:
    image = np.zeros((4, 5), np.uint8)

    with pytest.raises(ValueError, match="^noise: got None; accepts"):
        ps.descriptor(image, noise_threshold=1.0)

    assert not ps.descriptor(image, noise_threshold=1.0, noise=0.0).any(), "all parts are weak"

    with pytest.raises(ValueError, match="^noise: got -1; accepts"):
        ps.descriptor(image, noise=-1.0)

    with pytest.raises(TypeError, match="^noise: got str; accepts a number"):
        ps.descriptor(image, noise="1")  # type: ignore[arg-type]  # that is the point


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
def test_every_type_keeps_its_precision(dtype: type[np.generic]) -> None:
    rng = np.random.default_rng(5)
    scale = 255 if dtype is np.uint8 else 65535
    image = (rng.random((20, 30, 3)) * scale).astype(dtype)
    assert_like_oracle(image, (7, 2, 1, 1, 2))


def test_the_largest_neighborhood_is_no_exception() -> None:
    image = np.random.default_rng(6).integers(0, 65536, (9, 70), np.uint16)
    assert_like_oracle(image, (63, 4, 4, 1, 1))


@given(
    seed=st.integers(0, 1000),
    shift=st.integers(1, 7),
    rows=st.integers(1, 9),
    cols=st.integers(1, 9),
    taper=st.sampled_from(["uniform", "gaussian", "hann"]),
)
def test_scale_and_type_change_no_code(
    seed: int, shift: int, rows: int, cols: int, taper: Taper
) -> None:
    image = np.random.default_rng(seed).integers(0, 256, (rows, cols, 3), np.uint8)
    codes = ps.descriptor(image, taper=taper)

    wide = image.astype(np.uint16) << shift
    np.testing.assert_array_equal(ps.descriptor(wide, taper=taper), codes)

    for dtype in ("f4", "f8"):
        real: NDArray[Any] = image.astype(dtype)
        np.testing.assert_array_equal(
            ps.descriptor(real * 2.0**shift, taper=taper), ps.descriptor(real, taper=taper)
        )


@given(seed=st.integers(0, 1000), offset=st.integers(-50, 50), bits=st.integers(1, 4))
def test_an_offset_changes_no_code(seed: int, offset: int, bits: int) -> None:
    image = np.random.default_rng(seed).integers(50, 206, (8, 11), np.uint8)
    moved = (image.astype(int) + offset).astype(np.uint8)
    np.testing.assert_array_equal(ps.descriptor(moved, bits=bits), ps.descriptor(image, bits=bits))
    real = image.astype(np.float32)
    np.testing.assert_array_equal(
        ps.descriptor(real + np.float32(offset), bits=bits), ps.descriptor(real, bits=bits)
    )


def test_words_are_the_narrowest() -> None:
    image = np.zeros((3, 4), np.uint8)
    assert ps.descriptor(image).dtype == np.uint16
    assert ps.descriptor(image, bits=3).dtype == np.uint32
    assert ps.descriptor(image, bits=4).dtype == np.uint64

    assert (
        ps.descriptor(image, frequencies=(1, 1), noise_threshold=1.0, noise=1.0).dtype == np.uint16
    )

    assert not ps.descriptor(image).any(), "nothing but ties: level 0 throughout"


def test_masked_pixels_have_no_effect_on_others() -> None:
    rng = np.random.default_rng(7)
    image = rng.random((15, 20))

    mask = rng.random((15, 20)) > 0.2
    hidden = np.where(mask, image, np.nan)
    filled = oracle.fill_masked(image, mask)

    options: dict[str, Any] = {"intensity_range": (0.0, 1.0)}
    codes = ps.descriptor(hidden, mask=mask, **options)
    np.testing.assert_array_equal(codes, ps.descriptor(filled, **options))

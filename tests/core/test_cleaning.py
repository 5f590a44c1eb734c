"""Impulses, noise and compression: found out, and done away with before images are compared."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

import phasestereo as ps
from phasestereo.metrics import bad_pixels
from phasestereo_bench.rendering import render_pair
from support import oracle

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Pixels = NDArray[Any]

COUNT = 32
SEARCH: dict[str, Any] = {"num_disparities": COUNT}
SCENE = render_pair(5, height=200, width=260, num_disparities=COUNT)


def hot(image: Pixels, share: float, seed: int) -> Pixels:
    """Return the image with this many black and white pixels."""
    rng = np.random.default_rng(seed)
    spoilt = image.copy()
    places = rng.random(image.shape[:2]) < share
    white = np.iinfo(image.dtype).max if image.dtype.kind == "u" else 1.0
    values = rng.choice([0, white], int(places.sum()))
    spoilt[places] = values if image.ndim == 2 else values[:, np.newaxis]
    return spoilt


def compressed(image: Pixels, quality: int, crop: tuple[int, int] = (0, 0)) -> Pixels:
    """Return the image after JPEG, cut off at the left and the top."""
    padded = np.pad(image, ((crop[0], 0), (crop[1], 0), (0, 0)), mode="edge")
    content = io.BytesIO()
    Image.fromarray(padded).save(content, "JPEG", quality=quality)
    return np.array(Image.open(content).convert("RGB"))[crop[0] :, crop[1] :]


def wrong(result: ps.Result) -> float:
    assert SCENE.truth is not None
    return bad_pixels(result.disparity, SCENE.truth, 1.0, SCENE.masks["nonocc"])


def noisy(image: Pixels, deviation: float, seed: int) -> Pixels:
    rng = np.random.default_rng(seed)
    return np.clip(np.rint(rng.normal(image, deviation)), 0, 255).astype(np.uint8)


# --- how it is done ---


def test_impulses_are_repaired_as_by_the_oracle() -> None:
    left, right = (hot(SCENE.left[:, :, 1], 0.02, 1), hot(SCENE.right[:, :, 1], 0.02, 2))

    heights = 20.0, 3.5
    versions = ps.BlurCompensation(noise=(1, 1), impulses=heights)

    found = ps.cost_volume(left, right, **SEARCH, known=ps.Known(blur_compensation=versions))

    repaired = [
        np.floor(oracle.without_impulses(image.astype(float), height)).astype(np.uint8)
        for image, height in zip((left, right), heights, strict=True)
    ]

    assert all((repaired[side] != (left, right)[side]).mean() > 0.01 for side in (0, 1))
    np.testing.assert_array_equal(found, ps.cost_volume(*repaired, **SEARCH))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
def test_images_are_smoothed_as_by_the_oracle(dtype: type[np.generic]) -> None:
    unit = {"u": 1, "f": 1e-3}[np.dtype(dtype).kind] * (100 if dtype is np.uint16 else 1)
    # Values of more than 8 bits, or they would be processed as bytes.
    finer = np.random.default_rng(4).integers(0, 100, (2, *SCENE.left.shape)) / 100
    finer *= dtype is not np.uint8
    images = zip((SCENE.left, SCENE.right), finer, strict=True)
    left, right = ((unit * (0.9 * image + more)).astype(dtype) for image, more in images)

    deviations = 5.0 * unit, 9.0 * unit
    versions = ps.BlurCompensation(noise=(1, 1), smoothing=deviations)

    found = ps.cost_volume(left, right, **SEARCH, known=ps.Known(blur_compensation=versions))

    smoothed = [
        oracle.guided_filter(oracle.to_gray(image), deviation)
        for image, deviation in zip((left, right), deviations, strict=True)
    ]

    expected = ps.cost_volume(*smoothed, **SEARCH)
    # Steps of gray values are not the same: signs of components that are nearly zero may differ.
    # Bytes are smoothed in sixteenths of a gray level.
    assert np.abs(found.astype(int) - expected).mean() < (0.06 if dtype is np.uint8 else 0.03)

    plain = ps.cost_volume(left, right, **SEARCH)
    assert np.abs(found.astype(int) - plain).mean() > 0.3


def test_smoothing_comes_before_the_kernels() -> None:
    kernel = np.full((3, 3), 1 / 9)
    versions = ps.BlurCompensation(noise=(1, 1), smoothing=(8, 8), kernels=[(kernel, None)])
    found = ps.cost_volume(
        SCENE.left, SCENE.right, **SEARCH, known=ps.Known(blur_compensation=versions)
    )
    smoothed = [oracle.guided_filter(oracle.to_gray(i), 8) for i in (SCENE.left, SCENE.right)]
    expected = ps.cost_volume(oracle.convolve(smoothed[0], kernel), smoothed[1], **SEARCH)
    assert np.abs(found.astype(int) - expected).mean() < 0.06


@pytest.mark.parametrize("name", ["impulses", "smoothing"])
@pytest.mark.parametrize(
    ("value", "error"),
    [((-1, 0), ValueError), ((0, np.nan), ValueError), ((0, "1"), TypeError), (2.0, TypeError)],
)
def test_what_is_no_deviation_is_refused(name: str, value: object, error: type) -> None:
    wanted: dict[str, Any] = {name: value}
    with pytest.raises(error, match=name):
        ps.BlurCompensation(noise=(1, 1), **wanted)


# --- what is found out ---


@pytest.mark.parametrize("share", [0, 1e-3, 1e-2])
@pytest.mark.parametrize("dtype", ["uint8", "uint16", "12 bits", "float32"])
def test_impulses_are_found_in_any_type(dtype: str, share: float) -> None:
    gray = SCENE.left[:, :, 1], SCENE.right[:, :, 1]

    spoilt = [hot(image, share, seed) for seed, image in enumerate(gray)]

    convert = {
        "uint8": lambda image: image,
        "uint16": lambda image: 257 * image.astype(np.uint16),
        "12 bits": lambda image: 16 * image.astype(np.uint16),
        "float32": lambda image: (image / 255).astype(np.float32),
    }[dtype]

    left, right = map(convert, spoilt)
    found = ps.estimate_blur(left, right, **SEARCH)

    assert oracle.has_impulses(spoilt[0].astype(float), 1) == (share > 0)
    level = {"uint8": 1, "uint16": 256, "12 bits": 16, "float32": 1 / 256}[dtype]
    height = 20 * level if share else 0
    assert found.impulses == pytest.approx((height, height), rel=0.3)

    clean = ps.estimate_blur(*map(convert, gray), **SEARCH)
    assert found.noise == pytest.approx(clean.noise, rel=0.5, abs=0.5 * level)


@pytest.mark.parametrize("crop", [(0, 0), (3, 5), (7, 1)])
def test_compression_is_found_wherever_blocks_begin(crop: tuple[int, int]) -> None:
    pair = [noisy(image, 1, seed) for seed, image in enumerate((SCENE.left, SCENE.right))]

    lost = [0.0]
    for quality in (80, 50, 20):
        left, right = (compressed(image, quality, crop) for image in pair)
        found = ps.estimate_blur(left, right, **SEARCH)
        expected = [6 * oracle.block_jump(oracle.to_gray(image), 1) for image in (left, right)]
        assert found.coding == pytest.approx(expected, rel=1e-9)
        lost.append(min(found.coding))

    assert lost == sorted(lost)
    assert lost[-1] > 3
    assert max(ps.estimate_blur(*pair, **SEARCH).coding) < 0.5


# --- what it is good for ---


def test_hot_pixels_cost_next_to_nothing() -> None:
    clean = ps.match(SCENE.left, SCENE.right, **SEARCH)
    spoilt = hot(SCENE.left, 0.01, 1), hot(SCENE.right, 0.01, 2)
    repaired = wrong(ps.match(*spoilt, **SEARCH))
    assert repaired < wrong(clean) + 0.3
    assert wrong(ps.match(*spoilt, **SEARCH, despike=False)) > repaired + 0.5


def test_noise_and_compression_cost_less() -> None:
    pairs = {
        "noise": (noisy(SCENE.left, 12, 1), noisy(SCENE.right, 12, 2)),
        "compression": (compressed(SCENE.left, 20), compressed(SCENE.right, 20)),
    }
    for name, pair in pairs.items():
        rough = wrong(ps.match(*pair, **SEARCH, denoise=False))
        assert wrong(ps.match(*pair, **SEARCH)) < 0.99 * rough, name


# --- once for the whole of a pair ---


def test_estimates_of_a_stream_are_taken_over_with_impulses() -> None:
    rig = ps.Rig(**SEARCH)

    spoilt = hot(SCENE.left, 0.01, 1), hot(SCENE.right, 0.01, 2)
    first = rig.match(*spoilt)
    assert first.blur is not None

    again = rig.match(*(noisy(image, 0.3, 9) for image in spoilt))
    assert again.blur is not None
    assert again.blur.reused
    assert again.blur.impulses == first.blur.impulses == (20, 20)


@pytest.mark.parametrize("name", ["despike", "denoise"])
def test_only_phase_codes_know_of_it(name: str) -> None:
    wanted: dict[str, Any] = {name: True}
    assert getattr(ps.Settings(**wanted), name)
    with pytest.raises(ValueError, match=f"{name}: got True; accepts False unless cost = 'phase'"):
        replace(ps.Settings.preset("paper"), cost="sad", **wanted)
    wrong_type: dict[str, Any] = {name: 2}
    with pytest.raises(TypeError, match=name):
        ps.Settings(**wrong_type)

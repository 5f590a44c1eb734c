"""Analysis by synthesis: against the oracle, in every way a pair can be given."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.rig.compensation import BlurCompensation
from phasestereo_bench.degradation import convolve, disk_psf
from support import oracle, oracle_synthesis as synthesis

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Gray = NDArray[np.uint8]

SIZE = 60, 84
NEAR, FAR = 9, 3
WEAK, NOISE = 0.5, (1.0, 2.0)
BLUR = disk_psf(4)
SEARCH: dict[str, Any] = {"num_disparities": 12}
SETTINGS = replace(
    ps.Settings.preset("paper"),
    neighborhood=5,
    frequencies=(1, 1),
    noise_threshold=WEAK,
    window=7,
    shiftable=False,
    optimizer="sgm",
    p1=5.0,
    p2=20.0,
)


def square(grown: int = 0) -> NDArray[np.float32]:
    """Return the disparities of a square before a background."""
    truth = np.full(SIZE, FAR, np.float32)
    truth[18 - grown : 42 + grown, 30 - grown : 60 + grown] = NEAR
    return truth


def pair() -> tuple[Gray, Gray]:
    """Return the images of it."""
    rng = np.random.default_rng(8)

    near, far = (np.kron(rng.integers(0, 200, (30, 60)), np.ones((2, 2))) for _ in range(2))
    truth = square()

    left = np.where(truth == NEAR, near[:, : SIZE[1]], far[:, : SIZE[1]])
    right = far[:, FAR : FAR + SIZE[1]].copy()

    y, x = np.nonzero(truth == NEAR)
    right[y, x - NEAR] = near[y, x]
    return left.astype(np.uint8), right.astype(np.uint8)


def soft(side: str, psf: NDArray[Any] = BLUR) -> tuple[tuple[Gray, Gray], BlurCompensation]:
    """Return the pair with a blurred image, and the versions that even it out."""
    left, right = pair()
    if side == "left":
        images = np.rint(convolve(left, psf)).astype(np.uint8), right
        return images, BlurCompensation(noise=NOISE, kernels=[(None, psf)])
    images = left, np.rint(convolve(right, psf)).astype(np.uint8)
    return images, BlurCompensation(noise=NOISE, kernels=[(psf, None)])


def wrong(disparity: NDArray[np.float32]) -> int:
    return int((np.abs(disparity - square()) > 1).sum())


@pytest.mark.parametrize("side", ["left", "right", "areas"])
def test_a_map_is_redrawn_as_the_oracle_says(side: str) -> None:
    images, versions = soft("left" if side == "areas" else side)
    kernels: Any = versions.kernels

    if side == "areas":
        kernels = [*kernels, (BLUR, None), (None, None), (None, disk_psf(2))]
        labels = np.array([[0, 1, 2, 3, 0, 1], [1, 0, 0, 1, 3, 2]], np.uint8)
        versions = replace(versions, kernels=kernels, labels=labels, tile=16)

    options: dict[str, Any] = {
        **SEARCH,
        "settings": SETTINGS,
        "known": ps.Known(blur_compensation=versions),
        "align_rows": False,
        "sizes": 1,
    }

    before = ps.match(*images, **options).disparity
    found = ps.match(*images, **options, synthesis=True).disparity

    left, right = (image.astype(np.float64) - 128 for image in images)
    redrawn = synthesis.synthesize(
        (left, right),
        before,
        kernels,
        oracle.class_map(versions.labels, versions.tile, SIZE),
        L=5,
        weak=(
            oracle.weak_threshold(NOISE[0], WEAK, 5),
            oracle.weak_threshold(NOISE[1], WEAK, 5),
        ),
    )

    expected = synthesis.outline(redrawn, left)
    assert (redrawn != before).mean() > 0.01

    # Its codes are not rounded: a few bits differ, and where two maps are as good so do these.
    assert (found != expected).mean() < 0.02


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
def test_fat_outlines_become_thin(side: str, dtype: type[np.generic]) -> None:
    images, versions = soft(side)
    given = tuple(image.astype(dtype) for image in images)

    options: dict[str, Any] = {
        **SEARCH,
        "known": ps.Known(blur_compensation=versions),
        "neighborhood": 5,
        "window": 7,
        "align_rows": False,
        "sizes": 1,
    }

    before = ps.match(*given, **options, synthesis=False)
    after = ps.match(*given, **options)

    assert wrong(after.disparity) < 0.85 * wrong(before.disparity)
    np.testing.assert_array_equal(after.flags, before.flags)


def test_without_blur_nothing_changes() -> None:
    for noise in (None, 1.0):
        options: dict[str, Any] = {**SEARCH, "known": ps.Known(noise=noise)}
        found = [ps.match(*pair(), **options, synthesis=on) for on in (False, True)]
        np.testing.assert_array_equal(found[0].disparity, found[1].disparity)
        assert found[0].confidence is not None
        np.testing.assert_array_equal(found[0].confidence, found[1].confidence)


def test_masked_pixels_have_no_effect_and_no_disparity() -> None:
    (left, right), versions = soft("left")

    rng = np.random.default_rng(1)
    masks = {"left_mask": rng.random(SIZE) > 0.1, "right_mask": rng.random(SIZE) > 0.1}
    options: dict[str, Any] = {
        **SEARCH,
        **masks,
        "known": ps.Known(blur_compensation=versions),
        "neighborhood": 5,
    }

    expected = ps.match(left, right, **options)
    lost = [
        np.where(mask, image, 255)
        for image, mask in zip((left, right), masks.values(), strict=True)
    ]

    found = ps.match(*lost, **options)
    np.testing.assert_array_equal(found.disparity, expected.disparity)
    assert np.isnan(found.disparity[~masks["left_mask"]]).all()


@pytest.mark.parametrize("side", ["left", "right"])
def test_threads_change_nothing(side: str) -> None:
    images, versions = soft(side)

    options: dict[str, Any] = {
        **SEARCH,
        "known": ps.Known(blur_compensation=versions),
        "align_rows": False,
        "sizes": 1,
    }

    found = [ps.match(*images, **options, threads=threads).disparity for threads in (1, 3)]
    np.testing.assert_array_equal(found[0], found[1])

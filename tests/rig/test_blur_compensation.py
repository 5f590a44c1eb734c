"""Versions of the images: each pixel is compared in those of its class, as the oracle does it."""

from __future__ import annotations

import pickle
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.rig.compensation import BlurCompensation
from support import oracle

if TYPE_CHECKING:
    from numpy.typing import NDArray

RNG = np.random.default_rng(3)
LEFT, RIGHT = RNG.integers(0, 256, (2, 33, 70), np.uint8)
LABELS = RNG.integers(0, 3, (3, 5)).astype(np.uint8)
LEFT_MASK, RIGHT_MASK = RNG.random((2, *LEFT.shape)) > 0.2
SEARCH: dict[str, Any] = {"num_disparities": 9, "min_disparity": -2}


def one_tap(dy: int, dx: int) -> NDArray[np.float64]:
    kernel = np.zeros((5, 7))
    kernel[2 + dy, 3 + dx] = 1
    return kernel


MOVES = [(None, one_tap(1, -2)), (one_tap(0, 3), None), (one_tap(-2, 0), one_tap(0, 1))]


def moved(image: NDArray[Any], kernel: NDArray[np.float64] | None) -> NDArray[Any]:
    """Return the image under a kernel of one tap: exact in the type of the image."""
    if kernel is None:
        return image
    return oracle.convolve(image.astype(np.float64), kernel).astype(image.dtype)


def blur_compensation(**fields: Any) -> BlurCompensation:
    known: dict[str, Any] = {"noise": (1.5, 4.0), "kernels": MOVES, "labels": LABELS, "tile": 13}
    return BlurCompensation(**(known | fields))


KNOWN, NOISE = ps.Known(blur_compensation=blur_compensation()), ps.Known(noise=(1.5, 4.0))


def costs_by_class(left: NDArray[Any], right: NDArray[Any], **options: Any) -> NDArray[np.uint16]:
    """Return the costs of whole versions of the images, each pixel by its class."""
    each = [ps.cost_volume(moved(left, a), moved(right, b), **SEARCH, **options) for a, b in MOVES]
    classes = oracle.class_map(LABELS, 13, left.shape[:2])
    stacked = np.stack(each)
    chosen: NDArray[np.uint16] = np.take_along_axis(stacked, classes[None, :, :, None], axis=0)[0]
    return chosen


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
@pytest.mark.parametrize("weak", [0.0, 1.0])
def test_each_pixel_is_compared_in_its_versions(dtype: type[np.generic], weak: float) -> None:
    pair = LEFT.astype(dtype), RIGHT.astype(dtype)
    found = ps.cost_volume(*pair, **SEARCH, noise_threshold=weak, known=KNOWN)
    expected = costs_by_class(*pair, noise_threshold=weak, known=NOISE)
    np.testing.assert_array_equal(found, expected)
    assert (found != ps.cost_volume(*pair, **SEARCH, noise_threshold=weak, known=NOISE)).any()


@pytest.mark.parametrize("name", ["disk", "tilted"])
def test_blurred_versions_are_those_of_a_blurred_image(name: str) -> None:
    y, x = np.mgrid[-6:7, -6:7]
    inside = {"disk": y**2 + x**2 <= 30, "tilted": (abs(y - 2 * x) <= 1) & (x > -3)}[name]

    kernel = inside / inside.sum()
    scene = RNG.normal(0, 60, (60, 80))
    scene = np.clip(oracle.convolve(scene, np.full((3, 3), 1 / 9)) * 3 + 128, 0, 255).astype(
        np.uint8
    )

    blurred = oracle.convolve(scene.astype(np.float64), kernel)
    known = BlurCompensation(noise=(0.0, 0.0), kernels=[(kernel, kernel)])

    volume = ps.cost_volume(
        scene, scene, num_disparities=4, known=ps.Known(blur_compensation=known)
    )
    expected = ps.cost_volume(blurred, blurred, num_disparities=4)
    # A few components lie within rounding of a boundary; 14 bits each on either side.
    assert np.abs(volume.astype(int) - expected).mean() < 0.14

    unlike = ps.cost_volume(scene, scene, num_disparities=4).astype(int)
    assert np.abs(unlike - expected).mean() > 0.3


def test_what_a_mask_covers_spreads_nowhere() -> None:
    kernels = [(None, np.full((5, 5), 0.04)), (np.full((1, 9), 1 / 9), None), (None, None)]
    known = blur_compensation(kernels=kernels)
    masks: dict[str, Any] = {"left_mask": LEFT_MASK, "right_mask": RIGHT_MASK}

    expected = ps.match(LEFT, RIGHT, **SEARCH, **masks, known=ps.Known(blur_compensation=known))

    left = np.where(LEFT_MASK, LEFT, 255 - LEFT)
    right = np.where(RIGHT_MASK, RIGHT, 255 - RIGHT)
    found = ps.match(left, right, **SEARCH, **masks, known=ps.Known(blur_compensation=known))

    for field in ("disparity", "flags", "confidence"):
        np.testing.assert_array_equal(getattr(found, field), getattr(expected, field))


def test_noise_alone_is_one_class_of_images_as_they_are() -> None:
    alone = BlurCompensation(noise=(2.0, 2.0))
    matcher = ps.Matcher(noise_threshold=1.0, denoise=False)
    expected = matcher.match(LEFT, RIGHT, **SEARCH, known=ps.Known(noise=2.0))
    for known in (ps.Known(noise=(2.0, 2.0)), ps.Known(blur_compensation=alone)):
        found = matcher.match(LEFT, RIGHT, **SEARCH, known=known)
        np.testing.assert_array_equal(found.disparity, expected.disparity)


def test_a_weak_level_needs_the_noise() -> None:
    with pytest.raises(ValueError, match="^noise: got None; accepts"):
        ps.cost_volume(LEFT, RIGHT, **SEARCH, noise_threshold=1.0)

    for match in (
        ps.Matcher(preset="paper", noise_threshold=1.0).match,
        partial(ps.match, preset="paper", noise_threshold=1.0),
    ):
        result = match(LEFT, RIGHT, **SEARCH)
        assert result.blur is not None, "a match estimates it"

        given = match(LEFT, RIGHT, **SEARCH, known=ps.Known(noise=1.0))
        assert given.blur is None


def test_arrays_are_copied_and_travel() -> None:
    labels, kernel = LABELS.copy(), one_tap(0, 1)
    known = BlurCompensation(noise=(1, 2), kernels=[(None, kernel)] * 3, labels=labels, tile=5)

    labels[:] = 9
    kernel[:] = 0

    copy = pickle.loads(pickle.dumps(known))  # noqa: S301  # our own bytes
    np.testing.assert_array_equal(copy.labels, LABELS)
    assert copy.kernels[2][1].sum() == 1
    assert (copy.noise, copy.tile) == ((1, 2), 5)

    with pytest.raises(ValueError, match="read-only"):
        known.labels[0, 0] = 1


FLAT = np.full((3, 3), 1 / 9)


@pytest.mark.parametrize(
    ("error", "message", "fields"),
    [
        (TypeError, "noise: got float; accepts a pair", {"noise": 1.0}),
        (TypeError, "noise: got str; accepts a number", {"noise": ("1", 1.0)}),
        (ValueError, "noise: got -1; accepts", {"noise": (1.0, -1.0)}),
        (ValueError, "noise: got NaN; accepts", {"noise": (float("nan"), 1.0)}),
        (ValueError, "kernels: got 0 classes; accepts", {"kernels": []}),
        (ValueError, "kernels: got 17 classes; accepts", {"kernels": [(None, None)] * 17}),
        (TypeError, "kernels: got ndarray; accepts a list", {"kernels": FLAT}),
        (TypeError, "kernels: got ndarray; accepts a list with a pair", {"kernels": [FLAT]}),
        (ValueError, "kernels: got 3 arrays for a pair", {"kernels": [(None, None, None)]}),
        (TypeError, "kernels: got dtype int64", {"kernels": [(None, np.ones((1, 1), int))]}),
        (ValueError, r"kernels: got shape \(9,\)", {"kernels": [(None, np.full(9, 1 / 9))]}),
        (ValueError, "kernels: got 1 x 2 taps", {"kernels": [(np.full((1, 2), 0.5), None)]}),
        (
            ValueError,
            "kernels: got 131 x 1 taps",
            {"kernels": [(np.full((131, 1), 1 / 131), None)]},
        ),
        (ValueError, r"kernels: got shape \(0, 1\)", {"kernels": [(np.zeros((0, 1)), None)]}),
        (ValueError, "kernels: got .*; accepts", {"kernels": [(FLAT * np.nan, None)]}),
        (ValueError, "kernels: got .*; accepts", {"kernels": [(FLAT * 1e300, None)]}),
        (ValueError, "kernels: got taps of sum", {"kernels": [(FLAT * 1.01, None)]}),
        (TypeError, "labels: got dtype int64; accepts uint8", {"labels": LABELS.astype(int)}),
        (ValueError, r"labels: got shape \(5,\)", {"labels": LABELS[0]}),
        (ValueError, r"labels: got shape \(0, 5\)", {"labels": LABELS[:0]}),
        (ValueError, "labels: got the label 3; accepts", {"labels": LABELS * 0 + np.uint8(3)}),
        (ValueError, "tile: got 0; accepts", {"tile": 0}),
        (ValueError, "tile: got -1; accepts", {"tile": -1}),
        (TypeError, "tile: got float; accepts an integer", {"tile": 8.0}),
    ],
)
def test_what_makes_no_sense_is_refused_by_name(
    error: type[Exception], message: str, fields: dict[str, Any]
) -> None:
    with pytest.raises(error, match=f"^{message}"):
        blur_compensation(**fields)


def test_a_match_of_gray_values_refuses_it() -> None:
    with pytest.raises(ValueError, match="^blur_compensation: got .*; accepts cost='phase'"):
        ps.match(LEFT, RIGHT, **SEARCH, preset="paper", cost="sad", known=KNOWN)

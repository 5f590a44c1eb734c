"""Any two images: other sizes and types, cut-outs, and cameras one above the other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

import phasestereo as ps
from phasestereo_bench.rendering import render_pair
from support import counterpart
from support.rigs import cv2

ROWS, COLS = 144, 192
BAR = (slice(40, 100), slice(70, 130))
FAR, NEAR = 6, 15


def textured(seed: int) -> NDArray[np.uint8]:
    rough = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=(ROWS, COLS + 40)), 1.2)
    return np.asarray(np.clip(128 + 150 * rough, 1, 254), np.uint8)


def pair() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return a pair, at disparity FAR but for a thing at NEAR."""
    far, near = textured(0), textured(1)
    left, right = far[:, 20 : 20 + COLS].copy(), far[:, 20 + FAR : 20 + FAR + COLS].copy()
    rows, cols = BAR
    left[BAR] = near[BAR]
    right[rows, cols.start - NEAR : cols.stop - NEAR] = near[BAR]
    return left, right


TRUTH = np.full((ROWS, COLS), FAR, np.float32)
TRUTH[BAR] = NEAR


def wrong(found: ps.Result, truth: Any = TRUTH, cols: int = COLS) -> float:
    """Return the share of pixels that are wrong, of those that both images show for sure."""
    scored = np.s_[8:-8, 24 : cols - 24]
    return float(np.mean(~(np.abs(found.disparity - truth)[scored] <= 1)))


def reduced(image: NDArray[Any], by: int) -> NDArray[Any]:
    rows, cols = image.shape
    means = image.reshape(rows // by, by, cols // by, by).mean((1, 3))
    return np.asarray(np.rint(means), image.dtype)


@pytest.mark.parametrize("by", [2, 3])
def test_a_right_image_of_another_resolution_is_matched_in_pixels_of_the_left_one(by: int) -> None:
    left, right = pair()
    found = ps.match(left, reduced(right, by))
    assert wrong(found) < 0.06
    assert any("is resampled to that" in one.sentence for one in found.findings)

    assert ps.match(reduced(left, by), right).disparity.shape == (ROWS // by, COLS // by)


@pytest.mark.parametrize("size", [(230, 173), (240, 180), (256, 192), (288, 216), (480, 360)])
def test_images_of_any_ratio_are_resampled(size: tuple[int, int]) -> None:
    left, right = pair()
    cv2 = counterpart("cv2")
    assert wrong(ps.match(left, cv2.resize(right, size, interpolation=cv2.INTER_CUBIC))) < 0.06
    smaller = cv2.resize(left, size, interpolation=cv2.INTER_CUBIC)
    found = ps.match(smaller, right).disparity
    back = cv2.resize(found, (COLS, ROWS), interpolation=cv2.INTER_NEAREST) * COLS / size[0]
    off = np.abs(back - TRUTH)[8:-8, 24:-24]
    assert np.mean(~(off <= 1)) < 0.06


def test_a_cut_out_lies_over_the_middle_and_its_outside_is_not_matched() -> None:
    left, right = pair()
    found = ps.match(left, right[6:-14, :-24])
    # Cut out off the middle by 12 columns and 4 rows, which are straightened.
    assert wrong(found, TRUTH - 12) < 0.1
    assert any("laid over its middle" in one.sentence for one in found.findings)


def test_masks_are_of_the_size_of_their_own_image() -> None:
    left, right = pair()
    valid = np.ones((ROWS // 2, COLS // 2), bool)
    valid[:, 60:] = False
    found = ps.match(left, reduced(right, 2), right_mask=valid, fill=False)
    assert np.isnan(found.disparity[:, 150:]).all(), np.isfinite(found.disparity[:, 150:]).sum()
    assert wrong(found, cols=140) < 0.1

    with pytest.raises(ValueError, match=r"^right_mask: got shape \(144, 192\)"):
        ps.match(left, reduced(right, 2), right_mask=np.ones((ROWS, COLS), bool))


@pytest.mark.parametrize("right_as", [
    lambda image: image.astype(np.uint16) * 257,
    lambda image: (image / 255).astype(np.float32),
    lambda image: image.astype(np.float64),
    lambda image: np.repeat(image[:, :, np.newaxis].astype(np.uint16) * 257, 3, axis=2),
])  # fmt: skip
def test_two_types_of_one_image_are_matched_as_one(right_as: Any) -> None:
    left, right = pair()
    expected = ps.match(left, right)
    found = ps.match(left, right_as(right))
    np.testing.assert_array_equal(found.disparity, expected.disparity)
    np.testing.assert_array_equal(found.confidence, expected.confidence)


@pytest.mark.parametrize("by", [2, 3])
def test_two_sizes_of_cameras_one_above_the_other(by: int) -> None:
    left, right = pair()
    upper, lower = np.rot90(left, -1), np.rot90(reduced(right, by), -1)
    found = ps.match(upper, lower, vertical=True)
    assert found.disparity.shape == upper.shape
    off = np.abs(np.rot90(found.disparity) - TRUTH)[8:-8, 24:-24]
    assert np.mean(~(off <= 1)) < 0.06


@pytest.mark.parametrize(("upper", "lower"), [(1, 0.5), (1, 0.7), (0.5, 1)])
def test_two_sizes_one_above_the_other_are_recognized(upper: float, lower: float) -> None:
    rendered = render_pair(3, height=240, width=320, num_disparities=48)
    above, below = (
        np.rot90(cv2.resize(image, None, fx=by, fy=by, interpolation=cv2.INTER_AREA), -1)
        for image, by in ((rendered.left, upper), (rendered.right, lower))
    )
    found, known = ps.match(above, below), ps.match(above, below, vertical=True)
    assert found.vertical
    np.testing.assert_array_equal(found.disparity, known.disparity)
    assert any("one camera is above the other" in one.sentence for one in found.findings)
    assert found.trusted.mean() > 0.9


def test_bits_that_are_unused_do_not_matter() -> None:
    left, right = pair()
    rest = np.random.default_rng(2).integers(0, 4, right.shape)
    found = ps.match(left, (right * np.uint16(4) + rest).astype(np.uint16))  # ten bits
    assert wrong(found) < 0.03
    assert not any("gray levels" in one.sentence for one in found.findings)


def test_cameras_one_above_the_other_are_matched_along_columns() -> None:
    left, right = pair()
    mask = np.ones(left.shape, bool)
    mask[:, 30:50] = False
    beside = ps.match(left, right, left_mask=mask)
    above = ps.match(
        np.rot90(left, -1), np.rot90(right, -1), left_mask=np.rot90(mask, -1), vertical=True
    )

    for name, values in beside.maps.items():
        np.testing.assert_array_equal(above.maps[name], np.rot90(values, -1))
    assert above.pair is not None
    assert above.pair[0].shape == (COLS, ROWS)


@pytest.mark.parametrize("vertical", ["0", 1, 2, -1, np.True_])
def test_vertical_is_true_false_or_found(vertical: Any) -> None:
    with pytest.raises(TypeError, match="^vertical: got .*; accepts True, False or None$"):
        ps.match(*pair(), vertical=vertical)

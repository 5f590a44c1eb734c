"""Overlays are found, masked and reported; scenes are not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy import ndimage

import phasestereo as ps
from phasestereo_bench.datasets import find_scene

CLOCK = "2026-11-27 12:00:01 CAM"
SAID = "an overlay, such as a clock or a logo, covers"
ROWS, COLS, DISPARITY = 240, 360, 20


def drawn(image: NDArray[Any], *, size: int = 24) -> NDArray[np.uint8]:
    """Return the image with a clock near its lower left corner."""
    canvas = Image.fromarray(image)
    white = 255 if image.ndim == 2 else (255, 255, 255)
    place = 20, image.shape[0] - size - 11
    ImageDraw.Draw(canvas).text(place, CLOCK, fill=white, font_size=size)
    return np.asarray(canvas)


def scene(disparity: int = DISPARITY) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return a pair of a soft texture, each image with noise of its own."""
    rng = np.random.default_rng(4)
    layers = [ndimage.gaussian_filter(rng.normal(size=(ROWS, COLS + 60)), s) for s in (1, 3, 8)]
    texture = 128 + 12 * sum(layer / layer.std() for layer in layers)
    views = texture[:, :COLS], texture[:, disparity : disparity + COLS]
    left, right = (view + rng.normal(0, 1, view.shape) for view in views)
    return (
        np.clip(np.rint(left), 0, 255).astype(np.uint8),
        np.clip(np.rint(right), 0, 255).astype(np.uint8),
    )


def said(findings: Any) -> list[str]:
    return [one.sentence for one in findings if SAID in one.sentence]


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
def test_a_clock_is_masked_and_said(dtype: str) -> None:
    pair = [drawn(image).astype(dtype) * (16 if dtype == "uint16" else 1) for image in scene()]
    found = ps.match(*pair)
    [sentence] = said(found.findings)
    assert said(ps.check(*pair).findings) == [sentence]

    masked = found.flags == ps.Flag.MASKED
    ink = drawn(np.zeros((ROWS, COLS), np.uint8)) > 0
    assert masked[ink].mean() > 0.98
    assert masked.mean() < 0.16
    ends = [np.flatnonzero(masked.any(axis))[[0, -1]] + [0, 1] for axis in (0, 1)]
    columns, rows = (f"{first} to {last}" for first, last in ends)
    assert sentence.startswith(f"{SAID} columns {columns}, rows {rows} of both images")
    assert found.search is not None
    assert found.search.low > DISPARITY / 2
    wrong = np.abs(found.disparity - DISPARITY) > 1
    assert (wrong & found.trusted)[:, DISPARITY:].mean() < 0.002


def test_what_matches_is_that_of_the_pair_with_this_mask() -> None:
    left, right = map(drawn, scene())
    found = ps.match(left, right)
    mask = found.flags != ps.Flag.MASKED
    told = ps.match(left, right, left_mask=mask, right_mask=mask)
    assert said(told.findings) == []
    for which, values in found.maps.items():
        np.testing.assert_array_equal(values, told.maps[which])


def test_the_same_letters_in_the_scene_are_not_an_overlay() -> None:
    left, right = scene()
    assert said(ps.check(left, right).findings) == []
    # One image alone; in the scene, at its disparity; a scene that is all at disparity 0.
    assert said(ps.check(drawn(left), right).findings) == []
    moved = drawn(np.roll(right, DISPARITY, 1))
    assert said(ps.check(drawn(left), np.roll(moved, -DISPARITY, 1)).findings) == []
    assert said(ps.check(*map(drawn, scene(0))).findings) == []
    assert said(ps.check(drawn(left), drawn(left)).findings) == []


@pytest.mark.parametrize("name", ["scenes2003/cones", "MiddEval3/trainingQ/Motorcycle"])
def test_clocks_on_real_pairs_and_nothing_without(data: Path, name: str) -> None:
    pair = find_scene(data / "middlebury", name).load()
    assert pair.truth is not None
    size = pair.left.shape[0] // 16
    assert said(ps.check(pair.left, pair.right).findings) == []

    left, right = (drawn(image, size=size) for image in (pair.left, pair.right))
    found = ps.match(left, right, num_disparities=pair.num_disparities)
    assert said(found.findings)
    black = np.zeros(left.shape, np.uint8)
    ink = drawn(black, size=size).max(2) > 0
    assert (found.flags == ps.Flag.MASKED)[ink].mean() > 0.6
    around = ndimage.binary_dilation(ink, iterations=12) & np.isfinite(pair.truth)
    wrong = np.abs(found.disparity - pair.truth) > 2
    assert (wrong & found.trusted)[around].mean() < 0.08

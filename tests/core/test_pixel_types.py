"""Values decide, not types: equal gray values give equal results, and any byte but 0 is True."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
import phasestereo_large as large
from phasestereo.settings import PresetName
from phasestereo_bench.datasets import find_scene

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from phasestereo_bench.datasets import Pair

    Images = tuple[NDArray[Any], NDArray[Any]]


@pytest.fixture(scope="module")
def load(data: Path) -> Callable[[str], Pair]:
    """Return a function that loads a scene."""
    return lambda name: find_scene(data / "middlebury", name).load()


def gray(image: NDArray[Any]) -> NDArray[np.uint8]:
    shades: NDArray[np.uint8] = np.rint(image @ [0.299, 0.587, 0.114]).astype(np.uint8)
    return shades


FORMS: dict[str, Callable[[NDArray[np.uint8]], NDArray[Any]]] = {
    "uint16": lambda image: image.astype(np.uint16),
    "uint16, times 257": lambda image: image.astype(np.uint16) * np.uint16(257),
    "uint16, times 7": lambda image: image.astype(np.uint16) * np.uint16(7),
    "float32": lambda image: image.astype(np.float32),
    "float32, over 255": lambda image: image.astype(np.float32) / np.float32(255),
    "float64, times 0.37": lambda image: image.astype(np.float64) * 0.37,
    "RGB": lambda image: np.stack([image] * 3, axis=2),
    "RGB, float32, over 255": lambda image: np.stack([image] * 3, axis=2) / np.float32(255),
}


@pytest.fixture(scope="module")
def soft() -> Images:
    """Gray bytes, the right image softer and noisier, so all is estimated."""
    rng = np.random.default_rng(8)
    scene = rng.normal(size=(240, 330))
    for axis in (0, 1):
        scene += np.roll(scene, 1, axis) + 0.5 * np.roll(scene, 2, axis)
    left, right = scene[:, :300], scene[:, 9:309]
    for axis in (0, 1):
        right = np.mean([np.roll(right, by, axis) for by in (-2, -1, 0, 1, 2)], axis=0)
    right = right + 0.1 * rng.normal(size=right.shape)
    return tuple(np.clip(110 + 12 * image, 0, 255).astype(np.uint8) for image in (left, right))  # type: ignore[return-value]


def assert_same(found: ps.Result, expected: ps.Result, form: str) -> None:
    np.testing.assert_array_equal(found.disparity, expected.disparity, form)
    np.testing.assert_array_equal(found.flags, expected.flags, form)
    if expected.confidence is not None:
        np.testing.assert_array_equal(found.confidence, expected.confidence, form)


@pytest.mark.parametrize("preset", ["robust", "fast", "paper"])
def test_the_same_values_in_any_type_give_the_same_bits(soft: Images, preset: PresetName) -> None:
    expected = ps.match(*soft, num_disparities=24, preset=preset)
    for name, form in FORMS.items():
        found = ps.match(form(soft[0]), form(soft[1]), num_disparities=24, preset=preset)
        assert_same(found, expected, name)


@pytest.mark.parametrize("cost", ["sad", "nsad"])
def test_differences_of_intensities_do_not_depend_on_their_type_either(
    soft: Images, cost: str
) -> None:
    options: dict[str, Any] = {"num_disparities": 16, "preset": "fast", "cost": cost}
    expected = ps.match(*soft, **options)
    for name, form in FORMS.items():
        assert_same(ps.match(form(soft[0]), form(soft[1]), **options), expected, name)


def test_words_are_the_same_as_integers_and_as_fractions_of_white(soft: Images) -> None:
    rng = np.random.default_rng(3)
    words = [
        16 * image.astype(np.uint16) + rng.integers(0, 16, image.shape, np.uint16) for image in soft
    ]
    options: dict[str, Any] = {"num_disparities": 24, "preset": "robust"}
    expected = ps.match(*words, **options)
    for step in (1.0, 1 / 4095):
        for dtype in (np.float32, np.float64):
            left, right = ((image * step).astype(dtype) for image in words)
            assert_same(ps.match(left, right, **options), expected, f"{step} {dtype}")


@pytest.mark.parametrize("form", ["uint16, times 257", "float32, over 255", "RGB"])
def test_parts_are_those_of_bytes_whatever_their_own_values(soft: Images, form: str) -> None:
    # The first rows alone would be bytes of another scale, and gray.
    left, right = (
        np.where(np.arange(240)[:, np.newaxis] < 90, image // 2 * 2, image) for image in soft
    )
    expected = ps.match(left, right, num_disparities=16, preset="robust")
    images = FORMS[form](left), FORMS[form](right)

    def read(first: int, last: int) -> Any:
        return images[0][first:last], images[1][first:last], None, None

    statistics = large.pair_statistics(read, left.shape, num_disparities=16, preset="robust")
    for first, last in ((0, 60), (130, 240)):
        part = large.match_rows(read, statistics, first, last)
        np.testing.assert_array_equal(part.disparity, expected.disparity[first:last], form)


def test_a_diagnosis_is_of_the_values(load: Callable[[str], Pair]) -> None:
    pair = load("cones")
    left, right = gray(pair.left), gray(pair.right)
    expected = ps.check(left, right)

    for name, form in FORMS.items():
        found = ps.check(form(left), form(right))
        scale = found.intensity_range / expected.intensity_range
        if abs(scale - 1) < 1e-6:
            assert str(found) == str(expected), name
        assert [one.severity for one in found.findings] == [
            one.severity for one in expected.findings
        ], name
        assert found.low_texture == pytest.approx(expected.low_texture, abs=1e-3), name
        assert found.noise == pytest.approx([scale * noise for noise in expected.noise or ()])


@pytest.mark.parametrize("preset", ["robust", "fast"])
def test_every_byte_of_a_mask_but_0_is_true(soft: Images, preset: PresetName) -> None:
    valid = np.random.default_rng(5).random(soft[0].shape) > 0.1
    options: dict[str, Any] = {"num_disparities": 16, "preset": preset}
    expected = ps.match(*soft, left_mask=valid, right_mask=valid[::-1], **options)

    for byte in (2, 128, 255):
        bytes_of = valid * np.uint8(byte)
        read_only = np.frombuffer(bytes_of.tobytes(), bool).reshape(valid.shape)
        for mask in (bytes_of.view(bool), np.asfortranarray(bytes_of).view(bool), read_only):
            found = ps.match(*soft, left_mask=mask, right_mask=mask[::-1], **options)
            assert_same(found, expected, str(byte))

    described = ps.descriptor(soft[0], mask=(valid * np.uint8(255)).view(bool))
    np.testing.assert_array_equal(described, ps.descriptor(soft[0], mask=valid))

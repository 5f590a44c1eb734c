"""What is said of a pair and of its match: the same sentences, and the cause of what failed."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
import phasestereo_large as large
from phasestereo_bench.datasets import find_scene
from phasestereo_bench.degradation import Degradation, disk_psf

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    Image = NDArray[Any]
    Spoil = Callable[[Image], Image]


def interlaced(image: Image) -> Image:
    """Return an image whose odd rows are another field, 5 px on."""
    fields = image.copy()
    fields[1::2] = np.roll(image, 5, axis=1)[1::2]
    return fields


def noisy(image: Image) -> Image:
    noise = np.random.default_rng(image.sum()).normal(0, 30, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def fence(image: Image) -> Image:
    """Return an image behind bars that all look the same."""
    bars = np.where(np.arange(image.shape[1]) % 24 < 12, 20, 230)[:, np.newaxis]
    return (0.1 * image + 0.9 * bars).astype(np.uint8)


def wall(image: Image) -> Image:
    """Return an image of nothing, with hardly any noise."""
    noise = np.random.default_rng(image.sum()).normal(120, 1.0, image.shape)
    return np.rint(noise).astype(np.uint8)


FAULTS: dict[str, tuple[Spoil, Spoil]] = {
    "noise": (noisy, noisy),
    "texture": (wall, wall),
    "repetition": (fence, fence),
    "interlacing": (lambda image: image, interlaced),
    "blur": (Degradation(disk_psf(4.0), noise=1.0), lambda image: image),
    "contrast": (lambda image: image, lambda image: image // 3),
}


@pytest.fixture(scope="module")
def scene(data: Path) -> tuple[Image, Image]:
    pair = find_scene(data / "middlebury", "Motorcycle").load()
    return pair.left, pair.right


@pytest.mark.parametrize("topic", FAULTS)
def test_a_match_says_of_a_pair_what_a_check_says_word_for_word(
    scene: tuple[Image, Image], topic: str
) -> None:
    left, right = (spoil(image) for spoil, image in zip(FAULTS[topic], scene, strict=True))
    checked = {one.sentence: one for one in ps.check(left, right).findings}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ps.MatchWarning)
        matched = ps.match(left, right).findings

    named = [one for one in matched if one.topic == topic]
    assert named, matched
    for one in named:
        assert one.sentence in checked, topic
        assert one.severity != "ok"
        assert checked[one.sentence].severity != "ok"

    # What a match says besides is about itself.
    own = [one.topic for one in matched if one.sentence not in checked]
    assert set(own) <= {"match", "range"}, matched


def test_a_failed_match_names_its_cause(scene: tuple[Image, Image]) -> None:
    left, right = (noisy(noisy(image)) for image in scene)
    with pytest.warns(ps.MatchWarning, match="because of .*noise"):
        result = ps.match(left, right)
    assert result.findings[0].topic == "match"


def test_a_match_says_where_images_are_larger_than_what_they_show(
    scene: tuple[Image, Image],
) -> None:
    parts = [image[150:310, 300:540, 1] for image in scene]
    left, right = (noisy(part.repeat(3, axis=0).repeat(3, axis=1)) for part in parts)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ps.MatchWarning)
        result = ps.match(left, right)

    summary = result.summary
    assert summary is not None
    assert summary.coarse == (result.flags & ps.Flag.COARSE != 0).mean() > 0.25
    assert 2 < summary.detail <= 4
    sentence = (
        f"{100 * summary.coarse:.0f} % of the disparities were decided by smaller copies: there "
        f"the images show no detail finer than about {summary.detail:.0f} px"
    )
    assert sentence in [one.sentence for one in result.findings]


def test_both_ends_of_a_given_range_are_looked_at(scene: tuple[Image, Image]) -> None:
    for preset in ("robust", "fast"):
        for first, count in ((0, 20), (40, 40)):
            with pytest.warns(ps.MatchWarning, match="because of a range that is too short"):
                ps.match(*scene, min_disparity=first, num_disparities=count, preset=preset)


def test_parts_of_a_pair_say_what_the_whole_says(scene: tuple[Image, Image]) -> None:
    left, right = noisy(scene[0]), scene[1] // 3

    def read(first: int, last: int) -> Any:
        return left[first:last], right[first:last], None, None

    expected = ps.check(left, right).findings
    assert large.pair_statistics(read, left.shape[:2]).findings == expected
    assert {one.topic for one in expected if one.severity != "ok"} >= {"noise", "contrast"}


def test_notes_stay_while_estimates_are_reused(scene: tuple[Image, Image]) -> None:
    left = Degradation(disk_psf(4.0), noise=1.0)(scene[0])
    rig = ps.Rig()
    first = rig.match(left, scene[1])
    again = rig.match(left, scene[1])

    assert again.blur is not None
    assert again.blur.reused
    assert "blur" in {one.topic for one in first.findings}
    assert again.findings == first.findings


def test_a_pattern_that_both_images_share_is_subtracted_and_reported(data: Path) -> None:
    pair = find_scene(data / "middlebury", "Motorcycle").load()
    pattern = 3 * np.random.default_rng(5).normal(size=(*pair.left.shape[:2], 1))
    spoiled = [
        np.rint(one + pattern).clip(0, 255).astype(np.uint8) for one in (pair.left, pair.right)
    ]

    def wrong(result: ps.Result) -> float:
        assert pair.truth is not None
        return float((np.abs(result.disparity - pair.truth)[pair.masks["nonocc"]] > 1).mean())

    count = pair.num_disparities
    found = ps.match(*spoiled, num_disparities=count)
    estimated = {"align_rows": False, "compensate_blur": False, "denoise": False, "despike": False}
    told: dict[str, Any] = {"num_disparities": count, **estimated}
    as_it_is = ps.match(*spoiled, **told)
    assert wrong(found) < 0.7 * wrong(as_it_is)

    sharp = ps.match(pair.left, pair.right, num_disparities=count)
    for result, is_spoiled in ((found, True), (ps.check(*spoiled), True), (sharp, False)):
        sentences = [one.sentence for one in result.findings]
        assert any("have the same pattern of" in one for one in sentences) == is_spoiled


@pytest.mark.parametrize("mixed", [0.1, 0.2])
def test_crosstalk_is_found_by_the_match_and_subtracted(data: Path, mixed: float) -> None:
    pair = find_scene(data / "middlebury", "cones").load()
    left, right = (one.astype(float) for one in (pair.left, pair.right))
    spoiled = [
        np.rint((1 - mixed) * one + mixed * other).astype(np.uint8)
        for one, other in ((left, right), (right, left))
    ]

    def wrong(disparity: Image) -> float:
        assert pair.truth is not None
        return float((np.abs(disparity - pair.truth) > 1)[pair.masks["nonocc"]].mean())

    found = ps.match(*spoiled)
    expected = f"each image contains {100 * mixed:.0f} % of the other one"
    for findings in (found.findings, ps.check(*spoiled).findings):
        assert any(one.sentence.startswith(expected) for one in findings)
    assert wrong(found.disparity) < 0.06

    rig = ps.Rig()
    rig.match(*spoiled)
    later = rig.match(*(np.roll(one, 1, axis=0) for one in spoiled))
    assert wrong(np.roll(later.disparity, -1, axis=0)) < 0.06

    prepared = ps.prepare(*spoiled)
    assert prepared.done == (f"crosstalk of {100 * mixed:.0f} % is subtracted",)
    for made, clean, given in zip(
        (prepared.left, prepared.right), (left, right), spoiled, strict=True
    ):
        errors = [np.abs(image - clean).mean() for image in (made, given)]
        assert errors[0] < 0.7 * errors[1]

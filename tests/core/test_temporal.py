"""The temporal filter: steady where nothing changes, and out of the way where something does."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import pickle
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

import phasestereo as ps
import phasestereo_live as live
from phasestereo.metrics import bad_pixels, temporal_deviation
from support import Run

Image = NDArray[Any]

ROWS, COLS, COUNT, FRAMES = 64, 96, 16, 8
NOISE = 6.0
NEAR = np.s_[20:44, 40:70]  # before a ground that is farther away
DISPARITIES = {"ground": 4, "near": 9}
FAST: dict[str, Any] = {"num_disparities": COUNT, "preset": "fast"}


def texture(seed: int) -> NDArray[np.float64]:
    noise = np.random.default_rng(seed).normal(size=(ROWS, COLS + 2 * COUNT))
    smooth: NDArray[np.float64] = ndimage.gaussian_filter(noise, 1.0)
    return 128 + 130 * smooth


def truth() -> NDArray[np.float64]:
    disparity = np.full((ROWS, COLS), float(DISPARITIES["ground"]))
    disparity[NEAR] = DISPARITIES["near"]
    return disparity


def scene(seed: int = 0) -> tuple[Image, Image]:
    """Return a noiseless pair: a card before a ground."""
    ground, card = texture(seed), texture(seed + 1)
    far, near = DISPARITIES.values()
    left, right = ground[:, COUNT : COUNT + COLS].copy(), ground[:, COUNT + far :][:, :COLS].copy()
    rows, cols = NEAR
    left[NEAR] = card[NEAR]
    right[rows, cols.start - near : cols.stop - near] = card[NEAR]
    return left, right


def shots(count: int = FRAMES, seed: int = 0, noise: float = NOISE) -> list[tuple[Image, Image]]:
    """Return frames of a scene that stands still, with fresh noise in each."""
    rng = np.random.default_rng(seed)
    left, right = scene(seed)

    def noisy(view: Image) -> Image:
        grain = noise * rng.normal(size=view.shape)
        return np.clip(np.rint(view + grain), 0, 255).astype(np.uint8)

    return [(noisy(left), noisy(right)) for _ in range(count)]


def results(pairs: Sequence[Any], **options: Any) -> list[ps.Result]:
    return [frame.result for frame in live.stream(pairs, **{**FAST, **options})]


def maps(found: Sequence[ps.Result]) -> list[NDArray[np.float32]]:
    return [result.disparity for result in found]


@pytest.mark.parametrize("preset", ps.PRESETS)
def test_what_stands_still_flickers_less_and_is_no_worse(preset: str) -> None:
    pairs = shots()
    found = results(pairs, preset=preset)
    alone = results(pairs, preset=preset, temporal_filter=False)
    assert temporal_deviation(maps(found)) < 0.6 * temporal_deviation(maps(alone))
    wrong, wrong_alone = (
        np.mean([bad_pixels(result.disparity, truth(), 1) for result in each])
        for each in (found, alone)
    )
    assert wrong < wrong_alone + 0.2  # percent
    supports = [result.temporal_support for result in found]
    assert [None if each is None else each.max() for each in supports] == list(range(1, 9))
    assert all(result.temporal_support is None for result in alone)
    assert "temporal filter" in found[0].timings


def test_equal_frames_give_the_maps_of_match_to_the_bit() -> None:
    left, right = (np.rint(view).clip(0, 255).astype(np.uint8) for view in scene())
    options: dict[str, Any] = {"num_disparities": COUNT, "fill": False}
    alone = ps.match(left, right, **options)
    frames = results([(left, right)] * 10, preset="robust", fill=False)
    for index, found in enumerate(frames):
        np.testing.assert_array_equal(found.disparity, alone.disparity)
        np.testing.assert_array_equal(found.flags, alone.flags)
        np.testing.assert_array_equal(found.confidence, alone.confidence)
        assert found.temporal_support is not None
        assert (found.temporal_support == min(index + 1, 8)).all()
    assert np.isnan(alone.disparity).any()


def test_what_moves_does_not_lag() -> None:
    far = [np.roll(view, 3, axis=1) for view in scene(70)]
    left, right = scene()
    rng = np.random.default_rng(3)

    def noisy(view: Image) -> Image:
        return np.clip(np.rint(view + 2 * rng.normal(size=view.shape)), 0, 255).astype(np.uint8)

    frames = []
    for index in range(6):  # a strip of another scene comes in from the left, 8 px a frame
        images = [left.copy(), right.copy()]
        for image, other in zip(images, far, strict=True):
            image[:, : 8 * index] = other[:, : 8 * index]
        frames.append((noisy(images[0]), noisy(images[1])))
    found, alone = results(frames), results(frames, temporal_filter=False)
    for index in range(1, 6):
        edge = np.s_[:, 8 * index - 8 : 8 * index + 4]
        same = found[index].disparity[edge] == alone[index].disparity[edge]
        assert same.mean() > 0.9


def test_another_size_other_settings_and_another_range_begin_anew() -> None:
    pairs = shots(2)
    smaller = [(left[:-8], right[:-8]) for left, right in pairs]
    supports = [result.temporal_support for result in results([*pairs, *smaller])]
    assert [None if each is None else each.max() for each in supports] == [1, 2, 1, 2]

    frames = live.stream(shots(6), **FAST)
    fast = ps.Settings.preset("fast")
    largest = [next(frames).result.temporal_support for _ in range(2)]
    frames.change(fast, COUNT + 4)
    largest += [next(frames).result.temporal_support for _ in range(2)]
    frames.change(ps.Settings.preset("paper"), COUNT + 4)
    largest += [next(frames).result.temporal_support for _ in range(2)]
    assert [None if each is None else each.max() for each in largest] == [1, 2, 1, 2, 1, 2]


def test_a_frame_that_fails_changes_nothing() -> None:
    pairs = shots(4)
    failures: list[live.Failure] = []
    broken = [*pairs[:2], (pairs[2][0], pairs[2][1][:, 1:]), *pairs[2:]]
    found = results(broken, on_error=failures.append)
    assert [failure.index for failure in failures] == [2]
    for one, other in zip(found, results(pairs), strict=True):
        np.testing.assert_array_equal(one.disparity, other.disparity)


def test_masked_pixels_stay_masked_and_hold_anything() -> None:
    mask = np.ones((ROWS, COLS), bool)
    mask[30:40, 20:50] = False
    pairs: list[Any] = [
        tuple(np.where(mask, view, np.nan) for view in views) for views in shots(4, noise=2.0)
    ]
    *_, last = results(pairs, left_mask=mask, right_mask=mask)
    assert np.isnan(last.disparity[~mask]).all()
    assert (last.temporal_support[~mask] == 1).all()
    assert (last.temporal_support[mask] == 4).mean() > 0.5


def test_inverted_images_are_steadied() -> None:
    rng = np.random.default_rng(0)
    noise = ndimage.gaussian_filter(rng.normal(size=(240, 360)), 1.5)
    view = 128 + 250 * noise
    pairs = [
        tuple(
            np.clip(np.rint(each + 2 * rng.normal(size=each.shape)), 0, 255).astype(np.uint8)
            for each in (view[:, :320], 255 - view[:, 8:328])
        )
        for _ in range(3)
    ]
    found = results(pairs, preset="robust", num_disparities=32)
    assert found[-1].search.inverted
    assert found[-1].temporal_support is not None
    assert (found[-1].temporal_support == 3).mean() > 0.9


def test_a_matcher_takes_a_filter_and_threads_do_not_matter() -> None:
    pairs = shots(4)
    expected = results(pairs)
    for threads in (1, 3):
        matcher, steady = ps.Matcher(preset="fast", threads=threads), ps.TemporalFilter()
        for pair, other in zip(pairs, expected, strict=True):
            found = matcher.match(*pair, num_disparities=COUNT, temporal_filter=steady)
            np.testing.assert_array_equal(found.disparity, other.disparity)
            np.testing.assert_array_equal(found.temporal_support, other.temporal_support)


def test_a_pickled_filter_has_seen_nothing() -> None:
    matcher, steady = ps.Matcher(preset="fast"), ps.TemporalFilter()
    pair = shots(1)[0]
    matcher.match(*pair, num_disparities=COUNT, temporal_filter=steady)
    copied = pickle.loads(pickle.dumps(steady))  # noqa: S301  # our own
    found = matcher.match(*pair, num_disparities=COUNT, temporal_filter=copied)
    assert found.temporal_support is not None
    assert (found.temporal_support == 1).all()
    told = pickle.loads(pickle.dumps(found))  # noqa: S301  # our own
    assert (told.temporal_support == 1).all()


def test_anything_else_is_refused() -> None:
    wrong: Any = True
    with pytest.raises(TypeError, match="temporal_filter: got bool; accepts a TemporalFilter"):
        ps.Matcher().match(*shots(1)[0], num_disparities=COUNT, temporal_filter=wrong)
    wrong = 1
    with pytest.raises(TypeError, match="temporal_filter: got int; accepts True or False"):
        live.stream(shots(1), num_disparities=COUNT, temporal_filter=wrong)


def test_the_command_line_has_a_switch(
    run: Callable[..., Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    pairs = shots(3)
    for side in (0, 1):
        folder = tmp_path / ("left", "right")[side]
        folder.mkdir()
        for index, views in enumerate(pairs):
            np.save(folder / f"{index}.npy", views[side])
    search = ("--num-disparities", COUNT, "--preset", "fast")
    for flags, used in (((), True), (("--no-temporal-filter",), False)):
        code, _, err = run("live", "left", "right", *search, *flags, "--frames", "%d.npy")
        assert (code, err) == (0, "")
        for index, expected in enumerate(maps(results(pairs, temporal_filter=used))):
            np.testing.assert_array_equal(np.load(f"{index}.npy"), expected)

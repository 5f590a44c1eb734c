"""Rendered videos and ``phasestereo bench video``; the metric of how steady maps are."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from phasestereo import metrics
from phasestereo_bench.rendering.sequences import MOTIONS, Motion, Shot, render_sequence
from phasestereo_bench.video import steadiness
from support import Run

SIZE = {"frames": 3, "height": 48, "width": 64, "num_disparities": 16}
FLAT = np.zeros((2, 3), np.float32)


@pytest.fixture(scope="module")
def sequences() -> dict[Motion, list[Shot]]:
    return {motion: list(render_sequence(motion, 1, **SIZE)) for motion in MOTIONS}


def test_noise_is_fresh_and_what_stands_still_has_one_truth(
    sequences: dict[Motion, list[Shot]],
) -> None:
    first, second, _ = sequences["static"]
    np.testing.assert_array_equal(first.truth, second.truth)
    difference = first.left.astype(float) - second.left
    assert 1.3 * 3 < difference.std() < 1.5 * 3
    assert not first.outline.any()


def test_a_camera_that_moves_changes_all_and_an_object_a_part(
    sequences: dict[Motion, list[Shot]],
) -> None:
    static = {
        motion: np.ptp([shot.truth for shot in shots], axis=0) == 0
        for motion, shots in sequences.items()
    }
    assert static["static"].all()
    assert static["camera"].mean() < 0.7  # the floor looks the same from everywhere
    assert 0.5 < static["object"].mean() < 0.95
    for shot in sequences["object"]:
        assert 0.05 < shot.outline.mean() < 0.5
    first, *_, last = sequences["object"]
    columns = [np.nonzero(shot.outline)[1].mean() for shot in (first, last)]
    assert columns[1] > columns[0] + 1


def test_disparities_are_in_the_range_and_frames_repeat(
    sequences: dict[Motion, list[Shot]],
) -> None:
    for motion, shots in sequences.items():
        again = next(render_sequence(motion, 1, **SIZE))
        np.testing.assert_array_equal(shots[0].right, again.right)
        for shot in shots:
            assert shot.truth.min() > 0
            assert shot.truth.max() <= SIZE["num_disparities"] - 1
            assert shot.nonocc.shape == shot.truth.shape == (48, 64)


def test_the_truth_has_the_best_numbers_and_an_offset_shows(
    sequences: dict[Motion, list[Shot]],
) -> None:
    for motion, shots in sequences.items():
        perfect = steadiness(shots, [shot.truth for shot in shots])
        assert (perfect.bad_1, perfect.avgerr) == (0, 0)
        assert (perfect.edges, perfect.deviation) == (0 if motion == "object" else None, 0)
    shots = sequences["object"]
    lagging = steadiness(shots, [shots[0].truth] * 3)
    assert lagging.edges > 4
    shaking = [shot.truth + np.float32(2 * index) for index, shot in enumerate(shots)]
    assert steadiness(shots, shaking).deviation == pytest.approx(np.std([0, 2, 4]), rel=1e-5)


def test_the_command_tells_all_numbers(run: Callable[..., Run], monkeypatch: Any) -> None:
    home = "phasestereo_bench.video.render_sequence"
    monkeypatch.setattr(
        home,
        lambda motion, seed, noise, num_disparities: render_sequence(
            motion,
            seed,
            noise=noise,
            frames=3,
            height=96,
            width=128,
            num_disparities=num_disparities,
        ),
    )
    code, out, _ = run("bench", "video", "--preset", "fast", "--noise", 4)
    assert code == 0
    for told in ("static", "camera", "object", "deviation,", "moving edges, %", "(x 0."):
        assert told in out
    code, _, err = run("bench", "video", "--preset", "best")
    assert code != 0
    assert "preset: got 'best'" in err


# The metric


def test_temporal_deviation_by_hand() -> None:
    maps = np.zeros((4, 2, 3), np.float32)
    maps[:, 0, 0] = [1, 3, 1, 3]
    maps[:, 1, 2] = [7, 7, 11, 7]
    maps[2, 0, 1] = np.nan  # not in every frame
    expected = (1 + np.std([7, 7, 11, 7]) + 3 * 0) / 5
    assert metrics.temporal_deviation(maps) == pytest.approx(expected, rel=1e-12)
    assert metrics.temporal_deviation(list(maps)) == metrics.temporal_deviation(maps)
    mask = np.zeros((2, 3), bool)
    mask[0, :2] = True
    assert metrics.temporal_deviation(maps, mask) == 1


@pytest.mark.parametrize(
    ("maps", "mask", "error", "match"),
    [
        ([FLAT], None, ValueError, "estimates: got 1 frames; accepts two or more"),
        ([FLAT, FLAT[:1]], None, ValueError, r"estimates: got shape \(1, 3\); accepts \(2, 3\)"),
        ([FLAT[0], FLAT[0]], None, ValueError, r"estimates: got shape \(3,\); accepts \(H, W\)"),
        ([FLAT.astype(int)] * 2, None, TypeError, "estimates: got dtype int64; accepts floats"),
        ([FLAT] * 2, FLAT, TypeError, "mask: got dtype float"),
        ([FLAT] * 2, np.ones((3, 2), bool), ValueError, "mask: got shape"),
        ([FLAT, FLAT * np.nan], None, ValueError, "nothing is left to score"),
    ],
)
def test_temporal_deviation_refuses(
    maps: Any, mask: Any, error: type[Exception], match: str
) -> None:
    with pytest.raises(error, match=match):
        metrics.temporal_deviation(maps, mask)

"""Pictures: what each color means, and that nothing global is touched."""

import sys
import tracemalloc
from typing import Any

import numpy as np
import pytest

from phasestereo.views.picture import (
    NEUTRAL,
    UNSCORED,
    Picture,
    colorize,
    disparity_picture,
    error_picture,
)

pytest.importorskip("matplotlib")

WHITE = (255, 255, 255)
RAMP = np.linspace(0, 60, 61, dtype=np.float32).reshape(1, -1)


def contains(whole: Picture, part: Picture) -> bool:
    """Tell whether a picture appears unchanged somewhere in another."""
    rows, cols = part.shape[:2]
    windows = np.lib.stride_tricks.sliding_window_view(whole, (rows, cols), axis=(0, 1))
    return bool((windows == part.transpose(2, 0, 1)).all(axis=(2, 3, 4)).any())


def test_colors_run_from_blue_to_red() -> None:
    colors = colorize(RAMP, low=0, high=60)
    assert colors.dtype == np.uint8
    assert colors.shape == (1, 61, 3)
    far, near = colors[0, 5].astype(int), colors[0, 55].astype(int)
    assert far[2] > far[0]
    assert near[0] > near[2]
    assert len(np.unique(colors[0], axis=0)) == 61


def test_missing_estimates_have_a_color_of_their_own() -> None:
    disparity = np.array([[1.0, np.nan, np.inf, -np.inf, 2.0]])
    colors = colorize(disparity)
    assert [tuple(color) for color in colors[0, 1:4]] == [NEUTRAL] * 3
    steps = colorize(np.linspace(0, 1, 4096).reshape(1, -1), low=0, high=1).astype(int)
    assert np.abs(steps - NEUTRAL).max(axis=2).min() > 40


def test_what_is_not_trusted_is_hatched_and_nothing_else() -> None:
    disparity = np.tile(RAMP, (40, 1))
    disparity[:5] = np.nan
    trusted = np.ones(disparity.shape, bool)
    trusted[2:20, 10:40] = False

    plain, drawn = colorize(disparity), colorize(disparity, trusted=trusted)
    unsure = np.isfinite(disparity) & ~trusted
    np.testing.assert_array_equal((plain != drawn).any(axis=2), unsure)

    lines = (drawn == NEUTRAL).all(axis=2)
    assert lines[unsure].mean() == pytest.approx(0.5, abs=0.02), "half is lines, half is paler"
    assert contains(disparity_picture(disparity, trusted=trusted), drawn)

    with pytest.raises(TypeError, match="trusted: got dtype float64"):
        colorize(disparity, trusted=np.ones(disparity.shape))


def test_outliers_do_not_move_the_limits() -> None:
    calm = np.tile(RAMP, (20, 1))
    wild = calm.copy()
    wild[0, 0] = 1e6
    difference = np.abs(colorize(calm).astype(int) - colorize(wild).astype(int))
    assert np.delete(difference.reshape(-1, 3), 0, axis=0).max() <= 8


@pytest.mark.parametrize("value", [7.0, 0.0, -3.0])
def test_one_value_everywhere_and_none_at_all(value: float) -> None:
    assert len(np.unique(colorize(np.full((2, 3), value)).reshape(-1, 3), axis=0)) == 1
    assert tuple(colorize(np.full((2, 3), np.nan))[0, 0]) == NEUTRAL


def test_errors_are_white_up_to_one_pixel_and_darken_from_there() -> None:
    estimate = np.array([[10.0, 11.0, 11.1, 13.0, 14.0, 50.0, 9.0, 8.9]])
    colors = error_picture(estimate, np.full_like(estimate, 10.0))[0]
    assert [tuple(color) == WHITE for color in colors] == [
        *(True, True, False, False, False, False, True, False)
    ]
    light = colors.astype(int).sum(axis=1)
    assert light[2] > light[3] > light[4] == light[5]


def test_missing_estimates_are_the_worst_and_unscored_pixels_are_gray() -> None:
    estimate = np.array([[np.nan, 99.0, 10.0, 99.0]])
    truth = np.array([[10.0, 10.0, np.nan, 10.0]])
    mask = np.array([[True, True, True, False]])
    colors = [tuple(color) for color in error_picture(estimate, truth, mask)[0]]
    assert colors[0] == colors[1] != UNSCORED
    assert colors[2] == colors[3] == UNSCORED


def test_disparity_picture_holds_the_map_at_its_own_size() -> None:
    disparity = np.random.default_rng(0).uniform(0, 60, (40, 70))
    drawn = disparity_picture(disparity, title="A title", low=0, high=60)
    assert contains(drawn, colorize(disparity, low=0, high=60))
    assert not np.array_equal(drawn, disparity_picture(disparity, low=0, high=60))


def test_a_picture_takes_little_more_than_its_pixels() -> None:
    disparity = np.random.default_rng(0).uniform(0, 60, (1024, 1500)).astype(np.float32)
    disparity_picture(disparity)  # imports matplotlib
    tracemalloc.start()
    try:
        drawn = disparity_picture(disparity, trusted=disparity > 5)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    # The estimates once more, to find the ends of the colors, or the picture and its strips.
    assert peak < 3 * drawn.nbytes


def test_pyplot_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)  # its import would raise
    disparity_picture(np.tile(RAMP, (5, 1)))


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"disparity": np.zeros((2, 2), int)}, TypeError, "disparity: got dtype int64"),
        ({"disparity": np.zeros(3)}, ValueError, r"disparity: got shape \(3,\)"),
        ({"disparity": np.zeros((0, 3))}, ValueError, "disparity: got shape"),
        ({"disparity": RAMP, "low": np.nan}, ValueError, "low: got nan"),
        ({"disparity": RAMP, "high": "9"}, TypeError, "high: got str"),
        ({"disparity": RAMP, "low": 3, "high": 2}, ValueError, "low: got 3; .* 2$"),
    ],
)
def test_colorize_refuses(arguments: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        colorize(**arguments)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"truth": np.zeros((1, 60))}, ValueError, "truth: got shape"),
        ({"truth": RAMP, "mask": np.ones((1, 61))}, TypeError, "mask: got dtype float64"),
        ({"truth": RAMP, "mask": np.ones((1, 60), bool)}, ValueError, "mask: got shape"),
        ({"truth": RAMP, "worst": 1.0}, ValueError, "worst: got 1"),
        ({"truth": RAMP, "worst": True}, TypeError, "worst: got bool"),
    ],
)
def test_error_picture_refuses(
    arguments: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        error_picture(RAMP, **arguments)

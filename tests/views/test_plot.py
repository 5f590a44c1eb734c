"""Maps on matplotlib's axes: their data, limits, colors and legends, and whose axes they take."""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

import sys
from collections.abc import Iterator
from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.image import AxesImage
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo.rig.blur import Blur, BlurEstimate
from phasestereo.views import plot
from phasestereo.views.picture import NEUTRAL, UNSCORED, colorize, error_picture

pytest.importorskip("matplotlib")

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

RNG = np.random.default_rng(0)
MAP = RNG.uniform(3, 60, (20, 30)).astype(np.float32)
MAP[2, 5], MAP[3, 6] = np.nan, np.inf
FLAGS = np.zeros((4, 5), np.uint16)
FLAGS[0, 0] = ps.Flag.MASKED
FLAGS[1, :2] = ps.Flag.OCCLUDED | ps.Flag.FILLED
FLAGS[2, 0] = ps.Flag.FILLED
KINDS = Blur("none", "none", 0.0, 0.0), Blur("left", "motion", 9.0, 45.0)


@pytest.fixture
def axes() -> Axes:
    figure = Figure()
    FigureCanvasAgg(figure)
    return figure.add_subplot()


@pytest.fixture
def pyplot(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    monkeypatch.setenv("MPLBACKEND", "Agg")
    plt = import_module("matplotlib.pyplot")
    plt.switch_backend("Agg")
    yield plt
    plt.close("all")


@pytest.fixture(scope="module")
def result() -> ps.Result:
    texture = RNG.integers(0, 256, (40, 64, 3), np.uint8)
    return ps.match(texture[:, :60], texture[:, 4:], num_disparities=8)


def pixels(image: AxesImage) -> NDArray[np.uint8]:
    """Return the colors of an image's data."""
    drawn: NDArray[np.uint8] = image.to_rgba(image.get_array(), bytes=True)
    return drawn[:, :, :3]


def labels(axes: Axes) -> list[str]:
    legend = axes.get_legend()
    return [text.get_text() for text in legend.get_texts()]


def test_a_disparity_map_has_its_data_limits_and_colors(axes: Axes) -> None:
    image = plot.disparity(MAP, axes, low=10, high=50)
    assert image.axes is axes

    data: Any = image.get_array()
    np.testing.assert_array_equal(data.mask, ~np.isfinite(MAP))
    np.testing.assert_array_equal(data.filled(0), np.where(np.isfinite(MAP), MAP, 0))
    assert image.get_clim() == (10, 50)

    np.testing.assert_array_equal(pixels(image), colorize(MAP, low=10, high=50))
    assert tuple(pixels(image)[2, 5]) == tuple(pixels(image)[3, 6]) == NEUTRAL


@pytest.mark.parametrize(
    ("low", "high", "extend"), [(0, 90, "neither"), (10, 90, "min"), (0, 9, "max"), (9, 10, "both")]
)
def test_the_scale_is_in_pixels_and_tells_what_is_beyond(
    axes: Axes, low: float, high: float, extend: str
) -> None:
    bar: Any = plot.disparity(MAP, axes, low=low, high=high).colorbar
    assert (bar.ax.get_ylabel(), bar.extend) == ("disparity, pixels", extend)


def test_results_and_their_arrays_draw_alike(result: ps.Result, axes: Axes) -> None:
    for draw, array in (
        (plot.disparity, result.disparity),
        (plot.confidence, result.confidence),
        (plot.flags, result.flags),
    ):
        np.testing.assert_array_equal(pixels(draw(result, axes)), pixels(draw(array, axes)))


def test_flags_are_named_with_their_shares(axes: Axes) -> None:
    image = plot.flags(FLAGS, axes)
    assert labels(axes) == ["none, 80.0%", "masked, 5.0%", "occluded, 10.0%", "filled, 5.0%"]

    data: Any = image.get_array()
    assert data[0, 0] == 1
    assert data[1, 0] == data[1, 1] == 5
    assert data[2, 0] == list(ps.Flag).index(ps.Flag.FILLED) + 1
    assert not data[3].any()

    legend: Any = axes.get_legend()
    shown = [tuple(np.rint(255 * np.array(h.get_facecolor()[:3]))) for h in legend.legend_handles]
    assert shown == [tuple(pixels(image)[y, x]) for y, x in ((3, 0), (0, 0), (1, 0), (2, 0))]
    assert len(set(shown)) == 4


def test_every_flag_has_its_own_color(axes: Axes) -> None:
    image = plot.flags(np.array([[0, *ps.Flag]]), axes)
    assert len(np.unique(pixels(image)[0], axis=0)) == len(ps.Flag) + 1


def test_errors_have_the_colors_of_their_picture(axes: Axes) -> None:
    estimate = np.array([[10.0, 11.0, 11.1, 13.0, 14.0, 50.0, np.nan, 9.0, 12.0, 12.0]])
    truth = np.where(np.arange(10) == 8, np.nan, np.full((1, 10), 10.0))

    mask = np.arange(10)[np.newaxis] != 9
    image = plot.error(estimate, truth, axes, mask=mask)

    wanted = error_picture(estimate, truth, mask).astype(int)
    assert np.abs(pixels(image).astype(int) - wanted).max() <= 3
    assert [tuple(pixel) for pixel in pixels(image)[0, [0, 1, 7]]] == [(255, 255, 255)] * 3
    assert [tuple(pixel) for pixel in pixels(image)[0, 8:]] == [UNSCORED] * 2

    data: Any = image.get_array()
    np.testing.assert_allclose(data.filled(-1)[0], [0, 1, 1.1, 3, 4, 40, 4, 1, -1, -1])
    assert image.get_clim() == (0, 4)
    assert image.colorbar.extend == "max"


def test_a_histogram_counts_every_estimate_in_its_color(axes: Axes) -> None:
    whole = np.array([[3.0, 3.0, 5.0, np.nan, 4.0, 3.0]])
    assert plot.histogram(whole, axes, low=3, high=5) is axes

    bars: Any = axes.patches
    assert [bar.get_height() for bar in bars] == [3, 1, 1]
    assert [bar.get_x() + bar.get_width() / 2 for bar in bars] == [3, 4, 5]

    wanted = colorize(np.array([[3.0, 4.0, 5.0]]), low=3, high=5)[0]
    for bar, color in zip(bars, wanted, strict=True):
        np.testing.assert_allclose(np.array(bar.get_facecolor()[:3]) * 255, color, atol=1)

    assert axes.get_xlabel() == "disparity, pixels"


@pytest.mark.parametrize(
    "disparity",
    [
        MAP,
        np.arange(1000.0).reshape(20, 50),
        np.full((2, 2), 7.25),
        np.full((1, 1), -3.0),
        np.array([[1e6, -4.0]]),
    ],
)
def test_histograms_leave_nothing_out(axes: Axes, disparity: NDArray[Any]) -> None:
    bars: Any = plot.histogram(disparity, axes).patches
    assert sum(bar.get_height() for bar in bars) == np.isfinite(disparity).sum()
    assert len(bars) <= 200


def test_without_any_estimate_there_is_a_gray_map_and_no_bar(axes: Axes) -> None:
    nothing = np.full((3, 4), np.nan)
    assert (pixels(plot.disparity(nothing, axes)) == NEUTRAL).all()
    assert not plot.histogram(nothing, axes).patches


def test_an_anaglyph_is_red_left_and_cyan_right(axes: Axes) -> None:
    left = np.zeros((4, 6), np.uint8)
    left[:, 3] = 200

    right = np.zeros((4, 6, 3), np.uint8)
    right[:, 1] = 100

    data: Any = plot.pair((left, right), axes).get_array()
    assert data.shape == (4, 6, 3)
    assert tuple(data[0, 3]) == (200, 0, 0)
    assert tuple(data[0, 1]) == (0, 100, 100)


def test_side_by_side_has_lines_along_rows(axes: Axes) -> None:
    left, right = RNG.integers(0, 256, (2, 30, 40, 3), np.uint8)
    data: Any = plot.pair((left, right), axes, style="side by side").get_array()
    np.testing.assert_array_equal(data, np.hstack([left, right]))
    lines: Any = axes.lines
    assert len(lines) > 4
    assert all(len(set(line.get_ydata())) == 1 and 0 < line.get_ydata()[0] < 29 for line in lines)


def test_pairs_of_any_depth_keep_their_contrast(axes: Axes) -> None:
    left = np.linspace(0, 4095, 600).reshape(20, 30).astype(np.uint16)

    data: Any = plot.pair((left, left // 2), axes).get_array()
    assert data[..., 0].max() > 250
    assert 120 < data[..., 1].max() < 135

    floats = np.where(np.arange(30) == 3, np.nan, left / 4095)
    data = plot.pair((floats, floats / 2), axes).get_array()
    assert not data[:, 3].any()
    assert data[..., 0].max() > 250


def test_blur_has_its_kinds_on_the_pixels_of_the_image(axes: Axes, result: ps.Result) -> None:
    estimate = BlurEstimate(KINDS, np.array([[0, 0, 1], [0, 1, 1]], np.uint8), 16, 1.0, 1.0, (0, 0))

    alone = plot.blur(estimate, axes)
    assert tuple(alone.get_extent()) == (-0.5, 47.5, 31.5, -0.5)
    assert labels(axes) == ["none, 50.0%", "left, motion 9.00 px at 45 degrees, 50.0%"]

    on_image: Any = plot.blur(replace(result, blur=estimate), axes).get_array()
    assert on_image.shape == (40, 60)
    assert on_image[15, 31] == 0
    assert on_image[15, 32] == on_image[16, 16] == on_image[39, 59] == 1


def test_an_overview_has_all_there_is(result: ps.Result) -> None:
    figure = Figure()
    assert plot.overview(result, figure) is figure
    titles = [axes.get_title() for axes in figure.axes]
    optional = ["Confidence", "Error bars", "Blur", "Pair"]
    assert titles == ["Disparity", "Histogram", "Flags", *optional]
    assert figure.get_suptitle() == result.verdict != ""

    none: dict[str, Any] = dict.fromkeys(("confidence", "uncertainty", "blur", "pair"))
    bare = plot.overview(replace(result, **none), Figure())
    assert [axes.get_title() for axes in bare.axes] == titles[:3]


def test_without_axes_they_are_those_of_pyplot(pyplot: Any, result: ps.Result) -> None:
    _, (first, second) = pyplot.subplots(1, 2)
    assert plot.disparity(MAP).axes is second
    assert plot.histogram(MAP) is second
    assert plot.disparity(MAP, first).axes is first
    assert pyplot.gca() is second
    assert plot.overview(result) is pyplot.gcf()


def test_with_axes_pyplot_is_left_alone(
    monkeypatch: pytest.MonkeyPatch, axes: Axes, result: ps.Result
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)  # its import would raise
    maps = plot.disparity, plot.confidence, plot.uncertainty, plot.flags
    for draw in (*maps, plot.histogram, plot.pair, plot.blur):
        draw(result, axes)
    plot.error(result, result.disparity, axes)
    plot.overview(result, Figure())


def test_without_matplotlib_the_command_is_named(
    monkeypatch: pytest.MonkeyPatch, result: ps.Result
) -> None:
    for name in [name for name in sys.modules if name.split(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    result = replace(result, uncertainty=result.confidence)
    for name in plot.__all__:
        more = (result.disparity,) if name == "error" else ()
        with pytest.raises(ImportError, match=r"pip install 'phasestereo\[plot\]'"):
            getattr(plot, name)(result, *more)


BARE = ps.Result(MAP, np.zeros(MAP.shape, np.uint16), None, ps.Settings(), {})


@pytest.mark.parametrize(
    ("draw", "arguments", "error", "message"),
    [
        (plot.disparity, (np.zeros((2, 2), int),), TypeError, "disparity: got dtype int64"),
        (plot.disparity, (np.zeros(4),), ValueError, r"disparity: got shape \(4,\)"),
        (plot.histogram, (np.zeros((0, 4)),), ValueError, r"disparity: got shape \(0, 4\)"),
        (plot.confidence, (BARE,), ValueError, "result: got one without confidence;.*=True"),
        (plot.uncertainty, (BARE,), ValueError, "result: got one without uncertainty;.*=True"),
        (plot.confidence, (np.zeros((1, 2, 3)),), ValueError, "confidence: got shape"),
        (plot.flags, (np.zeros((2, 2)),), TypeError, "flags: got dtype float64; accepts integers"),
        (plot.flags, (np.zeros(3, int),), ValueError, r"flags: got shape \(3,\)"),
        (plot.flags, (np.full((2, 2), 1 << 14),), ValueError, "flags: got bits 0x4000"),
        (plot.error, (MAP, MAP[1:]), ValueError, "truth: got shape"),
        (plot.pair, (BARE,), ValueError, "images: got a result that does not know its pair"),
        (plot.pair, ((MAP,),), ValueError, "images: got 1"),
        (plot.pair, ((FLAGS.astype(int),) * 2,), TypeError, "left: got dtype int64"),
        (plot.blur, (BARE,), ValueError, "estimate: got a result without one.*estimate_blur"),
        (plot.blur, (MAP,), TypeError, "estimate: got ndarray"),
        (plot.overview, (MAP,), TypeError, "result: got ndarray"),
    ],
)
def test_errors_name_the_argument(
    draw: Any, arguments: tuple[Any, ...], error: type[Exception], message: str
) -> None:
    figure = Figure()
    target = figure if draw is plot.overview else figure.add_subplot()
    with pytest.raises(error, match=message):
        draw(*arguments, target)


def test_limits_and_styles_are_checked(axes: Axes) -> None:
    with pytest.raises(ValueError, match="low: got 3; accepts at most high"):
        plot.disparity(MAP, axes, low=3, high=2)

    with pytest.raises(ValueError, match="worst: got 1; accepts more than 1 pixel"):
        plot.error(MAP, MAP, axes, worst=1)

    style: Any = "mixed"
    with pytest.raises(ValueError, match="style: got 'mixed'; accepts 'anaglyph'"):
        plot.pair((FLAGS, FLAGS), axes, style=style)

    assert not axes.images

"""Maps of a match on matplotlib's axes, to place in your own figures.

Every function takes its data first and the axes second: without axes, the current ones of pyplot.
It draws in pixel coordinates, leaves titles to the caller, and returns the image it added, or the
axes. matplotlib comes with the extra ``plot``; the colors are those of `phasestereo.views.picture`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._extras import require
from phasestereo._images import as_alike, as_numbers
from phasestereo._numbers import check_type
from phasestereo.result import Flag, Result
from phasestereo.rig.blur import BlurEstimate
from phasestereo.views.picture import (
    CONFIDENCE_COLORS,
    DISPARITY_COLORS,
    ERROR_COLORS,
    GOOD,
    NEUTRAL,
    UNCERTAINTY_COLORS,
    UNSCORED,
    as_map,
    distribution,
    error_map,
    limits,
    longest,
    viewable,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

Disparities: TypeAlias = Result | ArrayLike

__all__ = [
    "blur",
    "confidence",
    "disparity",
    "error",
    "flags",
    "histogram",
    "overview",
    "pair",
    "uncertainty",
]

_CATEGORIES = "tab20"  # ten colors, each beside a lighter one
_UNFLAGGED = "#ffffff"
_SHADES = 1024
_GRAY = np.array([0.299, 0.587, 0.114])
_BAR = 1.03, 0.0, 0.04, 1.0  # x, y, width and height, in those of the axes
_LEGEND: dict[str, Any] = {  # below the numbers along the axis, not on them
    "loc": "upper left",
    "bbox_to_anchor": (0, 0),
    "borderaxespad": 2.2,
    "ncols": 2,
    "fontsize": "small",
    "frameon": False,
}
_LINES = 9  # across a pair
_LINE_COLOR = "#ffd400"


def disparity(
    result: Disparities,
    ax: Axes | None = None,
    *,
    low: float | None = None,
    high: float | None = None,
    colorbar: bool = True,
    cmap: str = DISPARITY_COLORS,
) -> AxesImage:
    """Draw a disparity map: far is blue, near is red, no estimate is gray.

    Parameters
    ----------
    result
        The result, or disparities: float (H, W), pixels; NaN or infinite = no estimate.
    ax
        The axes to draw on; None: the current axes of pyplot.
    low, high
        Disparities at the ends of the colors. None: the 1st and the 99th percentile.
    colorbar
        Whether to draw a scale in pixels beside it.
    cmap
        Name of a color map of matplotlib.

    Returns
    -------
    AxesImage
        The map, with the disparities as its data, masked where there is no estimate.

    Raises
    ------
    TypeError
        If the disparities are not floats, or a limit is not a number.
    ValueError
        If the shape is not (H, W), a limit is not finite, or low exceeds high.
    ImportError
        If matplotlib is not installed.
    """
    values = _disparities(result)
    known = values[np.isfinite(values)]
    ends = limits(known, low, high)

    image = _draw(ax, values, ends, _colors(cmap, bad=NEUTRAL))

    if colorbar:
        _bar(image, "disparity, pixels", extend=_extent(known, ends))
    return image


def confidence(result: Disparities, ax: Axes | None = None, *, colorbar: bool = True) -> AxesImage:
    """Draw a map of confidences, 0 to 1.

    Parameters
    ----------
    result
        The result, or confidences: float (H, W).
    ax, colorbar
        As for `disparity`.

    Returns
    -------
    AxesImage
        The map, with the confidences as its data.

    Raises
    ------
    TypeError
        If the confidences are not floats.
    ValueError
        If the shape is not (H, W), or the result has no confidences.
    ImportError
        If matplotlib is not installed.
    """
    values = _optional(result, "confidence")
    image = _draw(ax, values, (0.0, 1.0), _colors(CONFIDENCE_COLORS, bad=NEUTRAL))
    if colorbar:
        _bar(image, "confidence")
    return image


def uncertainty(result: Disparities, ax: Axes | None = None, *, colorbar: bool = True) -> AxesImage:
    """Draw a map of error bars: short ones are light, long ones are dark, no estimate is gray.

    Parameters
    ----------
    result
        The result, or error bars: float (H, W), pixels, such as `phasestereo.Result.uncertainty`.
    ax, colorbar
        As for `disparity`.

    Returns
    -------
    AxesImage
        The map, with the error bars as its data; colors end at their 99th percentile.

    Raises
    ------
    TypeError
        If the error bars are not floats.
    ValueError
        If the shape is not (H, W), or the result has no error bars.
    ImportError
        If matplotlib is not installed.
    """
    values = _optional(result, "uncertainty")
    ends = 0.0, longest(values)
    image = _draw(ax, values, ends, _colors(UNCERTAINTY_COLORS, bad=NEUTRAL))
    if colorbar:
        extend = _extent(values[np.isfinite(values)], ends)
        _bar(image, "error bar, \N{PLUS-MINUS SIGN} pixels", extend=extend)
    return image


def flags(result: Result | ArrayLike, ax: Axes | None = None, *, legend: bool = True) -> AxesImage:
    """Draw why pixels have no estimate, or an untrusted one.

    If a pixel has several flags, the map shows the one with the smallest value. ``FILLED`` comes
    with a reason, so the map shows it only where it is alone.

    Parameters
    ----------
    result
        The result, or flags: integers (H, W), bits of `phasestereo.Flag`.
    ax
        As for `disparity`.
    legend
        Whether to name the colors beside it, each with its share of the pixels.

    Returns
    -------
    AxesImage
        The map; its data are 0 where no flag is set, else the number of the flag on display:
        `Flag.MASKED` is 1, `Flag.NO_CANDIDATE` 2 and so on.

    Raises
    ------
    TypeError
        If the flags are not integers.
    ValueError
        If the shape is not (H, W), or a flag is not in `phasestereo.Flag`.
    ImportError
        If matplotlib is not installed.
    """
    categories = _categories(result.flags if isinstance(result, Result) else result)
    names = ["none", *(flag.words for flag in Flag)]
    colors = [_UNFLAGGED, *_category_colors(len(Flag))]
    return _draw_categories(ax, categories, names, colors, legend=legend)


def error(
    estimate: Disparities,
    truth: ArrayLike,
    ax: Axes | None = None,
    *,
    mask: ArrayLike | None = None,
    worst: float = 4.0,
    colorbar: bool = True,
) -> AxesImage:
    """Draw the errors of a disparity map: white is right, yellow to dark red is wrong.

    Errors up to 1 pixel, which are not bad, are white. Gray pixels do not count.

    Parameters
    ----------
    estimate
        The result, or disparities: float (H, W), pixels; NaN or infinite = missing, which counts
        as the worst error.
    truth
        Float (H, W), pixels; NaN or infinite = unknown.
    ax, colorbar
        As for `disparity`.
    mask
        Pixels that count, bool (H, W); None: all whose truth is known.
    worst
        Error in pixels at and above which the color is the darkest, more than 1.

    Returns
    -------
    AxesImage
        The map, with the absolute errors as its data, masked where pixels do not count.

    Raises
    ------
    TypeError
        If the maps are not floats, the mask is not bool, or worst is not a number.
    ValueError
        If shapes differ or are not (H, W), or worst is not above 1.
    ImportError
        If matplotlib is not installed.
    """
    values = error_map(_disparities(estimate), truth, mask, worst=worst)
    image = _draw(ax, values, (0.0, float(worst)), _error_colors(worst))
    if colorbar:
        _bar(image, "error, pixels", extend=_extent(values[~np.isnan(values)], (0.0, worst)))
    return image


def histogram(
    result: Disparities,
    ax: Axes | None = None,
    *,
    low: float | None = None,
    high: float | None = None,
    cmap: str = DISPARITY_COLORS,
) -> Axes:
    """Draw a histogram of the disparities, each in its color of the map.

    Parameters
    ----------
    result, ax, low, high, cmap
        As for `disparity`.

    Returns
    -------
    Axes
        The axes, with one bar a bin. Whole disparities are at the bars' centers.

    Raises
    ------
    TypeError, ValueError, ImportError
        As `disparity`.
    """
    values = _disparities(result)
    known = values[np.isfinite(values)]
    ends = limits(known, low, high)

    axes = _axes(ax)
    axes.set_xlabel("disparity, pixels")
    axes.set_ylabel("pixels of the image")
    if not known.size:
        return axes

    counts, edges = distribution(known)
    norm = require("matplotlib.colors", extra="plot").Normalize(*ends)
    colors = _colors(cmap, bad=NEUTRAL)(norm((edges[:-1] + edges[1:]) / 2))
    axes.bar(edges[:-1], counts, np.diff(edges), align="edge", color=colors)
    axes.set_facecolor(_fraction(NEUTRAL))  # the ends of turbo are dark, its middle is light
    axes.set_xlim(float(edges[0]), float(edges[-1]))
    return axes


def pair(
    images: Result | Sequence[ArrayLike],
    ax: Axes | None = None,
    *,
    style: Literal["anaglyph", "side by side"] = "anaglyph",
) -> AxesImage:
    """Draw both images of a pair in one.

    Parameters
    ----------
    images
        The left and the right image as `phasestereo.match` takes them, or a result with its images.
    ax
        As for `disparity`.
    style
        "anaglyph": the left image red over the right one in cyan, for red-cyan glasses; objects
        shift by their disparity, and in a rectified pair by nothing else. "side by side": left and
        right, with lines along rows; corresponding points lie on one line.

    Returns
    -------
    AxesImage
        The picture.

    Raises
    ------
    TypeError
        For a wrong type or dtype.
    ValueError
        If the images are not two of one size, the result does not know them, or the style is
        unknown.
    ImportError
        If matplotlib is not installed.
    """
    left, right = _images(images)
    if style not in ("anaglyph", "side by side"):
        raise ValueError(f"style: got {style!r}; accepts 'anaglyph' and 'side by side'")

    if style == "anaglyph":
        red, cyan = (np.rint(image @ _GRAY).astype(np.uint8) for image in (left, right))
        return _axes(ax).imshow(np.dstack([red, cyan, cyan]))

    image = _axes(ax).imshow(np.hstack([left, right]))
    for y in np.linspace(0, left.shape[0] - 1, _LINES + 2)[1:-1]:
        image.axes.axhline(y, color=_LINE_COLOR, linewidth=0.8)
    return image


def blur(
    estimate: Result | BlurEstimate, ax: Axes | None = None, *, legend: bool = True
) -> AxesImage:
    """Draw the blur of each part of the left image, relative to the right one.

    Parameters
    ----------
    estimate
        The estimate from `phasestereo.estimate_blur`, or a result with `Result.blur`.
    ax
        As for `disparity`.
    legend
        Whether to name the blurs beside it, each with its share of the image.

    Returns
    -------
    AxesImage
        The map; its data are the indices into `BlurEstimate.blurs`. For a result it has the
        image's pixels; for an estimate, which does not know them, its tiles, placed on them.

    Raises
    ------
    TypeError
        If it is neither.
    ValueError
        If the result has no such estimate.
    ImportError
        If matplotlib is not installed.
    """
    found = estimate.blur if isinstance(estimate, Result) else estimate
    if found is None:
        raise ValueError(
            "estimate: got a result without one; it is there if the match evened out blur "
            "(compensate_blur=True), and estimate_blur gives it by itself"
        )
    check_type("estimate", found, BlurEstimate, "a Result or BlurEstimate")

    # An estimate does not know its image: draw each tile as a pixel, and stretch it.
    labels = found.labels
    rows, cols = (length * found.tile for length in labels.shape)
    if isinstance(estimate, Result):
        rows, cols = estimate.disparity.shape
        labels = found.label_map((rows, cols))

    colors = _category_colors(len(found.blurs))
    image = _draw_categories(ax, labels, [str(one) for one in found.blurs], colors, legend=legend)
    image.set_extent((-0.5, cols - 0.5, rows - 0.5, -0.5))
    return image


def overview(result: Result, figure: Figure | None = None) -> Figure:
    """Draw all contents of a result: disparities, histogram, flags, confidences and so on.

    Parameters
    ----------
    result
        The result.
    figure
        The figure to draw in; None: a new figure of pyplot.

    Returns
    -------
    Figure
        The figure, with titled axes. In a notebook, pyplot drops a new figure, and only the cell
        shows it; otherwise the notebook would show it twice.

    Raises
    ------
    TypeError
        If it is not a result.
    ImportError
        If matplotlib is not installed.
    """
    check_type("result", result, Result, "a Result")

    known: tuple[tuple[str, Callable[[Result, Axes], object], object], ...] = (
        ("Disparity", disparity, True),
        ("Histogram", histogram, True),
        ("Flags", flags, True),
        ("Confidence", confidence, result.confidence),
        ("Error bars", uncertainty, result.uncertainty),
        ("Blur", blur, result.blur),
        ("Pair", pair, result.pair),
    )
    drawn = [(title, draw) for title, draw, there in known if there is not None]

    is_new = figure is None
    if figure is None:
        pyplot = require("matplotlib.pyplot", extra="plot")
        figure = pyplot.figure(figsize=(15, 8), layout="constrained")

    figure.suptitle(result.verdict)
    for place, (title, draw) in enumerate(drawn, 1):
        axes = figure.add_subplot(2, -(-len(drawn) // 2), place)
        axes.set_title(title)
        draw(result, axes)

    # A notebook shows open figures when a cell ends, beside its value.
    if is_new and "inline" in require("matplotlib", extra="plot").get_backend().lower():
        require("matplotlib.pyplot", extra="plot").close(figure)
    return figure


def _axes(ax: Axes | None) -> Axes:
    if ax is None:
        return require("matplotlib.pyplot", extra="plot").gca()
    require("matplotlib", extra="plot")
    return ax


def _draw(ax: Axes | None, values: NDArray[Any], ends: tuple[float, float], cmap: Any) -> AxesImage:
    """Draw a map pixel by pixel: values in between would mean nothing."""
    low, high = ends
    masked = np.ma.masked_invalid(values)
    return _axes(ax).imshow(masked, cmap=cmap, vmin=low, vmax=high, interpolation="nearest")


def _draw_categories(
    ax: Axes | None,
    categories: NDArray[np.integer],
    names: Sequence[str],
    colors: Sequence[Any],
    *,
    legend: bool,
) -> AxesImage:
    """Draw a map of categories, and name those that occur."""
    cmap = require("matplotlib.colors", extra="plot").ListedColormap(colors)
    image = _draw(ax, categories, (-0.5, len(colors) - 0.5), cmap)

    if legend:
        patch = require("matplotlib.patches", extra="plot").Patch
        shares = np.bincount(categories.ravel(), minlength=len(names)) / categories.size
        handles = [
            patch(facecolor=color, edgecolor="black", label=f"{name}, {share:.1%}")
            for name, color, share in zip(names, colors, shares, strict=True)
            if share
        ]
        image.axes.legend(handles=handles, **_LEGEND)

    return image


def _bar(image: AxesImage, label: str, *, extend: str = "neither") -> None:
    figure: Any = image.axes.figure
    beside = image.axes.inset_axes(_BAR)  # as high as the map, for any shape
    figure.colorbar(image, cax=beside, label=label, extend=extend)


def _extent(known: NDArray[np.float64], ends: tuple[float, float]) -> str:
    """Return the ends of the colors that values exceed, by matplotlib's names."""
    beyond = bool((known < ends[0]).any()), bool((known > ends[1]).any())
    names = {(True, True): "both", (True, False): "min", (False, True): "max"}
    return names.get(beyond, "neither")


def _colors(name: str, *, bad: tuple[int, int, int]) -> Any:
    colors = require("matplotlib", extra="plot").colormaps[name]
    return colors.with_extremes(bad=_fraction(bad))


def _error_colors(worst: float) -> Any:
    """Return the colors from 0 to the worst error, white for errors that are not bad."""
    shades = _colors(ERROR_COLORS, bad=UNSCORED)(np.linspace(0, 1, _SHADES))
    shades[: int(_SHADES * GOOD / worst) + 1] = 1
    listed = require("matplotlib.colors", extra="plot").ListedColormap(shades)
    return listed.with_extremes(bad=_fraction(UNSCORED))


def _category_colors(count: int) -> list[Any]:
    colors = require("matplotlib", extra="plot").colormaps[_CATEGORIES].colors
    colors = [*colors[::2], *colors[1::2]]
    return [colors[number % len(colors)] for number in range(count)]


def _fraction(color: tuple[int, int, int]) -> tuple[float, float, float]:
    red, green, blue = (part / 255 for part in color)
    return red, green, blue


def _disparities(given: Disparities) -> NDArray[np.float64]:
    return as_map("disparity", given.disparity if isinstance(given, Result) else given)


def _optional(given: Disparities, name: str) -> NDArray[np.float64]:
    """Return a map that not every result has."""
    values = given.maps.get(name) if isinstance(given, Result) else given
    if values is None:
        raise ValueError(
            f"result: got one without {name}; it is there if it is matched with confidence=True"
        )
    return as_map(name, values)


def _categories(given: ArrayLike) -> NDArray[np.intp]:
    """Return the number of the flag to draw for each pixel, 0 without a flag."""
    bits = as_numbers(given, "flags", "iu")
    if unknown := int(np.bitwise_or.reduce(bits, axis=None)) & ~sum(Flag):
        raise ValueError(f"flags: got bits {unknown:#x}; accepts those of Flag")

    numbers = {flag: number for number, flag in enumerate(Flag, 1)}
    categories = np.zeros(bits.shape, np.intp)
    # In falling order, to write the smallest flag of a pixel last; FILLED comes first.
    for flag in sorted(Flag, key=lambda flag: (flag is Flag.FILLED, flag), reverse=True):
        categories[bits & flag != 0] = numbers[flag]
    return categories


def _images(given: Result | Sequence[ArrayLike]) -> list[NDArray[np.uint8]]:
    images = given.pair if isinstance(given, Result) else given
    if images is None:
        raise ValueError("images: got a result that does not know its pair; accepts two images")
    if len(images) != 2:
        raise ValueError(f"images: got {len(images)}; accepts two, left and right")

    return viewable(*as_alike(*images))

"""Pictures to look at: disparities and errors in color, and several of them side by side.

This module turns arrays into RGB images; it reads, writes and shows nothing. matplotlib (the extra
``plot``) supplies the colors, the axes and the text, through figures outside its global state.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._extras import require
from phasestereo._images import Mask, as_mask, as_numbers, as_pixels, on_screens
from phasestereo._numbers import as_number

Picture = NDArray[np.uint8]
Map = NDArray[np.float64]
Ends = tuple[float, float]

__all__ = [
    "CONFIDENCE_COLORS",
    "DISPARITY_COLORS",
    "ERROR_COLORS",
    "GOOD",
    "NEUTRAL",
    "UNCERTAINTY_COLORS",
    "UNSCORED",
    "as_map",
    "colorize",
    "disparity_picture",
    "distribution",
    "error_map",
    "error_picture",
    "hatched",
    "limits",
    "longest",
    "viewable",
]

DISPARITY_COLORS, CONFIDENCE_COLORS, ERROR_COLORS = "turbo", "viridis", "YlOrRd"
"""Names of matplotlib's maps of colors."""

UNCERTAINTY_COLORS = "magma_r"
"""The same for error bars: short ones are light, long ones are dark."""

NEUTRAL = (112, 112, 112)
"""Color of pixels without an estimate: turbo, whose colors are vivid, has none near it."""

UNSCORED = (190, 190, 190)
"""Color of pixels that do not count; those of errors are white, and yellow to dark red."""

GOOD = 1.0
"""Largest error in pixels that is not bad."""

_ROBUST = (1.0, 99.0)  # percentiles: a few outliers must not take the colors from the rest
_BINS = 96
_BAND = 64  # rows to color at a time
_HATCHING = 6  # columns from a line of hatched pixels to the next one
_PAPER = "#f4f4f4"  # not white: a picture without errors would not stand out from it
_DPI = 100
_OVER = 0.1  # pixels: a size that floats round down would lose a row or column


def colorize(
    disparity: ArrayLike,
    *,
    low: float | None = None,
    high: float | None = None,
    trusted: ArrayLike | None = None,
) -> Picture:
    """Color a disparity map: far is blue, near is red, no estimate is gray (`NEUTRAL`).

    Parameters
    ----------
    disparity
        Float (H, W), pixels; NaN or infinite = no estimate.
    low, high
        Disparities at the ends of the colors; beyond them the colors stay. None: the 1st and the
        99th percentile of the estimates.
    trusted
        bool (H, W), such as `phasestereo.Result.trusted`: other pixels are hatched in gray. None:
        all are trusted.

    Returns
    -------
    ndarray
        uint8 (H, W, 3), RGB, in matplotlib's map turbo.

    Raises
    ------
    TypeError
        If the disparities are not floats, trusted is not bool, or a limit is not a number.
    ValueError
        If shapes differ or are not (H, W), a limit is not finite, or low exceeds high.
    ImportError
        If matplotlib is not installed.
    """
    values = as_numbers(disparity, "disparity", "f")
    ends = limits(values[np.isfinite(values)], low, high)
    picture = np.empty((*values.shape, 3), np.uint8)
    _paint(picture, values, as_mask(trusted, values.shape, "trusted"), ends)
    return picture


def _paint(picture: Picture, values: NDArray[Any], sure: Mask | None, ends: Ends) -> None:
    """Color disparities into a picture of their size, by bands of rows: copies of a map are large.

    Parameters
    ----------
    picture
        uint8 (H, W, 3), the output.
    values
        Floats (H, W), pixels.
    sure
        bool (H, W); other pixels are hatched. None: all are sure.
    ends
        Disparities at the ends of the colors.
    """
    for top in range(0, len(values), _BAND):
        rows = slice(top, top + _BAND)
        band = values[rows].astype(np.float64)
        known = np.isfinite(band)
        colored = _colored(band, known, ends, DISPARITY_COLORS, NEUTRAL)
        if sure is not None:
            colored = hatched(colored, known & ~sure[rows], top=top)
        picture[rows] = colored


def hatched(picture: Picture, pixels: Mask, *, top: int = 0) -> Picture:
    """Return a picture with some pixels mixed half with gray, and lines of them all gray.

    Parameters
    ----------
    picture
        uint8 (H, W, 3), RGB.
    pixels
        Which, bool (H, W); the others stay as they are.
    top
        The row of the whole picture at which this one starts.
    """
    y, x = np.ogrid[top : top + pixels.shape[0], : pixels.shape[1]]
    lines = (x + y) % _HATCHING < _HATCHING // 2
    pale = (picture // 2 + np.array(NEUTRAL) // 2).astype(np.uint8)

    drawn = np.where(pixels[:, :, np.newaxis], pale, picture)
    drawn[pixels & lines] = NEUTRAL
    return drawn


def disparity_picture(
    disparity: ArrayLike,
    *,
    title: str = "",
    low: float | None = None,
    high: float | None = None,
    trusted: ArrayLike | None = None,
) -> Picture:
    """Draw a disparity map as `colorize` does, under a title and beside a bar of the colors.

    Parameters
    ----------
    disparity, low, high, trusted
        As for `colorize`.
    title
        Text above the map.

    Returns
    -------
    ndarray
        uint8 RGB; the map has its own size in pixels, on light gray.

    Raises
    ------
    TypeError, ValueError, ImportError
        As `colorize`.
    """
    values = as_numbers(disparity, "disparity", "f")
    sure = as_mask(trusted, values.shape, "trusted")
    low, high = limits(values[np.isfinite(values)], low, high)

    # Sizes in pixels; matplotlib places things by fractions of a figure, from the bottom left.
    rows, cols = values.shape
    text = max(6, cols // 28)  # the line height at which 50 letters span the picture
    margin, beside = 2 * text, 7 * text
    width, height = margin + cols, rows + 2 * margin

    heading = _figure(width, margin)
    heading.text(margin / width, 0.5, title, va="center", size=_points(text))
    top = _drawn(heading)
    scale = _scale(beside, height, text, (low, high))

    # The figures are strips: one for the whole picture would take 4 bytes a pixel more than once.
    picture = np.empty((height, width + beside, 3), np.uint8)
    picture[:, :width] = top[0, 0]
    picture[:margin, :width] = top
    picture[:, width:] = scale
    _paint(picture[margin : margin + rows, margin:width], values, sure, (low, high))
    return picture


def _scale(width: int, height: int, text: int, ends: Ends) -> Picture:
    """Draw the bar of the colors, with a margin of two lines above and below it."""
    figure = _figure(width, height)
    margin = 2 * text
    box = text / width, margin / height, text / width, 1 - 2 * margin / height
    normalize = require("matplotlib.colors", extra="plot").Normalize(*ends)
    mappable = require("matplotlib.cm", extra="plot").ScalarMappable(normalize, DISPARITY_COLORS)
    bar = figure.colorbar(mappable, cax=figure.add_axes(box))
    bar.set_label("disparity, pixels", size=_points(text))
    bar.ax.tick_params(labelsize=_points(text))

    return _drawn(figure)


def error_picture(
    estimate: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None, *, worst: float = 4.0
) -> Picture:
    """Color the error of a disparity map: white is right, yellow to dark red is wrong.

    Errors up to 1 pixel, which are not bad, are white. Gray pixels (`UNSCORED`) do not count.

    Parameters
    ----------
    estimate, truth
        Float (H, W), pixels; NaN or infinite = missing (as bad as the worst), unknown.
    mask
        Pixels that count, bool (H, W); None: all whose truth is known.
    worst
        Error in pixels at and above which the color is the darkest, more than 1.

    Returns
    -------
    ndarray
        uint8 (H, W, 3), RGB.

    Raises
    ------
    TypeError
        If the maps are not floats, the mask is not bool, or worst is not a number.
    ValueError
        If shapes differ or are not (H, W), or worst is not above 1.
    ImportError
        If matplotlib is not installed.
    """
    error = error_map(estimate, truth, mask, worst=worst)
    scored = ~np.isnan(error)
    picture = _colored(error, scored, (0.0, float(worst)), ERROR_COLORS, UNSCORED)
    picture[scored & (error <= GOOD)] = 255
    return picture


def error_map(
    estimate: ArrayLike, truth: ArrayLike, mask: ArrayLike | None = None, *, worst: float
) -> Map:
    """Return the errors that `error_picture` colors: pixels, float64 (H, W).

    Parameters
    ----------
    estimate, truth, mask, worst
        As for `error_picture`.

    Returns
    -------
    ndarray
        The absolute error, ``worst`` for a missing estimate, NaN for a pixel that does not count.

    Raises
    ------
    TypeError, ValueError
        As `error_picture`.
    """
    found, wanted = as_map("estimate", estimate), as_map("truth", truth, np.shape(estimate))
    if as_number("worst", worst) <= GOOD:
        raise ValueError(f"worst: got {worst:g}; accepts more than {GOOD:g} pixel")

    scored = np.isfinite(wanted)
    if mask is not None:
        scored &= as_mask(mask, found.shape, "mask")

    error = np.full(found.shape, float(worst))
    np.subtract(found, wanted, out=error, where=scored & np.isfinite(found))
    return np.where(scored, np.abs(error), np.nan)


def viewable(*images: ArrayLike) -> list[Picture]:
    """Return images as a screen shows them.

    Parameters
    ----------
    *images
        As `phasestereo.match` takes them: (H, W), (H, W, 1), (H, W, 3) or (H, W, 4).

    Returns
    -------
    list of ndarray
        uint8 (H, W, 3), RGB. Images of 8 bits stay the same; in others black is the 0.1th and
        white the 99.9th percentile of all images of that dtype together, so a darker image looks
        darker; pixels that are not finite are black.

    Raises
    ------
    TypeError, ValueError
        As `phasestereo.match` for images.
    """
    pixels = [as_pixels(image, "image") for image in images]
    return [np.repeat(image, 3 // image.shape[2], axis=2) for image in on_screens(pixels)]


def distribution(values: NDArray[np.floating]) -> tuple[NDArray[np.intp], Map]:
    """Count disparities from the smallest to the largest.

    Parameters
    ----------
    values
        Finite values, at least one.

    Returns
    -------
    counts, edges
        Counts of n bins, and their n + 1 edges. Whole values are at the bins' centers: if they are
        few enough, each has its own.
    """
    low, high = float(values.min()), float(values.max())

    # Whole values get bins of whole width, centered on them.
    if (values == np.rint(values)).all():
        step = -(-int(high - low + 1) // (2 * _BINS))
        bins = -(-int(high - low + 1) // step)
        low, high = low - 0.5, low - 0.5 + bins * step
    else:
        bins = _BINS
        low, high = (low - 0.5, high + 0.5) if low == high else (low, high)

    return np.histogram(values, bins, (low, high))


def _colored(
    values: Map, shown: Mask, ends: Ends, colors: str, elsewhere: tuple[int, int, int]
) -> Picture:
    """Look up the color of each shown value; the others get their own color."""
    low, high = ends
    share = np.divide(
        values - low, high - low, out=np.zeros_like(values), where=shown & (high > low)
    )

    lookup = require("matplotlib", extra="plot").colormaps[colors]
    picture: Picture = lookup(share, bytes=True)[:, :, :3].copy()
    picture[~shown] = elsewhere
    return picture


def limits(
    known: NDArray[np.floating], low: float | None = None, high: float | None = None
) -> Ends:
    """Return the disparities at the ends of the colors: the given ones, else robust ones."""
    robust = np.percentile(known, _ROBUST) if known.size else (0.0, 1.0)
    ends = (
        float(robust[0]) if low is None else as_number("low", low),
        float(robust[1]) if high is None else as_number("high", high),
    )

    if ends[0] > ends[1]:
        raise ValueError(f"low: got {ends[0]:g}; accepts at most high, which is {ends[1]:g}")
    return ends


def longest(uncertainty: NDArray[np.floating]) -> float:
    """Return the error bar, pixels, at the end of the colors; they start at 0."""
    return limits(uncertainty[np.isfinite(uncertainty)])[1] or 1.0


def _figure(width: int, height: int) -> Any:
    """Return a figure of this size in pixels, on a canvas that draws into memory."""
    figure = require("matplotlib.figure", extra="plot").Figure(
        figsize=((width + _OVER) / _DPI, (height + _OVER) / _DPI), dpi=_DPI, facecolor=_PAPER
    )
    require("matplotlib.backends.backend_agg", extra="plot").FigureCanvasAgg(figure)
    return figure


def _drawn(figure: Any) -> Picture:
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[:, :, :3].copy()


def _points(pixels: int) -> float:
    return 0.8 * pixels * 72 / _DPI


def as_map(name: str, values: ArrayLike, *shape: tuple[int, ...]) -> Map:
    """Return floats (H, W) of any precision as float64; an error names the argument."""
    return as_numbers(values, name, "f", *shape).astype(np.float64)

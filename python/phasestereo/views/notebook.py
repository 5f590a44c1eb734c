"""Results as notebooks show them: blocks of HTML, which need nothing beside them.

Here belongs what they say, and how they stay small and readable anywhere: all text takes the
colors of the page, light or dark, all style is inline, since notebooks that are not trusted have
no other, and all pictures are shrunk first. Their colors are those of `phasestereo.views.picture`.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable
from html import escape
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo._tables import BLOCK
from phasestereo.result import Result, describe_flags
from phasestereo.views.picture import (
    CONFIDENCE_COLORS,
    NEUTRAL,
    UNCERTAINTY_COLORS,
    Ends,
    Picture,
    colorize,
    distribution,
    limits,
    longest,
    viewable,
)

Scalar = TypeVar("Scalar", bound=np.generic)

_MAP = 440, 330  # pixels, width and height: without any compression still below 0.6 MB of text
_THUMBNAIL = 144, 144  # three of them are as wide as a map
_LEAST = 144  # pixels that a small picture is enlarged to
_SCALE_WIDTH = 456
_SAMPLES = 2**20  # disparities that show how all are distributed
_BARS, _GAP, _STRIP = 72, 4, 12  # rows of the histogram, and of the colors below it
_PHOTOGRAPH_QUALITY = 85  # of a JPEG

_BESIDE = "display:inline-block;vertical-align:top;max-width:520px;"
_FIGURE = "display:inline-block;vertical-align:top;margin:6px 14px 6px 0;max-width:100%;"
_IMAGE = "display:block;margin:0;max-width:100%;"
_CAPTION = "margin:3px 0 0;font-size:90%;"
_TICKS = "position:relative;height:1.5em;font-size:90%;"
_TICK = "position:absolute;width:6em;margin-left:-3em;text-align:center;"


def html(result: Result) -> str:
    """Return a result as HTML.

    Parameters
    ----------
    result
        The result.

    Returns
    -------
    str
        Less than 1 MB, whatever the size of the images: the map in color with a histogram along
        its scale, the pair, if the result knows it, confidences and error bars, if there are any,
        and what there is to say in words. Without matplotlib it is the words, and how to install
        it.
    """
    try:
        known = _known(result.disparity)
        beside = "".join(_beside(result, known))
        pictures = f'{_main(result, limits(known))}<div style="{_BESIDE}">{beside}</div>'
    except ImportError as error:
        pictures = f"<div>No pictures: {escape(str(error))}</div>"

    words = "".join(f"<div>{line}</div>" for line in _words(result))
    return f'<div style="{BLOCK}">{words}{pictures}</div>'


def _words(result: Result) -> Iterable[str]:
    """Yield lines of HTML: what it is, what is missing and why, and what is flagged."""
    rows, cols = result.disparity.shape
    missing = ~np.isfinite(result.disparity)
    share = float(missing.mean())
    estimated = f"{1 - share:.1%} estimated, {result.trusted.mean():.1%} trusted"

    summary = [result.verdict] if result.verdict else []
    summary += [f"{cols} x {rows} pixels", estimated]
    summary += [] if result.blur is None else [f"blur: {result.blur}"]
    summary += [f"{sum(result.timings.values()):.3f} s"]
    yield f"<b>phasestereo.Result</b> {escape(', '.join(summary))}"

    yield from (f"<b>{one.severity}</b>: {escape(one.sentence)}" for one in result.findings)
    if share:
        yield f"No estimate, gray: {share:.1%}, flagged {describe_flags(result.flags * missing)}"
    yield f"All flags: {describe_flags(result.flags)}"


def _known(disparity: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the disparities of all pixels that have one, or of a large map enough of them."""
    known = disparity[np.isfinite(disparity)]
    return known[:: max(1, known.size // _SAMPLES)]


def _main(result: Result, ends: Ends) -> str:
    rows, cols = result.disparity.shape
    low, high = ends
    alt = (
        f"Disparity map, {cols} by {rows} pixels: blue is {low:.1f} pixels and less, "
        f"red is {high:.1f} pixels and more, gray has no estimate, hatched is not trusted"
    )

    shown, trusted = (_shrunk(values, _MAP) for values in (result.disparity, result.trusted))
    picture = colorize(shown, low=low, high=high, trusted=trusted)
    caption = "Disparity: red is near, blue is far, hatched is not trusted"
    return _figure(_image(picture, alt), caption)


def _beside(result: Result, known: NDArray[np.float32]) -> Iterable[str]:
    """Yield what stands beside the map: its scale, the pair, the confidences, the error bars."""
    if known.size:
        yield _figure(_scale(known, limits(known)), "Disparity, pixels: how often which occurs")

    if result.pair is not None:
        for side, picture in zip(("Left", "Right"), _thumbnails(result.pair), strict=True):
            yield _figure(_image(picture, f"{side} image", photograph=True), f"{side} image")

    if result.confidence is not None:
        caption = f"Confidence, mean {result.confidence.mean():.2f}"
        alt = "Map of confidences from 0, dark, to 1, bright"
        yield _figure(_thumbnail(result.confidence, 1.0, CONFIDENCE_COLORS, alt), caption)

    if result.uncertainty is not None:
        known = result.uncertainty[np.isfinite(result.uncertainty)]
        median = f", median \N{PLUS-MINUS SIGN}{np.median(known):.2g} px" if known.size else ""
        end = longest(result.uncertainty)
        alt = f"Map of error bars from 0 pixels, light, to {end:.2g} pixels and more, dark"
        shown = _thumbnail(result.uncertainty, end, UNCERTAINTY_COLORS, alt)
        yield _figure(shown, f"Error bars{median}")


def _thumbnail(values: NDArray[np.float32], end: float, colors: str, alt: str) -> str:
    """Return a small map of values from 0 to an end; what has none is gray."""
    lookup = require("matplotlib", extra="plot").colormaps[colors]
    small = _shrunk(values, _THUMBNAIL)
    picture = lookup(small / end, bytes=True)[:, :, :3].copy()
    picture[np.isnan(small)] = NEUTRAL
    return _image(picture, alt)


def _scale(known: NDArray[np.float32], ends: Ends) -> str:
    """Draw the histogram of the disparities, the color of each, and numbers below."""
    counts, edges = distribution(known)
    colors = colorize((edges[np.newaxis, 1:] + edges[:-1]) / 2, low=ends[0], high=ends[1])

    picture = np.full((_BARS + _GAP + _STRIP, len(counts), 3), NEUTRAL, np.uint8)
    # Bars grow from the bottom, each in the color of its disparity; below is the whole scale.
    heights = np.ceil(_BARS * counts / counts.max())
    bars = np.arange(_BARS, 0, -1)[:, np.newaxis] <= heights
    picture[:_BARS] = np.where(bars[:, :, np.newaxis], colors, picture[:_BARS])
    picture[-_STRIP:] = colors

    low, middle, high = (float(part) for part in np.percentile(known, (0, 50, 100)))
    alt = f"Histogram of disparities from {low:.1f} to {high:.1f} pixels, median {middle:.1f}"
    ticks = "".join(
        f'<span style="{_TICK}left:{100 * place:.2f}%;">{label}</span>'
        for place, label in _ticks(edges[0], edges[-1])
    )

    drawn = _image(picture, alt, size=(_SCALE_WIDTH, len(picture)))
    return f'{drawn}<div style="{_TICKS}">{ticks}</div>'


def _ticks(low: float, high: float) -> Iterable[tuple[float, str]]:
    """Yield round numbers, each with its place between the ends, 0 to 1."""
    locator = require("matplotlib.ticker", extra="plot").MaxNLocator(8, steps=(1, 2, 5, 10))
    for value in locator.tick_values(low, high):
        if low <= value <= high:
            yield (value - low) / (high - low), f"{value:.10g}"


def _thumbnails(pair: tuple[NDArray[Any], NDArray[Any]]) -> list[Picture]:
    """Return both images small, in colors that compare."""
    steps = [max(1, min(image.shape[:2]) // (4 * max(_THUMBNAIL))) for image in pair]
    pictures = viewable(*(image[::step, ::step] for image, step in zip(pair, steps, strict=True)))

    thumbnails = []
    for picture in pictures:
        image = require("PIL.Image", extra="plot").fromarray(picture)
        image.thumbnail(_THUMBNAIL)
        thumbnails.append(np.asarray(image))
    return thumbnails


def _shrunk(values: NDArray[Scalar], box: tuple[int, int]) -> NDArray[Scalar]:
    """Return every n-th pixel, so that all fit into a box: values are not mixed, nor NaN lost."""
    rows, cols = values.shape
    factor = max(1.0, cols / box[0], rows / box[1])

    y, x = (
        ((np.arange(max(1, round(size / factor))) + 0.5) * factor).astype(int).clip(max=size - 1)
        for size in (rows, cols)
    )
    return values[np.ix_(y, x)]


def _image(
    picture: Picture, alt: str, *, size: tuple[int, int] | None = None, photograph: bool = False
) -> str:
    """Return an element that holds a picture, enlarged by a whole factor if it is small."""
    rows, cols = picture.shape[:2]
    factor = max(1, _LEAST // max(rows, cols))
    width, height = size or (factor * cols, factor * rows)

    # Style sheets of pages would undo the attribute, and narrow ones the proportions.
    held = f"height:{height}px;" if size else "height:auto;"

    kind = "jpeg" if photograph else "png"
    encoded = io.BytesIO()
    options = {"quality": _PHOTOGRAPH_QUALITY} if photograph else {}
    image = require("PIL.Image", extra="plot").fromarray(np.ascontiguousarray(picture))
    image.save(encoded, kind, optimize=True, **options)
    data = base64.b64encode(encoded.getvalue()).decode()

    sharp = "" if photograph else "image-rendering:pixelated;"
    return (
        f'<img src="data:image/{kind};base64,{data}" alt="{escape(alt)}" width="{width}" '
        f'height="{height}" style="{_IMAGE}{held}{sharp}">'
    )


def _figure(content: str, caption: str) -> str:
    return (
        f'<figure style="{_FIGURE}">{content}'
        f'<figcaption style="{_CAPTION}">{escape(caption)}</figcaption></figure>'
    )

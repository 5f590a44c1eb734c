"""Results in notebooks: a self-contained block of HTML.

This module writes its text and keeps it small and readable anywhere: all text takes the colors of
the page, light or dark; all style is inline, because untrusted notebooks allow no other; and it
shrinks the map first. `phasestereo.views.plot` and the report page show the rest.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable
from html import escape
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo._tables import BLOCK
from phasestereo.result import Result, describe_flags
from phasestereo.views.picture import colorize, limits

Scalar = TypeVar("Scalar", bound=np.generic)

_MAP = 440, 330  # pixels, width and height: even without compression below 0.6 MB of text
_LEAST = 144  # pixels: smaller pictures are enlarged to this
_SAMPLES = 2**20  # disparities that represent the distribution of all

_FIGURE = "display:inline-block;vertical-align:top;margin:6px 14px 6px 0;max-width:100%;"
_IMAGE = "display:block;margin:0;max-width:100%;height:auto;image-rendering:pixelated;"
_CAPTION = "margin:3px 0 0;font-size:90%;"


def html(result: Result) -> str:
    """Return a result as HTML.

    Parameters
    ----------
    result
        The result.

    Returns
    -------
    str
        Less than 1 MB for any size of images: the map in color, and a description in words.
        Without matplotlib, the words, and how to install it.
    """
    try:
        picture = _map(result)
    except ImportError as error:
        picture = f"<div>No picture: {escape(str(error))}</div>"

    words = "".join(f"<div>{line}</div>" for line in _words(result))
    return f'<div style="{BLOCK}">{words}{picture}</div>'


def _words(result: Result) -> Iterable[str]:
    """Yield lines of HTML: size and verdict, missing pixels and their reasons, and flags."""
    rows, cols = result.disparity.shape
    missing = ~np.isfinite(result.disparity)
    share = float(missing.mean())
    estimated = f"{1 - share:.1%} estimated, {result.trusted.mean():.1%} trusted"

    blur = "" if result.blur is None else f"blur: {result.blur}"
    seconds = f"{sum(result.timings.values()):.3f} s"
    summary = filter(None, (result.verdict, f"{cols} x {rows} pixels", estimated, blur, seconds))
    yield f"<b>phasestereo.Result</b> {escape(', '.join(summary))}"

    yield from (f"<b>{one.severity}</b>: {escape(one.sentence)}" for one in result.findings)
    if share:
        yield f"No estimate, gray: {share:.1%}, flagged {describe_flags(result.flags * missing)}"
    yield f"All flags: {describe_flags(result.flags)}"

    if result.confidence is not None:
        yield f"Confidence: mean {result.confidence.mean():.2f}"
    if result.uncertainty is not None and np.isfinite(result.uncertainty).any():
        yield f"Error bars: median \N{PLUS-MINUS SIGN}{np.nanmedian(result.uncertainty):.2g} px"


def _map(result: Result) -> str:
    """Return the map as a figure; its caption is the scale of its colors."""
    known = result.disparity[np.isfinite(result.disparity)]
    low, high = limits(known[:: max(1, known.size // _SAMPLES)])

    rows, cols = result.disparity.shape
    shown, trusted = (_shrunk(values, _MAP) for values in (result.disparity, result.trusted))
    picture = colorize(shown, low=low, high=high, trusted=trusted)

    # Enlarge a small picture by a whole factor.
    factor = max(1, _LEAST // max(picture.shape[:2]))
    height, width = (factor * side for side in picture.shape[:2])
    encoded = io.BytesIO()
    require("PIL.Image", extra="plot").fromarray(picture).save(encoded, "png", optimize=True)
    data = base64.b64encode(encoded.getvalue()).decode()

    scale = f"blue is {low:.1f} pixels and less, red is {high:.1f} pixels and more"
    words = f"{scale}, gray has no estimate, hatched is not trusted"
    return (
        f'<figure style="{_FIGURE}"><img src="data:image/png;base64,{data}" '
        f'alt="Disparity map, {cols} by {rows} pixels: {words}" width="{width}" '
        f'height="{height}" style="{_IMAGE}"><figcaption style="{_CAPTION}">Disparity: {words}'
        "</figcaption></figure>"
    )


def _shrunk(values: NDArray[Scalar], box: tuple[int, int]) -> NDArray[Scalar]:
    """Return every n-th pixel, to fit into a box: this mixes no values and loses no NaN."""
    rows, cols = values.shape
    factor = max(1.0, cols / box[0], rows / box[1])

    y, x = (
        ((np.arange(max(1, round(size / factor))) + 0.5) * factor).astype(int).clip(max=size - 1)
        for size in (rows, cols)
    )
    return values[np.ix_(y, x)]

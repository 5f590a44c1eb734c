"""Pictures for the pages: what examples that run while the documentation is built show.

An example marked ``exec`` prints Markdown or HTML, and the page shows that below it. Here is what
turns arrays into pictures, and pictures into HTML.
"""

from __future__ import annotations

import base64
import io
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

import phasestereo as ps

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike, NDArray

    from phasestereo import BlurEstimate, Result

    Picture = NDArray[np.uint8]

COLOURS = {
    "none": (245, 245, 245),
    "gaussian": (230, 171, 2),
    "disk": (214, 96, 77),
    "motion": (67, 147, 195),
    "other": (120, 94, 240),
}
"""Colours of the kinds of blur."""

FLAGS = {
    ps.Flag.SPECKLE: (230, 171, 2),
    ps.Flag.OUTSIDE: (120, 120, 120),
    ps.Flag.OCCLUDED: (67, 147, 195),
    ps.Flag.MISMATCHED: (214, 96, 77),
}
"""Colours of flags."""

QUALITY = 88  # of 100; with colours at full resolution, so that maps keep their edges


def row(pictures: Mapping[str, Picture]) -> str:
    """Return pictures, uint8 gray or RGB, side by side, each above its caption, as HTML."""
    figures = "".join(
        f'<figure><img alt="{escape(caption)}" src="{_uri(picture)}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
        for caption, picture in pictures.items()
    )
    return f'<div class="pictures">{figures}</div>'


def gray(values: ArrayLike, low: float = 0.0, high: float = 1.0) -> Picture:
    """Return a map as gray levels: low is black, high is white, NaN is black."""
    share = (np.asarray(values, np.float64) - low) / (high - low)
    return (255 * np.clip(np.nan_to_num(share), 0, 1)).astype(np.uint8)


def blurs(estimate: BlurEstimate) -> Picture:
    """Return the map of an estimate: white where there is no blur, else the colour of its kind."""
    colours = np.array([COLOURS[blur.kind] for blur in estimate.blurs], np.uint8)
    side = estimate.tile
    return colours[estimate.labels].repeat(side, 0).repeat(side, 1)


def flags(result: Result) -> Picture:
    """Return the flags of a result: the first of `FLAGS` that a pixel has gives its colour."""
    picture = np.full((*result.flags.shape, 3), 245, np.uint8)
    for flag, colour in reversed(FLAGS.items()):
        picture[(result.flags & flag) != 0] = colour
    return picture


def relief(disparity: NDArray[np.float32]) -> Picture:
    """Return a disparity map as a surface that is lit from the left."""
    slope = np.gradient(np.asarray(disparity, np.float64), axis=1)
    return gray(np.tanh(2 * slope), -1, 1)


def _uri(picture: Picture) -> str:
    """Return a picture as a URI that holds all of it."""
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "JPEG", quality=QUALITY, subsampling=0)
    return f"data:image/jpeg;base64,{base64.b64encode(file.getvalue()).decode()}"

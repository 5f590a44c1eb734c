"""Pictures for the pages: what examples that run while the documentation is built show.

An example marked ``exec`` prints Markdown or HTML, and the page shows that below it. Here is what
turns arrays into pictures, and pictures into HTML.
"""

from __future__ import annotations

import base64
import io
from functools import cache
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

import phasestereo as ps
from phasestereo.views.page import write_pair_page
from phasestereo.views.picture import colorize, error_picture
from phasestereo_bench.demo import ROBUST, SGBM, Demo, run_demo

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike, NDArray

    from phasestereo import PointCloud
    from phasestereo_bench.datasets import Pair

    Picture = NDArray[np.uint8]

QUALITY = 88  # of 100; with colors at full resolution, so that maps keep their edges
_SEVERAL = 200  # pixels
_SHARP = 200  # dots per inch: screens of two dots a pixel show them all


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


def seen(cloud: PointCloud, degrees: float, *, focal: float, size: tuple[int, int]) -> Picture:
    """Return a colored cloud as a camera sees it that has gone round its middle."""
    turn, (rows, cols) = np.radians(degrees), size
    picture = np.full((rows, cols, 3), 24, np.uint8)
    if cloud.colors is None:
        return picture
    distance = float(np.median(cloud.points[:, 2]))
    x, y, z = (cloud.points - np.array([0, 0, distance], np.float32)).T
    x, z = x * np.cos(turn) - z * np.sin(turn), x * np.sin(turn) + z * np.cos(turn)
    z = np.maximum(z + 1.25 * distance, 0.1 * distance)
    column, row = (np.rint(c * focal / z + n / 2).astype(int) for c, n in ((x, cols), (y, rows)))
    order = np.argsort(-z)  # the nearest comes last, over all others
    for down, right in ((0, 0), (0, 1), (1, 0), (1, 1)):  # a point is 2 x 2 pixels
        i, j = row[order] + down, column[order] + right
        inside = (i >= 0) & (i < rows) & (j >= 0) & (j < cols)
        picture[i[inside], j[inside]] = cloud.colors[order][inside]
    return picture


@cache
def demo() -> Demo:
    """Return the demo that ``phasestereo demo`` shows."""
    return run_demo()


def rivals() -> str:
    """Return the maps of the demo's degraded pair by this package and by StereoSGBM, as HTML."""
    pair = demo().pair
    low, high = float(pair.truth.min()), float(pair.truth.max())
    maps = {"left: out of focus, dim, noisy": demo().degraded}
    errors = {"right": pair.right}
    for outcome in demo().outcomes:
        if outcome.method in (ROBUST, SGBM):
            name = "robust" if outcome.method is ROBUST else "StereoSGBM"
            found = outcome.degraded.disparity
            maps[f"{name}: {outcome.degraded.bad:.1f} % wrong"] = colorize(
                found, low=low, high=high
            )
            wrong = error_picture(found, pair.truth, pair.masks["nonocc"])
            errors[f"errors of {name}; white is right"] = wrong
    return row(maps | errors)


def live_page() -> str:
    """Return the report page of the demo's degraded pair."""
    pair, left = demo().pair, demo().degraded
    result = ps.match(left, pair.right, num_disparities=pair.num_disparities)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "pair.html"
        write_pair_page(
            path,
            left,
            pair.right,
            result,
            truth=pair.truth,
            mask=pair.masks["nonocc"],
            calibration=pair.calibration,
            title="A pair whose left image is out of focus",
        )
        return path.read_text(encoding="utf-8")


def drawn(figure: Figure) -> Picture:
    """Return a figure of matplotlib as a picture."""
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=_SHARP)
    return np.asarray(Image.open(file).convert("RGB"))


def reliability(matches: Sequence[tuple[ps.Result, Pair]]) -> Figure:
    """Return diagrams of what confidences and error bars of matches promise, and what they keep."""
    from matplotlib.figure import Figure  # noqa: PLC0415  # slow to import, and most pages do without

    promised, bars, errors = [], [], []
    for result, pair in matches:
        seen = pair.masks["nonocc"] & np.isfinite(result.disparity)
        promised.append(result.confidence[seen])
        bars.append(result.uncertainty[seen])
        errors.append(np.abs(result.disparity - pair.truth)[seen])
    confidence, bar, error = (np.concatenate(one) for one in (promised, bars, errors))

    figure = Figure(figsize=(8, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)

    tenth = np.minimum((10 * confidence).astype(int), 9)
    counts = np.bincount(tenth, minlength=10)
    many = counts >= _SEVERAL  # shares of a few pixels say nothing
    mean = np.bincount(tenth, confidence, 10)[many] / counts[many]
    share = np.bincount(tenth, error <= 1, 10)[many] / counts[many]
    left.plot([0, 1], [0, 1], color="0.7")
    left.plot(mean, share, "o-")
    left.set(xlabel="confidence", ylabel="share within 1 px", xlim=(0, 1), ylim=(0, 1))

    order = np.argsort(bar)
    tenths = np.array_split(order, 10)
    middle = [float(np.median(bar[one])) for one in tenths]
    right.axhline(0.9, color="0.7")
    right.plot(middle, [float((error[one] <= bar[one]).mean()) for one in tenths], "o-")
    right.set(xlabel="error bar, px", ylabel="share within the bar", xscale="log", ylim=(0, 1))
    return figure


def _uri(picture: Picture) -> str:
    """Return a picture as a URI that holds all of it."""
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "JPEG", quality=QUALITY, subsampling=0)
    return f"data:image/jpeg;base64,{base64.b64encode(file.getvalue()).decode()}"

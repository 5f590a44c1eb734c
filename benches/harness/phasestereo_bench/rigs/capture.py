"""Changes images as cameras and videos do, by OpenCV's and FFmpeg's own code.

Functions work like those of `sensor`. All of them work on colors; a gray image becomes three equal
channels, and gray again afterward.
"""

import io
from collections.abc import Callable
from functools import wraps
from typing import Any

import numpy as np

from phasestereo._extras import require
from phasestereo_bench.arrays import Image
from phasestereo_bench.degradation import quantize

INFRARED = (0.9, 0.6, -0.5)
"""Approximate shares of red, green and blue in the image of a camera without its filter."""


def in_color(spoiler: Callable[..., Any]) -> Callable[..., Image]:
    """Let a function of colors take gray images, too, and round its result."""

    @wraps(spoiler)
    def spoil(image: Image, seed: int, **options: Any) -> Image:
        colors = image if image.ndim == 3 else np.dstack([image] * 3)
        spoiled = quantize(np.asarray(spoiler(colors, seed, **options), np.float64), np.uint8)
        return spoiled if image.ndim == 3 else spoiled[..., 1].copy()

    return spoil


def opencv() -> Any:
    """Return the module cv2."""
    return require("cv2", extra="opencv")


@in_color
def video(image: Image, _seed: int, *, codec: str, crf: int) -> Any:
    """Write a video of this one frame at a constant rate factor, 4:2:0, and read it again."""
    import av  # noqa: PLC0415  # slow to import, and most of the harness does without

    rows, cols = image.shape[:2]
    even = np.pad(image, ((0, rows % 2), (0, cols % 2), (0, 0)), mode="edge")
    file = io.BytesIO()

    with av.open(file, "w", format="matroska") as written:
        options = {"crf": str(crf), "threads": "1", "x265-params": "log-level=none:pools=none"}
        stream: Any = written.add_stream(codec, rate=30, options=options)
        stream.height, stream.width, stream.pix_fmt = *even.shape[:2], "yuv420p"
        frame = av.VideoFrame.from_ndarray(even, "rgb24")
        for packet in (*stream.encode(frame), *stream.encode()):
            packet.pts = packet.dts = 0  # x265 sometimes sets one of them wrong
            written.mux(packet)

    file.seek(0)
    with av.open(file, "r") as read:
        return next(read.decode(video=0)).to_ndarray(format="rgb24")[:rows, :cols]


@in_color
def denoised(image: Image, _seed: int, *, strength: float) -> Any:
    """Denoise by OpenCV's non-local means with its default sizes of blocks and searches."""
    return opencv().fastNlMeansDenoisingColored(image, None, strength, strength)


@in_color
def bayer(image: Image, seed: int, *, sigma: float) -> Any:
    """Sample one color per pixel, red in the first, add noise, and interpolate the others."""
    mosaic = image[..., 1].astype(np.float64)
    mosaic[::2, ::2], mosaic[1::2, 1::2] = image[::2, ::2, 0], image[1::2, 1::2, 2]
    mosaic += np.random.default_rng(seed).normal(0, sigma, mosaic.shape)
    return opencv().cvtColor(quantize(mosaic, np.uint8), opencv().COLOR_BayerRGGB2RGB)


@in_color
def chroma_noise(image: Image, seed: int, *, sigma: float) -> Any:
    """Add noise to the differences of colors, at half the resolution, and none to brightness."""
    rows, cols = image.shape[:2]
    grain = np.random.default_rng(seed).normal(0, sigma, (-(-rows // 2), -(-cols // 2), 2))
    colors = opencv().cvtColor(image, opencv().COLOR_RGB2YCrCb).astype(np.float64)
    colors[..., 1:] += grain.repeat(2, axis=0).repeat(2, axis=1)[:rows, :cols]
    return opencv().cvtColor(quantize(colors, np.uint8), opencv().COLOR_YCrCb2RGB)


@in_color
def band(image: Image, _seed: int, *, shares: tuple[float, float, float]) -> Any:
    """Convert to gray: sum these shares of red, green and blue."""
    gray = image @ np.array(shares)
    return np.dstack([np.clip(gray, 0, 255)] * 3)


@in_color
def small(image: Image, _seed: int, *, part: int) -> Any:
    """Lower the resolution by a factor: average areas, then enlarge with cubics."""
    rows, cols = image.shape[:2]
    lower = opencv().resize(image, (cols // part, rows // part), interpolation=opencv().INTER_AREA)
    return opencv().resize(lower, (cols, rows), interpolation=opencv().INTER_CUBIC)


def pale(image: Image, _seed: int, *, share: float, middle: float | None = 127.5) -> Image:
    """Keep this share of the contrast around a gray level; None: each channel's mean."""
    around = image.mean(axis=(0, 1)) if middle is None else middle
    return quantize(around + share * (image.astype(np.float64) - around), np.uint8)

"""Applies effects of lenses, and of matter on or before them: blur, dirt, rain, haze, vignetting.

Functions work like those of `sensor`. Coordinates are pixels, x to the right and y down, and the
center of the first pixel is (0, 0).
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from phasestereo_bench.arrays import Image, Plane
from phasestereo_bench.degradation import convolve, disk_psf, quantize
from phasestereo_bench.rigs.sensor import noise

BLURRED_NOISE = 1.0  # gray levels of noise after a blur, as in the suite "one-sided-blur"
DROP_BLUR = 7.0  # px: radius of the disk through which a drop of rain shows the scene
DIRT, HAZE = 40.0, 235.0  # gray levels
VIGNETTE = 0.7  # share of the light lost in the corners


def blurred(image: Image, seed: int, *, psf: Plane) -> Image:
    """Convolve and round, then add noise of 1 gray level."""
    return noise(quantize(convolve(image, psf), np.uint8), seed, sigma=BLURRED_NOISE)


def vignette(image: Image, _seed: int) -> Image:
    """Darken toward the corners: multiply by 1 - 0.7 r^2, with r = 1 there and 0 in the middle."""
    rows, cols = image.shape[:2]
    y, x = np.mgrid[0:rows, 0:cols]
    square = ((x - cols / 2) ** 2 + (y - rows / 2) ** 2) / ((cols / 2) ** 2 + (rows / 2) ** 2)
    return quantize(image * _like(1 - VIGNETTE * square, image), np.uint8)


def dirt(image: Image, seed: int) -> Image:
    """Put 12 dark spots of about 14 px on the lens, each with another gray."""
    return _spotted(
        image, seed, _drop, lambda rng: DIRT + rng.uniform(-15, 15), count=12, radius=14.0
    )


def rain(image: Image, seed: int) -> Image:
    """Put 40 drops of about 18 px on the lens; each shows the scene out of focus."""
    behind = convolve(image, disk_psf(DROP_BLUR))
    return _spotted(image, seed, _drop, lambda _: behind, count=40, radius=18.0)


def haze(image: Image, seed: int) -> Image:
    """Lay three bright clouds of about 120 px over the image, like stray light or breath."""
    return _spotted(
        image,
        seed,
        lambda away: 0.75 * np.exp(-(away**2)),
        lambda _: HAZE,
        count=3,
        radius=120.0,
    )


def _drop(away: Plane) -> Plane:
    return np.clip(1.5 - away, 0, 1)


def _spotted(
    image: Image,
    seed: int,
    cover: Callable[[Plane], Plane],
    color: Callable[[np.random.Generator], Any],
    *,
    count: int,
    radius: float,
) -> Image:
    """Cover an image with spots of a color; `cover` takes the distance to a center in radii."""
    rng = np.random.default_rng(seed)
    spoiled = image.astype(np.float64)
    rows, cols = image.shape[:2]
    y, x = np.mgrid[0:rows, 0:cols]
    for _ in range(count):
        center_x, center_y = rng.uniform(0, cols), rng.uniform(0, rows)
        away = np.hypot(x - center_x, y - center_y) / (radius * rng.uniform(0.6, 1.4))
        spoiled += _like(cover(away), image) * (color(rng) - spoiled)
    return quantize(spoiled, np.uint8)


def _like(plane: Plane, image: Image) -> Plane:
    """Return a plane that multiplies with all channels of an image."""
    return plane if image.ndim == 2 else plane[:, :, np.newaxis]

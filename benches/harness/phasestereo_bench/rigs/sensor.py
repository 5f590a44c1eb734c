"""Applies effects of sensors, wires and codecs: noise, few levels, dead pixels, JPEG.

Every function takes a uint8 image (H, W) or (H, W, C) and a seed for ``numpy.random.default_rng``,
and returns a new image of the same shape and type. Functions compute in double precision, then
round to the nearest level (ties to even) and clip.
"""

import io
from typing import Any

import numpy as np
import PIL.Image
from numpy.typing import NDArray

from phasestereo_bench.arrays import Image
from phasestereo_bench.degradation import quantize

READ_NOISE = 2.0  # gray levels: a sensor adds this noise to any number of photons
COLUMN_STEP = 40  # px from one dead column to the next; the first is at half of it


def noise(image: NDArray[Any], seed: int, *, sigma: float) -> Image:
    """Add Gaussian noise in gray levels, independent for every pixel and channel."""
    grain = np.random.default_rng(seed).normal(0.0, sigma, image.shape)
    return quantize(image + grain, np.uint8)


def photons(image: Image, seed: int, *, white: float, reading: float = READ_NOISE) -> Image:
    """Count photons, `white` of them at level 255, and add the noise of reading them out."""
    rng = np.random.default_rng(seed)
    counted = rng.poisson(image / 255 * white) * (255 / white)
    return quantize(counted + rng.normal(0.0, reading, image.shape), np.uint8)


def bits(image: Image, _seed: int, *, count: int) -> Image:
    """Keep `count` of eight bits; each level becomes the middle of the levels that share them."""
    step = 2 ** (8 - count)
    return quantize(image // step * step + (step - 1) / 2, np.uint8)


def hot(image: Image, seed: int, *, share: float) -> Image:
    """Turn this share of the pixels black or white in all channels, equally often."""
    rng = np.random.default_rng(seed)
    broken = rng.random(image.shape[:2]) < share
    levels = rng.choice(np.array([0, 255], np.uint8), (np.count_nonzero(broken), 1))

    spoiled = image.copy()
    spoiled[broken] = levels if image.ndim == 3 else levels[:, 0]
    return spoiled


def dead_columns(image: Image, seed: int) -> Image:
    """Turn every 40th column all black or all white."""
    rng = np.random.default_rng(seed)
    spoiled = image.copy()
    for column in range(COLUMN_STEP // 2, image.shape[1], COLUMN_STEP):
        spoiled[:, column] = rng.choice(np.array([0, 255], np.uint8))
    return spoiled


def jpeg(image: Image, _seed: int, *, quality: int) -> Image:
    """Write and read a JPEG file of this quality with Pillow: colors have half the resolution."""
    file = io.BytesIO()
    PIL.Image.fromarray(image).save(file, "JPEG", quality=quality)
    return np.array(PIL.Image.open(file))


def clipped(image: Image, _seed: int, *, share: float) -> Image:
    """Expose longer, until this share of all levels is at or above white."""
    white = float(np.quantile(image, 1 - share))
    return quantize(image.astype(np.float64) * (255 / max(white, 1.0)), np.uint8)


def inverted(image: Image, _seed: int) -> Image:
    """Turn bright into dark, as another spectral band may."""
    return 255 - image


def scaled(image: Image, _seed: int, *, gain: float = 1.0, gamma: float = 1.0) -> Image:
    """Change exposure and tone curve: 255 gain (I / 255)^gamma."""
    return quantize(255 * gain * (image / 255) ** gamma, np.uint8)

"""Applies seventeen of RobustSpring's twenty corruptions (arXiv 2505.09368) to stereo pairs.

RobustSpring follows ImageNet-C (Hendrycks and Dietterich, ICLR 2019). The formulas here do, too,
with the numbers of its first severity of five, for images from 0 to 1. Each image has its own
noise; all else is the same in both. Frost, rain and snow are left out: frost needs photographs, and
rain and snow need drops and flakes in space.
"""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy import ndimage

from phasestereo_bench.arrays import Image, Plane
from phasestereo_bench.datasets import Pair
from phasestereo_bench.degradation import convolve, disk_psf, gaussian_psf, quantize
from phasestereo_bench.rigs.capture import in_color, opencv, pale
from phasestereo_bench.rigs.depth import filled, seen_from_right
from phasestereo_bench.rigs.fault import Both, Step
from phasestereo_bench.rigs.geometry import Bent
from phasestereo_bench.rigs.sensor import jpeg, noise, photons

WATER = np.array([175, 238, 238])  # pale turquoise
FOG, HAZINESS = 230.0, 1.0  # gray level; exponent of the farthest
ANGLE = 30.0  # degrees, of a motion


def multiplied(image: Image, seed: int, *, sigma: float) -> Image:
    """Multiply by 1 plus noise: speckle."""
    grain = np.random.default_rng(seed).normal(1, sigma, image.shape)
    return quantize(grain * image.astype(np.float64), np.uint8)


def impulses(image: Image, seed: int, *, share: float) -> Image:
    """Turn this share of all values black or white."""
    drawn = np.random.default_rng(seed).random(image.shape)
    return np.where(drawn < share, np.uint8(255) * (drawn < share / 2), image).astype(np.uint8)


def through(image: Image, _seed: int, *, psf: Plane) -> Image:
    """Convolve the image with a kernel."""
    return quantize(convolve(image, psf), np.uint8)


def glass(image: Image, seed: int, *, sigma: float, reach: int, rounds: int) -> Image:
    """Blur, swap every pixel with one nearby several times, and blur again."""
    rng = np.random.default_rng(seed)
    shuffled = through(image, seed, psf=gaussian_psf(sigma))
    at = np.indices(image.shape[:2])
    last = np.array(image.shape[:2]).reshape(2, 1, 1) - 1

    for _ in range(rounds):
        y, x = np.clip(at + rng.integers(-reach, reach, at.shape), 0, last)
        shuffled = shuffled[y, x]
    return through(shuffled, seed, psf=gaussian_psf(sigma))


def trail_psf(radius: int, sigma: float) -> Plane:
    """Return the point-spread function of a motion that fades: half of a Gaussian along a line."""
    psf = np.zeros((2 * radius + 1, 2 * radius + 1))
    along = np.linspace(0, radius, 16 * radius + 1)
    y, x = (np.rint(along * f(np.deg2rad(ANGLE))).astype(int) for f in (np.sin, np.cos))
    np.add.at(psf, (radius + y, radius + x), np.exp(-0.5 * (along / sigma) ** 2))
    return np.asarray(psf / psf.sum())


def zoomed(image: Image, _seed: int, *, factors: Plane) -> Image:
    """Zoom while the shutter is open."""
    rows, cols = image.shape[:2]
    middle = ((cols - 1) / 2, (rows - 1) / 2)
    turns = [opencv().getRotationMatrix2D(middle, 0, factor) for factor in (1.0, *factors)]
    views = [opencv().warpAffine(image.astype(np.float32), turn, (cols, rows)) for turn in turns]
    return quantize(np.mean(views, axis=0, dtype=np.float64), np.uint8)


@in_color
def colored(image: Image, _seed: int, *, saturation: float = 1.0, brighter: float = 0.0) -> Any:
    """Change saturation and value of each color."""
    hsv = opencv().cvtColor((image / 255).astype(np.float32), opencv().COLOR_RGB2HSV)
    hsv[..., 1:] = np.clip(hsv[..., 1:] * (saturation, 1) + (0, brighter), 0, 1)
    return 255.0 * opencv().cvtColor(hsv, opencv().COLOR_HSV2RGB)


def pixelated(image: Image, _seed: int, *, share: float) -> Image:
    """Reduce to fewer pixels, each the mean of an area, and show them as squares."""
    rows, cols = image.shape[:2]
    few, cv2 = (int(cols * share), int(rows * share)), opencv()
    areas = cv2.resize(image, few, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(areas, (cols, rows), interpolation=cv2.INTER_NEAREST), np.uint8)


@in_color
def spattered(image: Image, seed: int) -> Any:
    """Put water on the lens: a rare level of smooth noise, lit along its rim."""
    cv2 = opencv()
    drops = np.random.default_rng(seed).normal(0.65, 0.3, image.shape[:2])
    drops = ndimage.gaussian_filter(drops, 4, mode="nearest")
    water = quantize(255 * np.where(drops < 0.69, 0, drops), np.uint8)

    rim = cv2.distanceTransform(255 - cv2.Canny(water, 50, 150), cv2.DIST_L2, 5)
    rim = cv2.equalizeHist(cv2.blur(np.minimum(rim, 20), (3, 3)).astype(np.uint8))
    rim = cv2.filter2D(rim, cv2.CV_8U, np.array([[-2, -1, 0], [-1, 1, 1], [0, 1, 2]]))
    cover = water * cv2.blur(rim, (3, 3)).astype(np.float64)
    return image + 0.6 * (cover / max(cover.max(), 1))[..., np.newaxis] * WATER


def waves(rows: int, cols: int) -> tuple[Plane, Plane]:
    """Return the offsets of an elastic image, px, along x and y: smooth noise."""
    rng = np.random.default_rng(0)
    off = [
        ndimage.gaussian_filter(rng.uniform(-1, 1, (rows, cols)), 2.44, truncate=3) for _ in "xy"
    ]
    return 12.2 * off[0], 12.2 * off[1]


def fog(pair: Pair, _side: str) -> Pair:
    """Fade far things into fog; without a truth everything is equally far."""
    near = np.ones(pair.left.shape[:2]) if pair.truth is None else filled(pair.truth)
    seen = near if pair.truth is None else filled(seen_from_right(pair.truth))
    farthest = max(float(np.percentile(near, 2)), 1.0)

    views = []
    for image, disparity in ((pair.left, near), (pair.right, seen)):
        light = np.exp(-HAZINESS * farthest / np.maximum(disparity, farthest))
        light = light.reshape(light.shape + (1,) * (image.ndim - 2))
        views.append(quantize(FOG + light * (image - FOG), np.uint8))
    return replace(pair, left=views[0], right=views[1])


CORRUPTIONS: dict[str, tuple[Step, ...]] = {
    "brightness": (Both(partial(colored, brighter=0.1)),),
    "contrast": (Both(partial(pale, share=0.4, middle=None)),),
    "saturate": (Both(partial(colored, saturation=0.3)),),
    "defocus blur": (Both(partial(through, psf=disk_psf(3))),),
    "gaussian blur": (Both(partial(through, psf=gaussian_psf(1))),),
    "glass blur": (Both(partial(glass, sigma=0.7, reach=1, rounds=2)),),
    "motion blur": (Both(partial(through, psf=trail_psf(20, 3))),),
    "zoom blur": (Both(partial(zoomed, factors=np.arange(1, 1.105, 0.01))),),
    "gaussian noise": (Both(partial(noise, sigma=0.08 * 255)),),
    "impulse noise": (Both(partial(impulses, share=0.03)),),
    "speckle noise": (Both(partial(multiplied, sigma=0.15)),),
    "shot noise": (Both(partial(photons, white=60, reading=0)),),
    "pixelate": (Both(partial(pixelated, share=0.6)),),
    "jpeg": (Both(partial(jpeg, quality=25)),),
    "elastic": (Bent(waves),),
    "spatter": (Both(spattered),),
    "fog": (fog,),
}
"""The corruptions by RobustSpring's names."""

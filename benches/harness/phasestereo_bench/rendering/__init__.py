"""Rendered pairs: a seeded scene, ray-cast from two cameras, with exact disparities and masks.

Both views are cast from the same continuous surfaces and textures, several rays a pixel; neither
image is warped from the other. The parts in the order of the data: `camera` casts rays at `shapes`
(`casting`); `scenery` arranges `things`, made of shapes and `textures`; `light` turns what the rays
meet into photographs.
"""

from __future__ import annotations

from dataclasses import replace
from numbers import Integral

import numpy as np

from phasestereo.io import Calibration
from phasestereo_bench.datasets import Pair
from phasestereo_bench.rendering.camera import LEFT, RIGHT, Camera
from phasestereo_bench.rendering.casting import disparities, near_jumps, visible_in_both
from phasestereo_bench.rendering.light import exposure_of, photograph
from phasestereo_bench.rendering.scenery import furnish

__all__ = ["render_pair"]

MIN_SIDE, MAX_SIDE = 16, 8192
MIN_DISPARITIES = 8


def render_pair(
    seed: int = 0, *, height: int = 360, width: int = 480, num_disparities: int = 64
) -> Pair:
    """Render a stereo pair of a random scene, with its truth.

    Parameters
    ----------
    seed
        Of the scene and the noise, an integer >= 0. A seed arranges the same things at any size;
        the same seed and size give the same bits.
    height, width
        Size of both images in pixels, 16 to 8192.
    num_disparities
        All disparities are in (0, num_disparities - 2]; from 8 to half the width.

    Returns
    -------
    Pair
        uint8 RGB images with Gaussian noise of 1 gray level; the truth at the pixel centers of
        either view; the calibration, with depths in mm; masks ``nonocc`` (the surface point at the
        left pixel's center is the front-most in the right view too, and inside it), ``all`` (every
        pixel) and ``disc`` (those of ``nonocc`` within 4 px of a jump of more than 2 px).

    Raises
    ------
    TypeError, ValueError
        If an argument is not an integer, or out of range.
    """
    seed = _integer("seed", seed, low=0)
    height = _integer("height", height, low=MIN_SIDE, high=MAX_SIDE)
    width = _integer("width", width, low=MIN_SIDE, high=MAX_SIDE)
    count = _integer("num_disparities", num_disparities, low=MIN_DISPARITIES, high=width // 2)

    # The scene and the noise of either view have generators of their own.
    scene_seed, left_seed, right_seed = np.random.SeedSequence(seed).spawn(3)
    camera = Camera(height=height, width=width)
    scene = furnish(np.random.default_rng(scene_seed), camera)
    # The baseline follows from the nearest thing, which has the largest disparity.
    camera = replace(camera, near=scene.near, near_disparity=count - 2.0)
    exposure = exposure_of(scene, camera)

    truth = disparities(scene.shapes, camera, LEFT)
    nonocc = visible_in_both(scene.shapes, camera, truth)

    return Pair(
        name=f"rendered-{seed}",
        left=photograph(scene, camera, LEFT, exposure, np.random.default_rng(left_seed)),
        right=photograph(scene, camera, RIGHT, exposure, np.random.default_rng(right_seed)),
        truth=truth.astype(np.float32),
        truth_right=disparities(scene.shapes, camera, RIGHT).astype(np.float32),
        masks={
            "nonocc": nonocc,
            "all": np.ones_like(nonocc),
            "disc": nonocc & near_jumps(truth),
        },
        num_disparities=count,
        calibration=_calibration(camera, count),
    )


def _calibration(camera: Camera, num_disparities: int) -> Calibration:
    """Take the world unit for a metre: the baseline is in mm, as in Middlebury's files."""
    cx, cy = (camera.width - 1) / 2, (camera.height - 1) / 2
    intrinsics = ((camera.focal, 0.0, cx), (0.0, camera.focal, cy), (0.0, 0.0, 1.0))
    return Calibration(
        cam0=intrinsics,
        cam1=intrinsics,
        doffs=0.0,
        baseline=1000 * camera.focal_baseline / camera.focal,
        width=camera.width,
        height=camera.height,
        ndisp=num_disparities,
    )


def _integer(name: str, value: object, *, low: int, high: int | None = None) -> int:
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"{name} must be an integer, got {type(value).__name__}")
    number = int(value)
    if number < low or (high is not None and number > high):
        upper = "" if high is None else f" and <= {high}"
        raise ValueError(f"{name} must be >= {low}{upper}, got {number}")
    return number

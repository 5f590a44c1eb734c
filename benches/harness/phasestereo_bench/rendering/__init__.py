"""Renders pairs: ray-casts a seeded scene from two cameras, with exact disparities and masks.

Both views are cast from the same continuous surfaces and textures, with several rays a pixel;
neither image is warped from the other. The parts, in the order of the data: `camera` casts rays at
`shapes` (`casting`); `scenery` arranges `things`, made of shapes and `textures`; `light` turns the
surfaces that rays meet into photographs.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import ceil

import numpy as np

from phasestereo._numbers import as_integer, as_number
from phasestereo.io import Calibration
from phasestereo_bench.cases import require_known
from phasestereo_bench.datasets import Pair
from phasestereo_bench.rendering.camera import LEFT, RIGHT, Camera
from phasestereo_bench.rendering.casting import disparities, near_jumps, seen, visible_in_both
from phasestereo_bench.rendering.light import (
    MIDDLE_GRAY,
    SENSOR_NOISE,
    Scenery,
    exposure_of,
    photograph,
)
from phasestereo_bench.rendering.rooms import ROOMS, RoomKind, furnish_room
from phasestereo_bench.rendering.scenery import furnish
from phasestereo_bench.rendering.shapes import Patch

__all__ = ["ROOMS", "RoomKind", "render_pair", "render_room"]

MIN_SIDE, MAX_SIDE = 16, 8192
MIN_DISPARITIES = 8
MAX_NOISE = 64.0
ROOM_GRAY = 0.6  # of white: rooms are lighter than gardens
THUMBNAIL = 320  # px: the longer side of the grid that searches a room's nearest point


def render_pair(
    seed: int = 0, *, height: int = 360, width: int = 480, num_disparities: int = 64
) -> Pair:
    """Render a stereo pair of a random scene, with its truth.

    Parameters
    ----------
    seed
        Seed of the scene and the noise, an integer >= 0. A seed arranges the same things at any
        size; the same seed and size give the same bits.
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
    seed = as_integer("seed", seed, least=0)
    height = as_integer("height", height, least=MIN_SIDE, most=MAX_SIDE)
    width = as_integer("width", width, least=MIN_SIDE, most=MAX_SIDE)
    count = as_integer("num_disparities", num_disparities, least=MIN_DISPARITIES, most=width // 2)

    # The scene and the noise of either view have their own generators.
    scene_seed, *noise_seeds = np.random.SeedSequence(seed).spawn(3)
    camera = Camera(height=height, width=width)
    scene = furnish(np.random.default_rng(scene_seed), camera)
    # The baseline follows from the nearest thing, which has the largest disparity.
    camera = replace(camera, near=scene.near, near_disparity=count - 2.0)

    pair = _taken(scene, camera, f"rendered-{seed}", noise_seeds)
    return replace(pair, num_disparities=count, calibration=_calibration(camera, count))


def render_room(
    seed: int = 0,
    kind: RoomKind = "room",
    *,
    height: int = 600,
    width: int = 800,
    noise: float = 1.5,
) -> Pair:
    """Render a stereo pair of a room with plain walls, tables and things, with its truth.

    Parameters
    ----------
    seed
        Seed of the room and the noise, an integer >= 0. Images of the same proportions sample the
        same room, and disparities keep their share of the width.
    kind
        One of `ROOMS`.
    height, width
        Size of both images in pixels, 16 to 8192.
    noise
        Standard deviation of the Gaussian noise of a pixel, gray levels, >= 0.

    Returns
    -------
    Pair
        A pair like that of `render_pair`, with another mask: ``curved`` (those of ``nonocc`` on
        things that are not flat). `Pair.num_disparities` holds all disparities; the largest is 8 to
        22 % of the width.

    Raises
    ------
    TypeError, ValueError
        If an argument has the wrong type, or is out of range.
    """
    seed = as_integer("seed", seed, least=0)
    require_known("kind", [kind], ROOMS)
    height = as_integer("height", height, least=MIN_SIDE, most=MAX_SIDE)
    width = as_integer("width", width, least=MIN_SIDE, most=MAX_SIDE)
    grain = as_number("noise", noise, least=0, most=MAX_NOISE)

    scene_seed, *noise_seeds = np.random.SeedSequence([seed, ROOMS.index(kind)]).spawn(3)
    room = furnish_room(np.random.default_rng(scene_seed), kind)
    camera = Camera(height=height, width=width, eye=room.eye, pitch=room.pitch)
    camera = replace(
        camera, near=_nearest(room.scenery, camera), near_disparity=room.reach * camera.width
    )

    name = f"{kind}-{seed}"
    pair = _taken(room.scenery, camera, name, noise_seeds, noise=grain, gray=ROOM_GRAY)
    curved = [not isinstance(shape, Patch) for shape in room.scenery.shapes]
    on_curved = np.array(curved)[seen(room.scenery.shapes, camera, LEFT)[1]]

    largest = max(float(np.asarray(truth).max()) for truth in (pair.truth, pair.truth_right))
    count = 16 * ceil((largest + 2) / 16)
    return replace(
        pair,
        masks={**pair.masks, "curved": pair.masks["nonocc"] & on_curved},
        num_disparities=count,
        calibration=_calibration(camera, count),
    )


def _nearest(scene: Scenery, camera: Camera) -> float:
    """Find the least depth that the left view sees, on a grid that is the same for all sizes."""
    thumbnail = replace(camera.shrunk(THUMBNAIL), near=1.0, near_disparity=1.0)
    return 1 / float(disparities(scene.shapes, thumbnail, LEFT).max())


def _taken(
    scene: Scenery,
    camera: Camera,
    name: str,
    noise_seeds: Sequence[np.random.SeedSequence],
    *,
    noise: float = SENSOR_NOISE,
    gray: float = MIDDLE_GRAY,
) -> Pair:
    """Take both views of a scene, with the truth; the range is left open."""
    exposure = exposure_of(scene, camera, gray=gray)
    truth = disparities(scene.shapes, camera, LEFT)
    nonocc = visible_in_both(scene.shapes, camera, truth)
    views = [
        photograph(scene, camera, side, exposure, np.random.default_rng(noise_seed), noise=noise)
        for side, noise_seed in zip((LEFT, RIGHT), noise_seeds, strict=True)
    ]

    return Pair(
        name=name,
        left=views[0],
        right=views[1],
        truth=truth.astype(np.float32),
        truth_right=disparities(scene.shapes, camera, RIGHT).astype(np.float32),
        masks={
            "nonocc": nonocc,
            "all": np.ones_like(nonocc),
            "disc": nonocc & near_jumps(truth),
        },
        num_disparities=0,
        calibration=None,
    )


def _calibration(camera: Camera, num_disparities: int) -> Calibration:
    """Treat the world unit as a meter; the baseline is in mm, as in Middlebury's files."""
    baseline = 1000 * camera.focal_baseline / camera.focal
    known = Calibration.from_focal(camera.focal, baseline, width=camera.width, height=camera.height)
    return replace(known, ndisp=num_disparities)

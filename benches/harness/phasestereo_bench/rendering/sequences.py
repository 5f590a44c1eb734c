"""Renders videos: scenes of `render_pair` over some frames, with the truth of each frame.

Every frame has fresh noise. Only one other thing may change: the place of the rig, or the place of
one object before a ground that stands still. In a static scene nothing else changes.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from phasestereo_bench.arrays import Mask
from phasestereo_bench.rendering.camera import LEFT, RIGHT, Camera
from phasestereo_bench.rendering.casting import cast, disparities, visible_in_both, windows
from phasestereo_bench.rendering.light import Scenery, Surface, exposure_of, photograph
from phasestereo_bench.rendering.scenery import furnish
from phasestereo_bench.rendering.shapes import Ellipsoid

Motion: TypeAlias = Literal["static", "camera", "object"]
MOTIONS: tuple[Motion, ...] = get_args(Motion)
"""A static scene; a rig that moves to the right and back; an object that moves to the right."""

OUTLINE_REACH = 5  # px to either side of the moving object's outline: half of a usual window
_STEP = 0.02, -0.01  # world units a frame: the rig moves to the right and away from the scene
_BALL_DEPTH = 1.3  # depth of the object; the nearest things of the scene are at 1.2 or so
_BALL_RADIUS = 0.18
_BALL_STEP = 0.03  # world units a frame to the right: about 2 % of the image's width


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One frame of a sequence.

    Parameters
    ----------
    left, right
        uint8 (H, W, 3), RGB.
    truth
        Disparities in px at the pixel centers of the left view, float32 (H, W).
    nonocc
        bool (H, W): the surface point is the front-most in the right view, too.
    outline
        bool (H, W): pixels within `OUTLINE_REACH` of the outline of the object that moves.
    """

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    truth: NDArray[np.float32]
    nonocc: Mask
    outline: Mask


def render_sequence(
    motion: Motion,
    seed: int = 0,
    *,
    frames: int = 12,
    height: int = 180,
    width: int = 240,
    num_disparities: int = 32,
    noise: float = 3.0,
) -> Iterator[Shot]:
    """Render the frames of a stereo video of a random scene, with their truth.

    Parameters
    ----------
    motion
        The motion, one of `MOTIONS`.
    seed
        Seed of the scene and the noise, an integer >= 0.
    frames
        Number of frames.
    height, width, num_disparities
        As in `render_pair`; if the rig or an object moves, disparities stay in the range, too.
    noise
        Standard deviation of the Gaussian noise in gray levels, independent for every frame, view,
        pixel and channel.

    Yields
    ------
    Shot

    Raises
    ------
    ValueError
        If there is no such motion.
    """
    if motion not in MOTIONS:
        raise ValueError(f"motion: got {motion!r}; accepts {', '.join(MOTIONS)}")

    scene_seed, noise_seed = np.random.SeedSequence(seed).spawn(2)
    camera = Camera(height=height, width=width)
    scene = furnish(np.random.default_rng(scene_seed), camera)

    near = min(scene.near, _BALL_DEPTH - 2 * _BALL_RADIUS)  # the rig is the same for every motion
    camera = replace(camera, near=near, near_disparity=num_disparities - 2.0)
    exposure, rng = exposure_of(scene, camera), np.random.default_rng(noise_seed)

    for index in range(frames):
        view, shown = _moved(motion, index - frames / 2, camera, scene)
        truth = disparities(shown.shapes, view, LEFT)

        images = [
            photograph(shown, view, side, exposure, rng, noise=noise) for side in (LEFT, RIGHT)
        ]

        yield Shot(
            left=images[0],
            right=images[1],
            truth=truth.astype(np.float32),
            nonocc=visible_in_both(shown.shapes, view, truth),
            outline=_outline(shown, view, moves=motion == "object"),
        )


def _moved(motion: Motion, time: float, camera: Camera, scene: Scenery) -> tuple[Camera, Scenery]:
    """Return the rig and the scene a number of frames after the middle of the sequence."""
    if motion == "camera":
        right, ahead = _STEP
        return replace(camera, x=right * time, z=ahead * time), scene
    if motion == "object":
        return camera, replace(scene, surfaces=[*scene.surfaces, _ball(scene, camera, time)])
    return camera, scene


def _ball(scene: Scenery, camera: Camera, time: float) -> Surface:
    """Return the object, with the texture of the first thing of the scene."""
    height, depth = camera.eye - 0.2 * _BALL_DEPTH, _BALL_DEPTH
    ball = Ellipsoid((_BALL_STEP * time, height, depth), (_BALL_RADIUS,) * 3)
    return Surface(ball, scene.surfaces[-1].texture)


def _outline(scene: Scenery, camera: Camera, *, moves: bool) -> Mask:
    """Return the pixels near the outline of the last thing in the scene, if that thing moves."""
    outline = np.zeros((camera.height, camera.width), dtype=bool)
    if not moves:
        return outline

    bounds, last = windows(scene.shapes, camera, LEFT), len(scene.surfaces) - 1
    inside = np.zeros_like(outline)
    for band, columns, rows in camera.bands():
        inside[band] = (
            cast(scene.shapes, camera.rays(columns, rows, LEFT), bounds, band.start)[1] == last
        )

    size = 2 * OUTLINE_REACH + 1
    return ndimage.maximum_filter(inside, size) & ~ndimage.minimum_filter(inside, size)

"""Trials: scenes with one image, both or none blurred, and the blur that is estimated."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from phasestereo.rig.estimation import estimate_blur
from phasestereo_bench import cases
from phasestereo_bench.arrays import Array
from phasestereo_bench.datasets import Pair, Scene
from phasestereo_bench.degradation import Degradation, Kernel, disk_psf, gaussian_psf, motion_psf
from phasestereo_bench.measurement import measured
from phasestereo_bench.runner import Job

KIND = "blur"
"""The kind of the records."""

_ANGLES = (0.0, 30.0, 90.0, 135.0)
_BLURS = (
    *(("gaussian", size, 0.0) for size in (1.0, 1.5, 2.0, 3.0, 4.0)),
    *(("disk", size, 0.0) for size in (2.0, 3.0, 4.0, 6.0, 8.0)),
    *(("motion", size, angle) for size in (5.0, 9.0, 15.0, 21.0) for angle in _ANGLES),
)
_BLURS_OF_BOTH = (
    ("gaussian", 1.5, 0.0),
    ("gaussian", 3.0, 0.0),
    ("disk", 3.0, 0.0),
    ("motion", 9.0, 0.0),
)
_NOISES = (1.0, 2.0)
_SEEDS = {"left": 1, "right": 2}


@dataclass(frozen=True, slots=True)
class BlurTrial:
    """A scene, and what was done to its images.

    Attributes
    ----------
    scene
        The scene.
    family
        "gaussian", "disk", "motion", or "none": then the images are as they are.
    size, angle
        As `phasestereo.Blur` has them.
    side
        Which image is blurred: "left", "right", "both" or "neither".
    noise
        Standard deviation of the noise that blurred images get, gray levels.
    """

    scene: Scene
    family: str
    size: float
    angle: float
    side: str
    noise: float

    @property
    def psf(self) -> Kernel | None:
        """The point-spread function."""
        match self.family:
            case "gaussian":
                return gaussian_psf(self.size)
            case "disk":
                return disk_psf(self.size)
            case "motion":
                return motion_psf(self.size, self.angle)
        return None

    def views(self, pair: Pair) -> tuple[Array, Array]:
        """Return the images of a pair, left and right, as the trial has them."""
        return self._view(pair.left, "left"), self._view(pair.right, "right")

    def _view(self, image: Array, side: str) -> Array:
        if self.side not in (side, "both"):
            return image
        return Degradation(self.psf, noise=self.noise, seed=_SEEDS[side])(image)


def blur_jobs(scenes: Iterable[Scene], *, every: int = 1) -> list[Job]:
    """Return the jobs that blur scenes by known kernels and estimate the blur, one for each trial.

    Every scene is tried as it is; with one image blurred, the left or the right one, by 26
    point-spread functions (Gaussians of standard deviation 1 to 4 px, disks of radius 2 to 8 px,
    motions of 5 to 21 px in four directions), with noise of 1 or 2 gray levels; and with both
    images blurred alike, for which no relative blur is the right answer.

    Parameters
    ----------
    scenes
        As `phasestereo_bench.datasets.find_scenes` returns them.
    every
        Run every N-th trial, 1 or more: 7 gives a quick look at all kinds of them.

    Returns
    -------
    list of Job
        Their records: "kind", "collection", "scene", "family", "size", "angle", "side" and "noise"
        identify a trial, as `BlurTrial` has them. Good ones have "found" ("side", "kind", "size"
        and "angle" of the blur of the largest area), "kinds" (how many), "areas" (the share of
        each), "certainty", "contrast", "noise_found", "num_disparities", "width", "height",
        "seconds" and "peak_bytes" of the estimation, on one thread.

    Raises
    ------
    ValueError
        If there is no trial, or `every` is less than 1.
    """
    if every < 1:
        raise ValueError(f"every: got {every}; accepts 1 and more")

    trials = [trial for scene in scenes for trial in _trials(scene)][::every]
    if not trials:
        raise ValueError("there is no scene to blur")

    # Files may have changed since an earlier call in this process.
    cases.forget()
    return [Job(_key(trial), try_out, {"trial": trial}) for trial in trials]


def try_out(trial: BlurTrial) -> dict[str, Any]:
    """Estimate the blur of a trial and return its record."""
    pair = cases.load(trial.scene)
    left, right = trial.views(pair)
    count = pair.num_disparities

    done = measured(lambda: estimate_blur(left, right, num_disparities=count, threads=1))
    estimate, blur = done.answer, done.answer.blur
    height, width = left.shape[:2]

    return {
        "found": {name: getattr(blur, name) for name in ("side", "kind", "size", "angle")},
        "kinds": len(estimate.blurs),
        "areas": estimate.areas(),
        "certainty": estimate.certainty,
        "contrast": estimate.contrast,
        "noise_found": estimate.noise,
        "num_disparities": count,
        "width": width,
        "height": height,
        "seconds": done.seconds,
        "peak_bytes": done.peak_bytes,
    }


def _trials(scene: Scene) -> Sequence[BlurTrial]:
    one_sided = [
        BlurTrial(scene, *blur, side, noise)
        for blur, side, noise in product(_BLURS, ("left", "right"), _NOISES)
    ]
    alike = [BlurTrial(scene, *blur, "both", 1.0) for blur in _BLURS_OF_BOTH]

    return [BlurTrial(scene, "none", 0.0, 0.0, "neither", 0.0), *one_sided, *alike]


def _key(trial: BlurTrial) -> dict[str, str | int | float | bool | None]:
    return {
        "kind": KIND,
        "collection": trial.scene.collection,
        "scene": trial.scene.name,
        "family": trial.family,
        "size": trial.size,
        "angle": trial.angle,
        "side": trial.side,
        "noise": trial.noise,
    }

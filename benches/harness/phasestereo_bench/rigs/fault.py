"""Defines the faults of rigs: changes to a whole pair, and combinations of simple changes.

A step takes a pair and its worse side, and returns the pair as that rig would deliver it. Each
image has its own seed, so the two never have the same noise.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

from phasestereo_bench.arrays import Image
from phasestereo_bench.datasets import Pair, Scene

Spoiler: TypeAlias = Callable[["Image", int], "Image"]
"""A function that spoils one image: it takes the image and a seed, and keeps shape and type."""

Step: TypeAlias = Callable[["Pair", str], "Pair"]
"""A function that spoils a pair: it takes the pair and the worse side, "left" or "right"."""

ALTERNATING = "alternating"
"""A value in place of a side: the left image is worse in every other scene, else the right one."""

SEEDS = {"left": 1, "right": 2}

# The page that defines the suite has this order; the first scene is spoiled on the left.
SCENES = (
    "scenes2001/tsukuba",
    "scenes2001/venus",
    "scenes2003/cones",
    "scenes2005/ThirdSize/Art",
    "scenes2005/ThirdSize/Moebius",
    "scenes2006/ThirdSize/Aloe",
    "scenes2006/ThirdSize/Baby1",
    "scenes2006/ThirdSize/Lampshade1",
    "scenes2006/ThirdSize/Rocks1",
    "MiddEval3/trainingQ/Motorcycle",
    "MiddEval3/trainingQ/Piano",
    "MiddEval3/trainingQ/Playroom",
)


@dataclass(frozen=True, slots=True)
class Fault:
    """One imperfection of a rig, a callable that takes a pair and the worse side.

    A call returns a new pair: images of the same shape and type, and, if the right image has moved,
    new disparities, masks, and number of disparities to search.

    Parameters
    ----------
    name
        Name of the fault in tables.
    group
        The table of the suite that has the fault.
    steps
        Steps to apply, in this order.
    """

    name: str
    group: str
    steps: tuple[Step, ...] = ()

    def __call__(self, pair: Pair, side: str) -> Pair:
        """Return the spoiled pair.

        Raises
        ------
        ValueError
            If `side` is neither "left" nor "right".
        """
        if side not in SEEDS:
            raise ValueError(f"side: got {side!r}; accepts left and right")

        for step in self.steps:
            pair = step(pair, side)
        return pair


@dataclass(frozen=True, slots=True)
class One:
    """A step that spoils only the worse image."""

    spoiler: Spoiler

    def __call__(self, pair: Pair, side: str) -> Pair:
        """Return the spoiled pair."""
        return _spoiled(pair, side, self.spoiler)


@dataclass(frozen=True, slots=True)
class Both:
    """A step that spoils both images: the other one in the same or in another way.

    Parameters
    ----------
    spoiler
        Spoiler of the worse image.
    other
        Spoiler of the other image; None: the same.
    """

    spoiler: Spoiler
    other: Spoiler | None = None

    def __call__(self, pair: Pair, side: str) -> Pair:
        """Return the spoiled pair."""
        better = "right" if side == "left" else "left"
        pair = _spoiled(pair, side, self.spoiler)
        return _spoiled(pair, better, self.other or self.spoiler)


def side_of(scene: Scene) -> str:
    """Return the worse image of a scene if sides alternate.

    Left and right take turns in the order of the suite's scenes; any other scene has left.
    """
    name = str(scene)
    return "right" if name in SCENES and SCENES.index(name) % 2 else "left"


def _spoiled(pair: Pair, side: str, spoiler: Spoiler) -> Pair:
    if side == "left":
        return replace(pair, left=spoiler(pair.left, SEEDS["left"]))
    return replace(pair, right=spoiler(pair.right, SEEDS["right"]))

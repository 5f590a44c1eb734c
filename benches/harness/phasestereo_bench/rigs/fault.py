"""Faults of rigs: changes to a whole pair, and combinations of simple ones.

A step takes a pair and the side that is the worse one, and returns the pair as that rig would have
delivered it. Either image has a seed of its own, so that the two never have the same noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

from phasestereo_bench.arrays import Image
from phasestereo_bench.datasets import Pair, Scene

Spoiler: TypeAlias = Callable[["Image", int], "Image"]
"""What spoils one image: called with it and a seed, it returns one of the same shape and type."""

Step: TypeAlias = Callable[["Pair", str], "Pair"]
"""What spoils a pair: called with it and the worse side, "left" or "right"."""

ALTERNATING = "alternating"
"""In place of a side: the left image is the worse one of every other scene, else the right one."""

SEEDS = {"left": 1, "right": 2}

# In the order of the page that defines the suite; the first is spoiled on the left.
_ORDER = (
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
    """One way in which a rig is not perfect, to be called with a pair and the worse side.

    Calling it returns a new pair: images of the same shape and type, and, where the right image
    has been moved, its disparities, its masks, and the number of disparities to search.

    Parameters
    ----------
    name
        What tables call it.
    group
        The table that it is in, one of its suite.
    steps
        What is done, in this order.
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
    """A step that spoils the worse image alone."""

    spoiler: Spoiler

    def __call__(self, pair: Pair, side: str) -> Pair:
        """Return the spoiled pair."""
        return _spoiled(pair, side, self.spoiler)


@dataclass(frozen=True, slots=True)
class Both:
    """A step that spoils both images: the worse one, and the other one in the same or another way.

    Parameters
    ----------
    spoiler
        Of the worse image.
    other
        Of the other one; None: the same.
    """

    spoiler: Spoiler
    other: Spoiler | None = None

    def __call__(self, pair: Pair, side: str) -> Pair:
        """Return the spoiled pair."""
        better = "right" if side == "left" else "left"
        pair = _spoiled(pair, side, self.spoiler)
        return _spoiled(pair, better, self.other or self.spoiler)


def side_of(scene: Scene) -> str:
    """Return the worse image of a scene where sides alternate.

    Left and right by turns in the order of the suite's scenes; left of any other scene.
    """
    name = str(scene)
    return "right" if name in _ORDER and _ORDER.index(name) % 2 else "left"


def _spoiled(pair: Pair, side: str, spoiler: Spoiler) -> Pair:
    if side == "left":
        return replace(pair, left=spoiler(pair.left, SEEDS["left"]))
    return replace(pair, right=spoiler(pair.right, SEEDS["right"]))

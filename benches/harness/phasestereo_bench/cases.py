"""Defines a case: a scene, and the changes to its images before a match."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, TypeAlias

from phasestereo_bench.datasets import Pair, Scene
from phasestereo_bench.degradation import Degradation, Kernel, suite
from phasestereo_bench.rigs import ALTERNATING, RIGS, SCENES, Fault, side_of

Recipe: TypeAlias = Callable[..., Any]
"""A function that degrades an image, and keeps its shape and type. In the suites "rigs" and
"rigs-2" it is a `Fault`, which takes a whole pair."""

SUITES: Mapping[str, Mapping[str, Recipe]] = {
    "one-sided-blur": suite(),
    "sharp": {"sharp": Degradation()},
    **RIGS,
}
"""The degradations of each suite by name."""

PLANES = frozenset(
    f"{collection}/{scene}"
    for collection, scenes in (
        ("MiddEval3/trainingQ", ("PianoL", "Playtable")),
        ("scenes2006/ThirdSize", ("Lampshade2", "Midd2", "Monopoly", "Plastic")),
    )
    for scene in scenes
)
"""Scenes with large planes."""

SUITE_SCENES: Mapping[str, frozenset[str]] = {
    **dict.fromkeys(SUITES, frozenset(SCENES)),
    "rigs-2": PLANES.union(
        SCENES, ("kitti2012/training/000027_10", "kitti2012/training/000151_10")
    ),
}
"""The scenes that the means of a suite cover, if it names them; each as `str(scene)`."""

SIDES = ("left", "right", ALTERNATING)

_KEPT = 2  # adjacent jobs need one degraded image, and its true blur


@dataclass(frozen=True, slots=True)
class Case:
    """A scene with one image degraded, or as a rig with a fault delivers it.

    Attributes
    ----------
    scene
        The scene.
    suite, degradation
        Its degradation, as in `SUITES`.
    side
        The degraded image: "left", "right", or "alternating", which `rigs.side_of` decides.
    """

    scene: Scene
    suite: str
    degradation: str
    side: str

    @property
    def degrade(self) -> Recipe:
        """The function that degrades the image."""
        return SUITES[self.suite][self.degradation]

    @property
    def kernel(self) -> Kernel | None:
        """The kernel of the degradation, if it has one; then there is a true blur."""
        return getattr(self.degrade, "psf", None)

    def pair(self, *, true_blur: bool) -> Pair:
        """Return the pair to match and to score; the caller may change the images.

        Parameters
        ----------
        true_blur
            Convolve the sharp image with the kernel of the degradation, too, and round it.

        Raises
        ------
        OSError, ValueError
            As `Scene.load`; ValueError also if the requested true blur is missing.
        """
        pair = _pair(self, true_blur)
        return replace(pair, left=pair.left.copy(), right=pair.right.copy())


def require_known(argument: str, values: Iterable[object], known: Iterable[str]) -> None:
    """Refuse a value that is not among the known ones.

    Raises
    ------
    ValueError
        If there is such a value; the message names the argument.
    """
    names = list(known)
    for value in values:
        if value not in names:
            raise ValueError(f"{argument}: got {value!r}; accepts {', '.join(names)}")


def usual_side(suite: str) -> str:
    """Return the image of a suite's pairs that is degraded by default."""
    return ALTERNATING if suite in RIGS else "left"


@lru_cache(_KEPT)
def load(scene: Scene) -> Pair:
    """Load a scene; neighboring jobs share it, so do not change it."""
    return scene.load()


def forget() -> None:
    """Forget loaded and degraded images, because files may have changed."""
    load.cache_clear()
    _pair.cache_clear()


@lru_cache(_KEPT)
def _pair(case: Case, true_blur: bool) -> Pair:  # noqa: FBT001 - lru_cache distinguishes keywords
    pair = load(case.scene)
    side = side_of(case.scene) if case.side == ALTERNATING else case.side

    if true_blur and case.kernel is None:
        raise ValueError(f"there is no true blur of {case.degradation!r}")

    if isinstance(case.degrade, Fault):
        return case.degrade(pair, side)

    images = {"left": pair.left, "right": pair.right}
    images[side] = case.degrade(images[side])

    if true_blur:
        sharp = "right" if side == "left" else "left"
        images[sharp] = Degradation(psf=case.kernel)(images[sharp])

    return replace(pair, left=images["left"], right=images["right"])

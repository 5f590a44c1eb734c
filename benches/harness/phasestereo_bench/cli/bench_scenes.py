"""Selects the scenes that ``phasestereo bench middlebury`` scores."""

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from phasestereo.cli.terminal import say
from phasestereo_bench.cases import SUITE_SCENES
from phasestereo_bench.cli.parameters import Names
from phasestereo_bench.datasets import Scene, find_scenes
from phasestereo_bench.middlebury import has_truth

_LISTED = 5  # names of scenes in a line


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneChoice:
    """A choice of scenes.

    Parameters
    ----------
    scene
        Only these scenes, by name: cones, trainingH/Piano, "scenes2005/*". Without it, the scenes
        of the suite; if none of those is there, all scenes with a truth.
    """

    scene: Names = ()

    def select(self, folders: Sequence[Path], suite: str, *, silent: bool = False) -> list[Scene]:
        """Return the scenes of these folders, and print those left out unless ``silent``.

        Raises
        ------
        OSError, ValueError
            As `phasestereo_bench.datasets.find_scenes`; ValueError also if a scene is missing, or
            no scene can be scored.
        """
        if not folders:
            raise ValueError("no folder given: where are the scenes?")

        scenes = {(s.folder, s.name): s for folder in folders for s in find_scenes(folder)}
        there = list(scenes.values())
        named = [scene for name in self.scene for scene in _named(name, there)]
        if named:
            return list(dict.fromkeys(named))
        chosen, left_out = _scored(there, suite)
        if left_out and not silent:
            say(left_out)
        return chosen


ALL = SceneChoice()
"""Every scene of the suite."""


def _named(name: str, scenes: Sequence[Scene]) -> list[Scene]:
    pattern = f"*/{name}".casefold()
    named = [scene for scene in scenes if fnmatchcase(f"/{scene}".casefold(), pattern)]
    if not named:
        raise ValueError(f"scene: got {name!r}; there is {', '.join(map(str, scenes))}")
    return named


def _scored(scenes: Sequence[Scene], suite: str) -> tuple[list[Scene], str]:
    """Return scenes of the suite, or else all with a truth, and a sentence on those left out."""
    known = [scene for scene in scenes if has_truth(scene)]
    if not known:
        raise ValueError(f"nothing to score, no truth is known: {_listed(scenes)}")

    of_suite = [scene for scene in known if str(scene) in SUITE_SCENES.get(suite, ())]
    others = [scene for scene in scenes if scene not in (of_suite or known)]
    reason = f"not of {suite}; --scene takes any" if of_suite else "without a known truth"

    return of_suite or known, f"left out, {reason}: {_listed(others)}" if others else ""


def _listed(scenes: Sequence[Scene]) -> str:
    more = f" and {len(scenes) - _LISTED} more" if len(scenes) > _LISTED else ""
    return ", ".join(map(str, scenes[:_LISTED])) + more

"""Pairs that were spoiled, their maps in short, and what matches them in a process of its own.

    PHASESTEREO_SIMD=avx2 python -m support.determinism FOLDER

prints the digests of all pairs that are saved in a folder, matched with these instructions.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo.settings import PresetName
from phasestereo_bench import SUITES
from phasestereo_bench.datasets import Scene, find_scenes
from phasestereo_bench.rendering import render_pair
from support import ENVIRONMENT

Image = NDArray[Any]
Maps = dict[str, str]

SIZE = 150, 220
PRESETS = "robust", "robust", "fast"
"""Drawn from: `robust` estimates all that there is."""

FIRST = "hot 1%", "inverted", "jpeg 30", "wobble 2", "depth 4"
"""What a few pairs have at least; those after them have faults that are drawn."""


@dataclass(frozen=True)
class Spoiled:
    """A crop of a pair, one image of which was spoiled, and how it is to be matched."""

    name: str
    left: Image
    right: Image
    preset: PresetName

    @cached_property
    def whole(self) -> ps.Result:
        return self.match()

    def match(self, threads: int | None = None) -> ps.Result:
        return ps.match(self.left, self.right, preset=self.preset, threads=threads)


def drawn(count: int, seed: int, data: Path) -> list[Spoiled]:
    """Return crops of the real pairs of a folder, or of rendered ones where there are none."""
    rng = np.random.default_rng(seed)
    scenes = find_scenes(data / "middlebury") if (data / "middlebury").is_dir() else []
    faults = [*FIRST, *rng.choice([*SUITES["rigs"]], count)]
    return [_draw(rng, scenes, str(fault)) for fault in faults[:count]]


def _draw(rng: np.random.Generator, scenes: list[Scene], name: str) -> Spoiled:
    if scenes:
        pair = scenes[rng.integers(len(scenes))].load()
    else:
        number = int(rng.integers(1 << 16))
        pair = render_pair(number, height=SIZE[0] + 30, width=SIZE[1] + 60, num_disparities=48)
    fault: Any = SUITES["rigs"][name]
    side = str(rng.choice(["left", "right"]))
    spoiled = fault(pair, side)

    rows, cols = spoiled.left.shape[:2]
    y = int(rng.integers(max(rows - SIZE[0], 0) + 1))
    x = int(rng.integers(max(cols - SIZE[1], 0) + 1))
    crop = np.s_[y : y + SIZE[0], x : x + SIZE[1]]
    left, right = (np.ascontiguousarray(image[crop]) for image in (spoiled.left, spoiled.right))
    if rng.random() < 0.3:
        left, right = (image.astype(np.uint16) * 257 for image in (left, right))
    preset = "robust" if name in FIRST else cast("PresetName", rng.choice(PRESETS).item())
    return Spoiled(f"{pair.name}, {name} {side}", left, right, preset)


def at_level(level: str, pairs: Iterable[Spoiled], folder: Path) -> list[Maps]:
    """Match pairs in a process that uses these instructions, if the machine has them."""
    for at, one in enumerate(pairs):
        np.savez(folder / f"{at:04}-{one.preset}.npz", left=one.left, right=one.right)
    done = subprocess.run(  # noqa: S603 -- ourselves
        [sys.executable, "-m", __name__, str(folder)],
        env=ENVIRONMENT | {"PHASESTEREO_SIMD": level},
        capture_output=True,
        text=True,
        check=True,
    )
    found: list[Maps] = json.loads(done.stdout)
    return found


def digests(result: ps.Result) -> Maps:
    """Return digests of the maps, and of what is said of them."""
    said = [(one.topic, one.severity, one.sentence) for one in result.findings]
    return digests_of(result.maps) | {"findings": words(said)}


def digests_of(planes: Mapping[str, Image]) -> Maps:
    """Return digests of planes by their names."""
    return {name: hashlib.sha256(plane.tobytes()).hexdigest() for name, plane in planes.items()}


def words(said: Iterable[tuple[str, ...]]) -> str:
    """Return sentences, each with its topic and severity, in one text."""
    return "\n".join("|".join(one) for one in said)


def main(folder: Path) -> None:
    """Print the digests of all pairs of a folder."""
    warnings.simplefilter("ignore", ps.MatchWarning)  # of pairs that were spoiled on purpose
    found = []
    for path in sorted(folder.glob("*.npz")):
        with np.load(path) as saved:
            one = Spoiled(
                "", saved["left"], saved["right"], cast("PresetName", path.stem.partition("-")[2])
            )
        found.append(digests(one.match(threads=2)))
    print(json.dumps(found))  # noqa: T201


if __name__ == "__main__":
    main(Path(sys.argv[1]))

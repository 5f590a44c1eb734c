"""One map of a pair, to the bit, however it is matched: spoiled crops of real pairs, all estimated.

    python tests/determinism.py [--pairs 60] [--seed N] [--data FOLDER]

Each pair is matched with several numbers of threads, from views and in both byte orders, twice by
one matcher, from files by the command line, and at every instruction-set level, each in a process
of its own. Prints what differs; without a folder of data rendered pairs are spoiled.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo import cli
from phasestereo.io import read_disparity, write_image
from phasestereo_bench import SUITES
from phasestereo_bench.datasets import Scene, find_scenes
from phasestereo_bench.rendering import render_pair

Image = NDArray[Any]
Maps = dict[str, str]

LEVELS = "sse2", "avx2", "avx512", "avx512bitalg"
"""Where there are none of them, the processes do all the same."""

SIZE = 150, 220
PRESETS = "robust", "robust", "fast"
"""Drawn from: `robust` estimates all that there is."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--match", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    warnings.simplefilter("ignore", ps.MatchWarning)  # of pairs that were spoiled on purpose

    if given.match:
        print(json.dumps([at_this_level(*saved) for saved in load(given.match)]))  # noqa: T201
        return

    with tempfile.TemporaryDirectory() as folder:
        differing = compare(given.pairs, given.seed, given.data, Path(folder))
    for line in differing:
        print(line)  # noqa: T201
    print(f"{given.pairs} pairs of seed {given.seed}: {len(differing)} differences")  # noqa: T201
    sys.exit(bool(differing))


def compare(count: int, seed: int, data: Path | None, folder: Path) -> list[str]:
    """Return a line for each way of matching a pair whose map is another one."""
    rng = np.random.default_rng(seed)
    scenes = find_scenes(data / "middlebury") if data else []
    drawn = [draw(rng, scenes) for _ in range(count)]
    names = [name for name, *_ in drawn]
    for at, (_, left, right, preset) in enumerate(drawn):
        np.savez(folder / f"{at:04}-{preset}.npz", left=left, right=right)

    expected, differing = [], []
    for name, left, right, preset in drawn:
        first, *others = ways(left, right, preset, folder)
        expected.append(first[1])
        differing += [f"{name}: {way}" for way, found in others if not agrees(found, first[1])]

    for level in LEVELS:
        done = subprocess.run(  # noqa: S603 -- ourselves
            [sys.executable, __file__, "--match", str(folder)],
            env=os.environ | {"PHASESTEREO_SIMD": level},
            capture_output=True,
            text=True,
            check=True,
        )
        pairs = zip(names, json.loads(done.stdout), expected, strict=True)
        differing += [f"{name}: {level}" for name, found, one in pairs if found != one]
    return differing


def agrees(found: Maps, expected: Maps) -> bool:
    """Tell whether maps are the same, as far as a way of matching gives them."""
    return found.items() <= expected.items()


def draw(rng: np.random.Generator, scenes: list[Scene]) -> tuple[str, Image, Image, str]:
    """Return a crop of a spoiled pair, with its name, and a preset."""
    if scenes:
        pair = scenes[rng.integers(len(scenes))].load()
    else:
        number = int(rng.integers(1 << 16))
        pair = render_pair(number, height=SIZE[0] + 30, width=SIZE[1] + 60, num_disparities=48)
    faults: list[Any] = list(SUITES["rigs"].values())
    fault, side = faults[rng.integers(len(faults))], str(rng.choice(["left", "right"]))
    spoiled = fault(pair, side)

    rows, cols = spoiled.left.shape[:2]
    y = int(rng.integers(max(rows - SIZE[0], 0) + 1))
    x = int(rng.integers(max(cols - SIZE[1], 0) + 1))
    crop = np.s_[y : y + SIZE[0], x : x + SIZE[1]]
    left, right = (np.ascontiguousarray(image[crop]) for image in (spoiled.left, spoiled.right))
    if rng.random() < 0.3:
        left, right = (image.astype(np.uint16) * 257 for image in (left, right))
    return f"{pair.name}, {fault.name} {side}", left, right, str(rng.choice(PRESETS))


def load(folder: Path) -> Iterator[tuple[Image, Image, str]]:
    for path in sorted(folder.glob("*.npz")):
        with np.load(path) as saved:
            yield saved["left"], saved["right"], path.stem.partition("-")[2]


def at_this_level(left: Image, right: Image, preset: str) -> Maps:
    return digests(ps.match(left, right, preset=preset, threads=2))


def ways(left: Image, right: Image, preset: str, folder: Path) -> Iterator[tuple[str, Maps]]:
    """Match a pair in every way of this process."""
    for threads in 1, 2, 3, 8:
        found = ps.match(left, right, preset=preset, threads=threads)
        yield f"{threads} threads", digests(found)

    turned = [np.ascontiguousarray(image[::-1, ::-1])[::-1, ::-1] for image in (left, right)]
    yield "views", digests(ps.match(*turned, preset=preset))
    swapped = [image.astype(image.dtype.newbyteorder()) for image in (left, right)]
    yield "byte order", digests(ps.match(*swapped, preset=preset))

    matcher = ps.Matcher(preset=preset, threads=2)
    matcher.match(right, left)
    yield "a matcher in use", digests(matcher.match(left, right))

    files = [str(folder / name) for name in ("left.tif", "right.tif", "map.npy")]
    for path, image in zip(files, (left, right), strict=False):
        write_image(path, image)
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        code = cli.run(["match", *files[:2], "-o", files[2], "--preset", preset])
    shown = digest(read_disparity(files[2])) if code == 0 else f"code {code}"
    yield "phasestereo match", {"disparity": shown}


def digests(result: ps.Result) -> Maps:
    """Return digests of the maps, and of what is said of them."""
    planes = ("disparity", "flags", "confidence", "uncertainty")
    maps = {name: digest(getattr(result, name)) for name in planes}
    said = repr([(one.topic, one.severity, one.sentence) for one in result.findings])
    return maps | {"findings": hashlib.sha256(said.encode()).hexdigest()}


def digest(plane: Image | None) -> str:
    return hashlib.sha256(b"" if plane is None else plane.tobytes()).hexdigest()


if __name__ == "__main__":
    main()

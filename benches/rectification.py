"""How well rows correspond after `ps.rectify` without a calibration: the table of the docs.

    python benches/rectification.py DATA

DATA holds `rigs/euroc` and `middlebury`. The raw frames of EuRoC are held against their
calibration. Middlebury's pairs are seen anew by cameras that are turned, that distort and that have
other focal lengths, and the left image is degraded; the truth is what these cameras are. Rows are
compared all over the image, at depths all over the scene's range.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import phasestereo as ps
from phasestereo_bench.datasets import find_scenes
from phasestereo_bench.degradation import suite

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from support.rigs import EXACT, Lens, euroc, euroc_frames, of_opencv, row_errors, turned

# Rotations of both cameras in degrees, k1 of both, ratio of focal lengths, rows lower
RIGS: dict[str, tuple[Any, ...]] = {
    "as they are": ((0, 0, 0), (0, 0, 0), 0, 0, 1, 0),
    "30 rows lower": ((0, 0, 0), (0, 0, 0), 0, 0, 1, 30),
    "turned by 3 degrees": ((0, 0, 0), (0, 0, 3), 0, 0, 1, 0),
    "by 2 about each axis": ((0, 0, 0), (2, 2, -2), 0, 0, 1, 0),
    "focal lengths 5 % apart": ((0, 0, 0), (0, 0, 0), 0, 0, 1.05, 0),
    "k1 = -0.2, and turned by 1": ((0, 0, 0), (1, 0, 1), -0.2, -0.2, 1, 0),
    "all of it": ((1, -2, 2), (-1, 3, -3), -0.1, -0.12, 1.03, 10),
}
DEPTHS = 5


def plain(size: tuple[int, int]) -> Any:
    """Return the intrinsics of a camera whose focal length is the width of its image."""
    rows, cols = size
    return np.array([[cols, 0, (cols - 1) / 2], [0, cols, (rows - 1) / 2], [0, 0, 1.0]])


def lens(size: tuple[int, int], degrees: Any, k1: float, focal: float = 1, down: float = 0) -> Lens:
    """Return a camera at the same place that differs by this."""
    k = plain(size)
    k[:2, :2] *= focal
    k[1, 2] += down
    return Lens(k, np.array([k1, 0, 0, 0.0]), turned(*degrees))


def seen_by(image: Any, camera: Lens) -> Any:
    """Return an image as another camera sees it."""
    rows, cols = image.shape[:2]
    undo = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)
    y, x = np.mgrid[0:rows, 0:cols].astype(np.float64)
    points = np.stack([x.ravel(), y.ravel()], axis=1)[:, np.newaxis]
    target = plain((rows, cols))
    places = undo(points, camera.k, camera.d, R=camera.r, P=target, criteria=EXACT)
    maps = places.reshape(rows, cols, 2).astype(np.float32)
    border = cv2.BORDER_REFLECT
    return cv2.remap(image, maps[..., 0], maps[..., 1], cv2.INTER_LANCZOS4, borderMode=border)


def rms(errors: Any) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(errors**2)))


def of_scene(pair: Any, rig: tuple[Any, ...], degraded: Any) -> tuple[float, float, float] | None:
    """Return rows before, after, and as expected; None: refused."""
    size = pair.left.shape[:2]
    first, second, k1, other, focal, down = rig
    left, right = lens(size, first, k1), lens(size, second, other, focal, down)
    raw = seen_by(degraded(pair.left), left), seen_by(pair.right, right)
    known = pair.truth[np.isfinite(pair.truth)]
    shifts = np.linspace(*np.percentile(known, (2, 98)), DEPTHS) / size[1]
    as_it_is = np.meshgrid(*(np.arange(side, dtype=np.float32) for side in size[::-1]))
    before = rms(row_errors((as_it_is, as_it_is), left, right, shifts))
    try:
        found = ps.rectify(*raw)
    except ValueError:
        return None
    return before, rms(row_errors(found.maps, left, right, shifts)), found.error or 0.0


def show(name: str, rows: list[tuple[float, float, float] | None]) -> None:
    """Print a row of the table."""
    done = np.array([row for row in rows if row is not None])
    before, after, said = done.mean(axis=0)
    print(  # noqa: T201
        f"{name:40} before {before:5.1f}  after {after:.2f}, at most {done[:, 1].max():.2f}  "
        f"expected {said:.2f}  refused {len(rows) - len(done)} of {len(rows)}",
        flush=True,
    )


def main(data: Path) -> None:
    """Print the table."""
    rig = euroc(data)
    made = of_opencv(rig, (752, 480))
    left, right = (Lens(rig[f"K{n}"], rig[f"D{n}"], made[f"R{n}"]) for n in "12")
    shifts = np.linspace(14, 46, DEPTHS) / made["P1"][0, 0]
    as_it_is = np.meshgrid(np.arange(752, dtype=np.float32), np.arange(480, dtype=np.float32))
    before = rms(row_errors((as_it_is, as_it_is), left, right, shifts))
    found = [ps.rectify(*pair) for pair in euroc_frames(data)]
    errors = [rms(row_errors(each.maps, left, right, shifts)) for each in found]
    said = [each.error or 0.0 for each in found]
    show("EuRoC", [(before, error, own) for error, own in zip(errors, said, strict=True)])
    scenes = [scene for scene in find_scenes(data / "middlebury") if scene.name != "MotorcycleE"]
    pairs = [scene.load() for scene in scenes]
    for name, cameras in RIGS.items():
        show(name, [of_scene(pair, cameras, lambda image: image) for pair in pairs])
    for name, degraded in suite().items():
        show(f"all of it, {name}", [of_scene(pair, RIGS["all of it"], degraded) for pair in pairs])


if __name__ == "__main__":
    main(Path(sys.argv[1]))

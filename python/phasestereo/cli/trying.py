"""``phasestereo try``: makes a pair with one image out of focus, matches and shows it."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

import sys
import webbrowser
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray

from phasestereo.cli.errors import refusals, worded
from phasestereo.cli.terminal import print_lines
from phasestereo.matching import match
from phasestereo.rig.findings import unwarned
from phasestereo.views.page import write_pair_page

_ROWS, _COLS, _FAR, _NEAR = 360, 480, 8, 32
_BOXES = (120, 220, 60, 160), (150, 270, 330, 420), (220, 330, 190, 290)
"""First and last row, first and last column, the farthest box first; each stands on the floor."""

_COLORS = (205, 214, 226), (168, 132, 96), (196, 92, 70), (98, 148, 110), (92, 132, 190)


def try_it(
    *, output: Annotated[Path, Parameter(alias="-o")] = Path("try.html"), show: bool = True
) -> None:
    """Match a made-up pair, its left image out of focus, and open the page of the result.

    Parameters
    ----------
    output
        The page: one file that needs no network.
    show
        Open it in the web browser.
    """
    left, right = _pair()
    with refusals(), unwarned():
        result = match(left, right)
        write_pair_page(output, left, right, result, title="Boxes, the left image out of focus")
    seconds = sum(result.timings.values())
    print_lines(worded(result.findings))
    print_lines([f"matched in {seconds:.2f} s"])
    print_lines([f"look at {output}; your own: phasestereo match LEFT RIGHT --report page.html"])
    if show and sys.stderr.isatty():
        webbrowser.open(output.absolute().as_uri())


def _pair() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return a wall, a floor that comes nearer row by row, and boxes on it, far to near."""
    half = _ROWS // 2
    nearer = np.arange(half) * (_NEAR - _FAR) // half + _FAR
    parts = [(0, half, 0, _COLS, np.full(half, _FAR)), (half, _ROWS, 0, _COLS, nearer)]
    parts += [(*at, np.full(at[1] - at[0], nearer[at[1] - half])) for at in _BOXES]

    left, right = np.zeros((2, _ROWS, _COLS, 3), np.int64)
    for seed, ((top, bottom, first, end, shifts), color) in enumerate(
        zip(parts, _COLORS, strict=True)
    ):
        samples = np.random.default_rng(seed)
        fine = samples.integers(0, 256, (bottom - top, _COLS + _NEAR))
        grain = ((_means(fine, 7) - 128) * 4 + _means(fine, 2)).clip(0, 255)
        for y, shift in enumerate(shifts, top):
            texture = (128 + grain[y - top, first:, np.newaxis] // 2) * np.array(color) // 255
            left[y, first:end] = texture[: end - first]
            # At the far right, the right image shows more than the left image sees.
            begin, wide = max(first - shift, 0), end if end == _COLS else end - shift
            right[y, begin:wide] = texture[begin + shift - first : wide + shift - first]

    soft = np.dstack([_means(_means(_means(left[:, :, one], 5), 5), 3) for one in range(3)])
    return soft.astype(np.uint8), right.astype(np.uint8)


def _means(image: NDArray[np.int64], size: int) -> NDArray[np.int64]:
    """Return the means of blocks of this size (rows, columns), in integers."""
    padded = np.pad(image, size // 2, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (size, size))
    rows, cols = image.shape
    return windows[:rows, :cols].sum(axis=(2, 3)) // size**2

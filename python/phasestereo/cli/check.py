"""``phasestereo check``: diagnoses two image files."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray

import phasestereo
from phasestereo.cli.errors import claim, refusals, refuse_warnings, worded
from phasestereo.cli.pairing import read_both
from phasestereo.cli.terminal import print_json, print_lines
from phasestereo.io import read_image, write_image
from phasestereo.io.pair import Layout
from phasestereo.rig.blur import Blur, BlurEstimate
from phasestereo.rig.diagnosis import check as check_pair

_TINTS = {"left": (1.0, 0.2, 0.1), "right": (0.1, 0.4, 1.0)}  # red, blue
_NO_TINT = (0.0, 0.0, 0.0)
_WEIGHT = 0.6  # of the tint, where the blur is strongest


def check(
    left: Path,
    right: Path | None = None,
    /,
    *,
    layout: Layout | None = None,
    blur_map: Path | None = None,
    as_json: Annotated[bool, Parameter(name="--json", negative=(), show_default=False)] = False,
    strict: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """Diagnose a stereo pair: find faults that spoil the match.

    Prints one line each on swapped images, the disparities to search, vertical misalignment,
    relative blur, gain and gamma, noise, saturation and texture. Each begins with ``ok``, ``note``
    or ``warning``. A copy of at most 0.4 megapixels is matched; the first line warns if that fails.
    The exit code is 0 regardless of findings, unless --strict is given.

    Parameters
    ----------
    left
        Left image: PNG, JPEG, WebP, HEIF, PBM/PGM/PPM, BMP, TIFF, .npy or PFM; gray or color.
        Without RIGHT, a stereo photograph that holds both views.
    right
        Right image; may differ in size and type.
    layout
        How one file holds both views: side-by-side, or top-bottom with the left view above. An MPO
        file has two pictures and needs no layout.
    blur_map
        PNG file for a picture of the blur: the left image in gray, tinted red where it is softer
        than the right one, and blue where the right one is softer. Stronger blur, stronger tint.
    as_json
        Print one JSON object on standard output: sentences, numbers, the map of blurs.
    strict
        Exit with 3 if there is a warning.
    """
    claim([("blur_map", blur_map)], [left, right], {"blur_map": [".png"]})
    with refusals(options=("layout",)):
        if right is None or layout is not None:
            images = tuple(view.image for view in read_both(left, right, layout=layout))
        else:
            images = read_image(left), read_image(right)
        diagnosis = check_pair(*images)

    if blur_map is not None:
        with refusals():
            write_image(blur_map, _picture(diagnosis.blur, images[0]))

    if as_json:
        print_json({"version": phasestereo.__version__, **diagnosis.as_dict()})
    else:
        print_lines(worded(diagnosis.findings))
    if strict:
        refuse_warnings(diagnosis.findings)


def _picture(estimate: BlurEstimate | None, image: NDArray[Any]) -> NDArray[np.uint8]:
    """Return an image in gray, tinted by the blur in it."""
    gray = image[:, :, :3].mean(axis=2) if image.ndim == 3 else image.astype(np.float64)

    # Any range of gray becomes 0 to 1.
    gray = (gray - gray.min()) / max(float(np.ptp(gray)), np.finfo(float).tiny)
    shown = np.repeat(gray[:, :, np.newaxis], 3, axis=2)

    if estimate is not None:
        color, weight = _tints(estimate.blurs)
        rows, cols = gray.shape
        label = estimate.label_map((rows, cols))
        shown += weight[label] * (color[label] - shown)

    return np.asarray(np.rint(255 * shown), np.uint8)


def _tints(blurs: Sequence[Blur]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a color and its mixing weight for each blur."""
    color = np.array([_TINTS.get(blur.side, _NO_TINT) for blur in blurs])
    strength = np.array([blur.spread for blur in blurs])
    weight = _WEIGHT * strength / max(float(strength.max()), np.finfo(float).tiny)
    return color, weight[:, np.newaxis]

"""``phasestereo verify``: judges each pixel of a disparity map by its two images."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

import phasestereo
from phasestereo.cli.errors import claim, refusals, refuse_warnings, worded
from phasestereo.cli.options import Threads
from phasestereo.cli.terminal import print_json, print_lines, progress_bar
from phasestereo.io import read_disparity, read_image, write_disparity, write_image
from phasestereo.verification import Verification, verify as verify_map

_SUFFIXES = {
    "picture": [".png"],
    "better": [".npy", ".pfm", ".tif", ".tiff"],
    "verdict": [".png"],
}


def verify(
    left: Path,
    right: Path,
    disparity: Path,
    /,
    *,
    picture: Path | None = None,
    better: Path | None = None,
    verdict: Path | None = None,
    threads: Threads = None,
    as_json: Annotated[bool, Parameter(name="--json", negative=(), show_default=False)] = False,
    strict: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """Judge a disparity map of any origin by its images.

    Prints the shares of the map that the images refute, support and cannot judge, and faults of the
    map or the pair as a whole. Lines begin with ``ok``, ``note`` or ``warning``. For example:

    ```
    phasestereo verify left.png right.png network.pfm --picture verdicts.png
    ```

    Parameters
    ----------
    left
        Left image: PNG, JPEG, WebP, HEIF, PBM/PGM/PPM, BMP, TIFF, .npy or PFM; gray or color.
    right
        Right image; may differ in size and type.
    disparity
        The map of the left image, in pixels: .pfm, .npy, .tif, or .png in KITTI's format (16 bits,
        256 d). Non-finite values are not judged.
    picture
        PNG file for the left image in gray: blue where the images support the map, orange where
        they refute it, darker where they cannot judge it.
    better
        File for disparities that fit better where the images refute the map: .pfm, .npy or .tif.
    verdict
        PNG file for the verdicts, 8 bits: 0 no disparity, 1 cannot be judged, 2 supported, 3
        refuted.
    threads
        Number of threads; default: one per processor.
    as_json
        Print one JSON object on standard output: shares, findings, files.
    strict
        Exit with 3 if there is a warning; it still writes files.
    """
    files = {"picture": picture, "better": better, "verdict": verdict}
    claim(files.items(), [left, right, disparity], _SUFFIXES)

    with refusals():
        images, claims = (read_image(left), read_image(right)), read_disparity(disparity)
    with refusals(options={"threads"}), progress_bar("Matching") as progress:
        found = verify_map(*images, claims, threads=threads, progress=progress)

    with refusals():
        _write(found, files)

    if as_json:
        print_json(_record(found, files))
    else:
        print_lines(worded(found.findings))

    if strict:
        refuse_warnings(found.findings)


def _write(found: Verification, files: dict[str, Path | None]) -> None:
    writers: dict[str, Callable[[Path], None]] = {
        "picture": lambda path: write_image(path, found.picture()),
        "better": lambda path: write_disparity(path, found.better),
        "verdict": lambda path: write_image(path, found.verdict),
    }

    for name, path in files.items():
        if path is not None:
            writers[name](path)


def _record(found: Verification, files: dict[str, Path | None]) -> dict[str, Any]:
    rows, cols = found.verdict.shape
    return {
        "version": phasestereo.__version__,
        "width": cols,
        "height": rows,
        "refuted": found.refuted,
        "supported": found.supported,
        "unknown": found.unknown,
        "findings": [asdict(each) for each in found.findings],
        "files": {name: str(path) for name, path in files.items() if path is not None},
    }

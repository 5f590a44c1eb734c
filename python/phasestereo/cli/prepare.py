"""``phasestereo prepare`` and ``restore``: a pair for another matcher, and its map back."""

# No `from __future__ import annotations`: the command line is made of these annotations.

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

import phasestereo
from phasestereo.cli.errors import WRONG_USAGE, CommandError, claim, refusals, show_findings
from phasestereo.cli.terminal import print_json, print_lines
from phasestereo.io import read_disparity, write_disparity, write_image
from phasestereo.preparation import Restoration, Unit, prepare as prepare_pair
from phasestereo.rig.findings import untrusted, unwarned

_JSON = Parameter(name="--json", negative=(), show_default=False)


def prepare(
    left: Path,
    right: Path,
    /,
    *,
    output: Annotated[tuple[Path, Path] | None, Parameter(alias="-o")] = None,
    back: Path | None = None,
    max_disparity: int | None = None,
    num_disparities: int | None = None,
    min_disparity: int = 0,
    threads: int | None = None,
    as_json: Annotated[bool, _JSON] = False,
) -> None:
    """Prepare a pair for another matcher: rectified, rows aligned, equally sharp and bright.

    Prints what was done, one line each, and how many disparities the pair has, from 0 on. An image
    to which nothing has to be done is written as it came. For example:

    ```
    phasestereo prepare left.png right.png -o l.png r.png --back back.json
    network l.png r.png map.pfm
    phasestereo restore map.pfm --back back.json -o disparity.pfm
    ```

    Parameters
    ----------
    left
        Left image: PNG, JPEG, WebP, HEIF, PBM/PGM/PPM, BMP, TIFF, .npy or PFM; gray or color.
    right
        Right image; it may be of another size and type.
    output
        Files for the prepared images, left and right: .png, .tif, .npy or .pfm.
    back
        File for what `restore` needs (text).
    max_disparity
        The largest disparity, in pixels, that the other matcher can answer: images are cropped, and
        reduced, to fit it.
    num_disparities
        Number of disparities to search. Default: what is found.
    min_disparity
        Smallest disparity to search, with --num-disparities.
    threads
        Number of threads; without it, one for each processor.
    as_json
        Print one JSON object on standard output: done, num_disparities, findings, files.
    """
    if not (output or back or as_json):
        raise CommandError("nothing to do: give -o LEFT RIGHT, --back or --json", WRONG_USAGE)
    files = claim([*(("output", path) for path in output or ()), ("back", back)], [left, right])

    options = {"max_disparity", "num_disparities", "min_disparity", "threads"}
    with refusals(options=options), unwarned():
        pair = prepare_pair(
            left,
            right,
            max_disparity=max_disparity,
            num_disparities=num_disparities,
            min_disparity=min_disparity,
            threads=threads,
        )
    show_findings(untrusted(pair.findings))
    with refusals():
        for path, image in zip(output or (), (pair.left, pair.right), strict=False):
            write_image(path, image)
        if back is not None:
            pair.restoration.save(back)

    if as_json:
        record = {
            "version": phasestereo.__version__,
            "done": list(pair.done),
            "num_disparities": pair.num_disparities,
            "findings": [asdict(each) for each in pair.findings],
            "files": [str(path) for path in files],
        }
        print_json(record)
    else:
        searched = f"disparities from 0 to {pair.num_disparities - 1} px"
        print_lines([*(pair.done or ["nothing had to be done"]), searched])


def restore(
    disparity: Path,
    /,
    *,
    back: Path,
    output: Annotated[Path, Parameter(alias="-o")],
    unit: Unit | None = None,
) -> None:
    """Bring a map of a prepared pair back into the left image as it came.

    For example:

    ```
    phasestereo restore map.pfm --back back.json -o disparity.pfm
    ```

    Parameters
    ----------
    disparity
        The map of the prepared left image, in pixels: .pfm, .npy or .tif, or .png as KITTI has it
        (16 bits, 256 d). What is not finite is missing. It may be of a smaller or larger size, in
        pixels of its own.
    back
        What `prepare` has written.
    output
        The map to write: .pfm, .npy, .tif, or .png as KITTI has it.
    unit
        What 1 stands for: pixels, or sixteenths of a pixel as OpenCV's matchers return them, of
        which negative ones are missing.
    """
    claim([("output", output)], [disparity, back])
    with refusals():
        found = Restoration.load(back).restore(read_disparity(disparity), unit=unit)
        write_disparity(output, found)
    known = float(np.isfinite(found).mean())
    print_lines([f"{known:.1%} of the pixels have a disparity"])

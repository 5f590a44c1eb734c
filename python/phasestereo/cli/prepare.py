"""``phasestereo prepare`` and ``restore``: prepare a pair for another matcher, restore its map."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

import phasestereo
from phasestereo.cli.errors import WRONG_USAGE, CommandError, claim, refusals, show_findings
from phasestereo.cli.options import Threads
from phasestereo.cli.rehearsing import rehearse, rehearse_images
from phasestereo.cli.terminal import print_json, print_lines
from phasestereo.io import read_disparity, write_disparity, write_image
from phasestereo.io.disparity import read_sixteenths
from phasestereo.io.views import read_view
from phasestereo.preparation import Restoration, Unit, prepare as prepare_pair
from phasestereo.rig.findings import unwarned

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
    threads: Threads = None,
    as_json: Annotated[bool, _JSON] = False,
) -> None:
    """Prepare a pair for another matcher: rectified, rows aligned, equally sharp and bright.

    Prints one line per change, and the number of disparities of the pair, from 0 on. Writes an
    unchanged image as it came. For example:

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
        Right image; may differ in size and type.
    output
        Files for the prepared images, left and right: .png, .tif, .npy or .pfm.
    back
        File for the data that `restore` needs (text).
    max_disparity
        The largest disparity, in pixels, that the other matcher can return: images are cropped and
        reduced to fit.
    num_disparities
        Number of disparities to search. Default: found in the images.
    min_disparity
        Smallest disparity to search, with --num-disparities.
    threads
        Number of threads; default: one per processor.
    as_json
        Print one JSON object on standard output: done, num_disparities, findings, files.
    """
    if not (output or back or as_json):
        raise CommandError("nothing to do: give -o LEFT RIGHT, --back or --json", WRONG_USAGE)
    files = claim([*(("output", path) for path in output or ()), ("back", back)], [left, right])

    options = {"max_disparity", "num_disparities", "min_disparity", "threads"}
    with refusals(options=options), unwarned():
        views = read_view(left), read_view(right)
        dtype = views[0].image.dtype  # of both prepared images
        blank = [np.zeros_like(view.image[:1, :1], dtype) for view in views]
        rehearse_images("output", output, blank)
        pair = prepare_pair(
            views[0].image,
            views[1].image,
            left_mask=views[0].mask,
            right_mask=views[1].mask,
            max_disparity=max_disparity,
            num_disparities=num_disparities,
            min_disparity=min_disparity,
            threads=threads,
        )
    show_findings(one for one in pair.findings if one.severity == "warning")
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
    """Bring a map of a prepared pair back to the original left image.

    For example:

    ```
    phasestereo restore map.pfm --back back.json -o disparity.pfm
    ```

    Parameters
    ----------
    disparity
        The map of the prepared left image, in pixels: .pfm, .npy or .tif, or .png in KITTI's format
        (16 bits, 256 d). Non-finite values are missing. The map may be smaller or larger than the
        image, in its own pixels.
    back
        The file that `prepare` wrote.
    output
        The map to write: .pfm, .npy, .tif, or .png in KITTI's format.
    unit
        Unit of the values: pixels, or sixteenths of a pixel, as OpenCV's matchers return them, with
        negative values missing. Sixteenths may be 16-bit integers: .npy, .tif or .png.
    """
    claim([("output", output)], [disparity, back])
    blank = np.zeros((1, 1), np.float32)
    rehearse("output", output, write_disparity, blank)
    with refusals():
        read = read_sixteenths if unit == "sixteenths" else read_disparity
        found = Restoration.load(back).restore(read(disparity), unit=unit)
        write_disparity(output, found)
    known = float(np.isfinite(found).mean())
    print_lines([f"{known:.1%} of the pixels have a disparity"])

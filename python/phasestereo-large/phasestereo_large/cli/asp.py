"""``phasestereo asp``: the matcher that the Ames Stereo Pipeline calls for each tile."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

from dataclasses import fields
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Group, Parameter
from numpy.typing import NDArray

from phasestereo._images import Mask
from phasestereo.cli.errors import claim, refusals, show_findings, wrong
from phasestereo.cli.options import PRESET_HELP, REASONABLE, SETTINGS_HELP, Overrides, Threads
from phasestereo.matching import match
from phasestereo.result import Result
from phasestereo.rig.findings import unwarned
from phasestereo.settings import PRESET, Settings, resolve
from phasestereo_large.geotiff import read_geotiff_pair, write_geotiff

_OPTIONS = frozenset(["preset", "threads"]).union(field.name for field in fields(Settings))
_UNASKED = {"fill": False, "self_rectify": False}
"""The pipeline fills gaps itself, and its tiles are rectified: other rows would mislead it."""

_SEARCH = Group.create_ordered("Search")
_SETTINGS = Group.create_ordered("Expert settings", help=SETTINGS_HELP)
_Bound = Annotated[int | None, Parameter(group=_SEARCH, validator=REASONABLE)]


def asp(
    left: Path,
    right: Path,
    output: Path,
    /,
    *,
    minimum: Annotated[_Bound, Parameter(alias="-r")] = None,
    maximum: Annotated[_Bound, Parameter(alias="-R")] = None,
    preset: Annotated[str, Parameter(group=_SEARCH, help=PRESET_HELP)] = PRESET,
    threads: Annotated[Threads, Parameter(group=_SEARCH)] = None,
    overrides: Annotated[Overrides | None, Parameter(name="*", group=_SETTINGS)] = None,
) -> None:
    """Match a tile of the Ames Stereo Pipeline, which calls this command.

    Left column x corresponds to right column x + d: disparities have the pipeline's sign, which
    differs from the sign in the other commands. For example:

    ```
    phasestereo asp -r -40 -R 8 left.tif right.tif disparity.tif
    ```

    Parameters
    ----------
    left
        Left image, a TIFF file; NaN and its "no data" value mark pixels without data.
    right
        Right image of the same size.
    output
        TIFF file for the disparities, 32-bit floats, as large as the images; NaN without a
        disparity.
    minimum
        The smallest disparity to search; needs --maximum. Without both, the command finds the
        range.
    maximum
        The largest disparity to search.
    threads
        Number of threads; without it, one per processor.
    """
    claim([("output", output)], [left, right])
    with refusals(options=_OPTIONS), unwarned():
        settings = resolve(preset, None, _UNASKED | (overrides or {}))
        low, count = _range(minimum, maximum)
        pair = read_geotiff_pair(left, right)
        masks = [
            np.ones(view.image.shape[:2], np.bool_) if view.mask is None else view.mask
            for view in pair
        ]
        result = match(
            pair[0].image,
            pair[1].image,
            left_mask=masks[0],
            right_mask=masks[1],
            min_disparity=low,
            num_disparities=count,
            settings=settings,
            threads=threads,
        )
        write_geotiff(output, _disparities(result, *masks), like=pair[0])
    show_findings(result.findings)


def _range(minimum: int | None, maximum: int | None) -> tuple[int, int | None]:
    """Return the smallest disparity and the number of disparities, with our sign."""
    if minimum is None and maximum is None:
        return 0, None
    if minimum is None or maximum is None or minimum > maximum:
        raise wrong(
            "minimum",
            f"got {minimum} with --maximum {maximum}; accepts both, the smaller one first, "
            "or neither",
        )
    return -maximum, maximum - minimum + 1


def _disparities(result: Result, left: Mask, right: Mask) -> NDArray[np.float32]:
    """Return right minus left columns, NaN where either pixel has no data."""
    found = result.disparity
    rows, columns = np.indices(found.shape)
    with np.errstate(invalid="ignore"):  # NaN is not a column
        partners = np.nan_to_num(columns - np.rint(found), nan=-1).astype(np.int64)
    inside = left & (partners >= 0) & (partners < found.shape[1])
    inside &= right[rows, np.clip(partners, 0, found.shape[1] - 1)]
    return np.where(inside, -found, np.float32(np.nan))

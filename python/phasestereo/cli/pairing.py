"""Get the two views of a pair: from two files or one, rectified or not."""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from numpy.typing import NDArray

from phasestereo._images import join_masks
from phasestereo.cli.errors import refuse_picture, wrong
from phasestereo.io.image import read_mask
from phasestereo.io.pair import Layout, read_photograph
from phasestereo.io.views import View, read_views
from phasestereo.rectification import Rectification, rectify

AUTO = "auto"
OPTIONS = frozenset(["layout", "rectify", "vertical"])

Views = tuple[View, View]
Masks = tuple[NDArray[Any] | None, NDArray[Any] | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Pairing:
    """The options for the source of both views.

    Parameters
    ----------
    layout
        How one file, LEFT alone, holds both views. With top-bottom the left view is above; with
        half-, each view is squeezed to half its size; an anaglyph has the left view in red. MPO
        files and spatial photographs (HEIC) have two pictures and need no layout.
    rectify
        Rectify the pair first, with a calibration, or auto: from its images. A saved rectification
        counts as a calibration. Give files of both cameras as --rectify left.yaml --rectify
        right.yaml. Needs the extra ``rectify``.
    vertical
        The right camera is below the left one. LEFT is the upper image, and disparities are along
        columns. Detected from a calibration, or from images that show it clearly, unless
        --no-vertical.
    """

    layout: Layout | None = None
    rectify: Annotated[tuple[str, ...], Parameter(show_default=False)] = ()
    vertical: Annotated[bool | None, Parameter(show_default=False)] = None

    def straight(
        self, views: Views, masks: Masks = (None, None)
    ) -> "tuple[Views, Rectification | None]":
        """Return the views with their masks, rectified if requested.

        Raises
        ------
        OSError, TypeError, ValueError, ImportError
            As `phasestereo.rectify`.
        """
        # A mask of the user and the mask of a GeoTIFF file both count.
        left_mask, right_mask = (
            join_masks(mask, view.mask) for mask, view in zip(masks, views, strict=True)
        )
        if not self.rectify:
            left, right = views
            return (
                View(left.image, left_mask, left.place, left.focal),
                View(right.image, right_mask, right.place, right.focal),
            ), None

        found = rectify(
            views[0].image,
            views[1].image,
            as_calibration(self.rectify),
            left_mask=left_mask,
            right_mask=right_mask,
        )
        return (View(found.left, found.left_mask), View(found.right, found.right_mask)), found

    def sources(self) -> list[Path]:
        """Return the files to read for it."""
        return [] if self.rectify == (AUTO,) else [Path(name) for name in self.rectify]


def read_masks(left: Path | None, right: Path | None) -> Masks:
    """Return the masks in files; None: no file.

    Raises
    ------
    OSError, ValueError
        As `read_mask`.
    CommandError
        If a mask has no valid pixel: nothing could be matched.
    """
    masks = read_mask(left), read_mask(right)
    for name, path, mask in zip(("left_mask", "right_mask"), (left, right), masks, strict=True):
        if mask is not None and not mask.any():
            raise wrong(name, f"got no valid pixel in {path}; accepts an image with some above 0")
    return masks


def as_calibration(names: Sequence[str]) -> Sequence[str] | None:
    """Return the calibration that command-line words mean; None: rectify from the images alone.

    Raises
    ------
    CommandError
        If they name no calibration, or a picture.
    """
    if list(names) == [AUTO]:
        return None

    if AUTO in names or len(names) > 2:
        given = " ".join(names)
        raise wrong("rectify", f"got {given}; accepts auto, a file, or the files of both cameras")

    for name in names:
        refuse_picture("rectify", name)
    return names


def read_both(
    left: Path,
    right: Path | None,
    *,
    layout: Layout | None,
    bands: tuple[int, ...] | None = None,
) -> Views:
    """Read both views, from two files or from one."""
    if right is not None:
        if layout is not None:
            raise wrong("layout", "has no effect beside RIGHT")
        return read_views(left, right, bands)

    if bands is not None:
        raise wrong("bands", "has no effect without RIGHT")

    found = read_photograph(left, layout)
    return View(found.left, focal=found.focal), View(found.right, focal=found.focal)


def names_of(left: Path, right: Path | None) -> tuple[str, str]:
    """Return the names of the views."""
    if right is not None:
        return left.name, right.name
    return f"{left.name} (left)", f"{left.name} (right)"

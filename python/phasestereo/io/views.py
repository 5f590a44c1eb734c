"""The images of a pair as read from files: pixels, masks of valid ones, and georeferences."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from phasestereo._images import Mask
from phasestereo.io import read_image
from phasestereo.io.files import StrPath
from phasestereo.io.tiff import geotiff, is_geotiff


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One image of a pair.

    Parameters
    ----------
    image
        As `phasestereo.match` takes it.
    mask
        bool (H, W), True = valid; None: all.
    place
        Its georeference, a `phasestereo_large.geotiff.Georeference`; None: the file has none.
    focal
        Focal length in pixels from the file; None: unknown.
    """

    image: NDArray[Any]
    mask: Mask | None = None
    place: Any = None
    focal: float | None = None


def read_views(left: Path, right: Path, bands: tuple[int, ...] | None = None) -> tuple[View, View]:
    """Read both images; GeoTIFF files with their masks and georeferences.

    Parameters
    ----------
    left, right
        The files.
    bands
        The bands of GeoTIFF files to read, as `read_geotiff` takes them.

    Raises
    ------
    OSError, TypeError, ValueError, ImportError
        As `phasestereo.io.read_image`, and `phasestereo_large.geotiff.read_geotiff_pair`.
    """
    paths = left, right
    if bands is None and not all(is_geotiff(path) for path in paths):
        found = [read_view(path) for path in paths]
        return found[0], found[1]

    pair = [_read_geotiff(path, bands) for path in paths]
    geotiff().check_pair(pair[0], pair[1], names=(os.fspath(left), os.fspath(right)))
    return _as_view(pair[0]), _as_view(pair[1])


def read_view(path: StrPath) -> View:
    """Read an image; a GeoTIFF file with its mask and georeference.

    Raises
    ------
    OSError, TypeError, ValueError, ImportError
        As `phasestereo.io.read_image`, and `phasestereo_large.geotiff.read_geotiff`.
    """
    return _as_view(_read_geotiff(path)) if is_geotiff(path) else View(read_image(path))


def _read_geotiff(path: StrPath, bands: tuple[int, ...] | None = None) -> Any:
    """Read a GeoTIFF file; if packages are missing, say why other readers will not do."""
    try:
        return geotiff().read_geotiff(path, bands=bands)
    except ImportError as error:
        raise ImportError(f"{path} is a GeoTIFF, whose masks and place count: {error}") from error


def _as_view(found: Any) -> View:
    return View(found.image, found.mask, found.georeference)

"""The maps of a result in files: one file each, or all in a ``.npz``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo._images import as_array
from phasestereo._numbers import check_type
from phasestereo.io.disparity import write_disparity
from phasestereo.io.drafts import replacing
from phasestereo.io.files import StrPath, suffix
from phasestereo.io.image import write_image
from phasestereo.io.maps import write_floats
from phasestereo.io.tiff import geotiff


def write_maps(path: StrPath, maps: Mapping[str, NDArray[Any]]) -> None:
    """Write maps, such as `phasestereo.Result.maps`, as one file of arrays by name.

    Parameters
    ----------
    path
        The file, ``.npz``, as `numpy.load` reads it; an existing one is replaced once the new one
        is complete.
    maps
        Arrays by name; they are written to the bit.

    Raises
    ------
    TypeError
        If it is not a mapping, or a value is not an array of numbers.
    ValueError
        If the suffix is wrong.
    OSError
        If the file cannot be written.
    """
    if suffix(path) != ".npz":
        raise ValueError(f"path of several maps must end in .npz, got {suffix(path)!r}")
    check_type("maps", maps, Mapping, "arrays by name, as Result.maps has them")
    for name, values in maps.items():
        if as_array(values, name).dtype.kind not in "biuf":
            raise TypeError(f"{name}: got dtype {values.dtype}; accepts numbers")

    with replacing(path) as file:
        named: dict[str, Any] = dict(maps)
        np.savez(file, **named)


def write_map(path: Path, name: str, values: NDArray[Any], place: Any = None) -> None:
    """Write one map of a result in the format that the suffix names.

    Parameters
    ----------
    path
        The file: for floats ``.pfm``, ``.npy``, ``.tif``, and ``.png`` for disparities; for flags
        ``.npy``, ``.tif``, ``.png``.
    name
        The name of the map: "disparity" or one of `phasestereo.result.LAYERS`.
    values
        The map.
    place
        Its georeference, as in `View.place`, which a TIFF keeps; None: unknown.

    Raises
    ------
    ValueError
        If the format cannot hold it.
    OSError
        If the file cannot be written.
    """
    if place is not None and suffix(path) in (".tif", ".tiff"):
        geotiff().write_geotiff(path, {name: values}, like=place)
    elif name == "disparity":
        write_disparity(path, values)
    elif values.dtype == np.float32:
        write_floats(path, values)
    else:
        write_image(path, values)

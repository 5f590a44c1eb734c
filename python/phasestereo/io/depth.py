"""Depth maps: 16-bit PNG, as in RGB-D data sets, or floats."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from phasestereo._numbers import as_number
from phasestereo.io.colmap import COLMAP, read_colmap, write_colmap
from phasestereo.io.files import StrPath
from phasestereo.io.image import write_image
from phasestereo.io.maps import check_map, known_suffix, read_stored, write_floats

LengthUnit: TypeAlias = Literal["mm", "cm", "m"]
"""A unit of length."""

MILLIMETERS = 1000.0
"""Default units of a ``.png`` per meter."""

FARTHEST = 65535.5
"""Units of a ``.png`` at which its range ends: the first value to round to 65536."""

_PER_METER: dict[str, float] = {"mm": 1000, "cm": 100, "m": 1}
_PNG_START = 0.5


def read_depth(
    path: StrPath, *, unit: LengthUnit = "mm", depth_scale: float = MILLIMETERS
) -> NDArray[np.float32]:
    """Read a depth map in the format that the suffix names.

    Parameters
    ----------
    path
        A ``.png`` file of uint16, 0 for "no depth"; a ``.pfm``, ``.npy``, ``.tif`` or ``.tiff``
        file of floats, in which anything not finite or not positive is "no depth"; or a ``.bin``
        of COLMAP.
    unit
        The unit of the returned depths. It matters only for ``.png``: floats are returned as
        stored, in whatever unit that is.
    depth_scale
        Units of a ``.png`` per meter, more than 0: 1000 for millimeters, 256 for KITTI, 5000 for
        TUM.

    Returns
    -------
    ndarray
        float32, shape (H, W); NaN where there is no depth.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If the suffix or the unit is unknown, or the file is damaged or does not hold such a map.
    ImportError
        If the format needs the extra ``io`` and that is not installed.
    """
    scale = _scale(unit, depth_scale)
    is_colmap = known_suffix(path, "depth", COLMAP) == COLMAP
    stored = read_colmap(path) if is_colmap else read_stored(path, "depth")

    known = np.isfinite(stored) & (stored > 0)
    if stored.dtype == np.uint16:
        stored = (stored / scale).astype(np.float32)

    return np.where(known, stored, np.float32(np.nan))


def write_depth(
    path: StrPath,
    depth: NDArray[np.floating[Any]],
    *,
    unit: LengthUnit | None = None,
    depth_scale: float = MILLIMETERS,
) -> None:
    """Write a depth map in the format that the suffix names; see `read_depth`.

    Parameters
    ----------
    path
        The file; an existing one is replaced once the new one is complete.
    depth
        float32 or float64 (rounded to float32), shape (H, W), positive; NaN elsewhere.
    unit
        The unit of the depths, as in `Calibration.unit`. A ``.png`` needs it; floats are written as
        they are.
    depth_scale
        Units of a ``.png`` per meter, more than 0; 1000 means millimeters. It holds whole units, 1
        to 65535: depths are rounded; those below half a unit and from 65535.5 units on become 0,
        "no depth", as depth cameras mark depths out of range. This limit is 65.5 m at 1000
        (millimeters), 256 m at 256 (KITTI) and 13.1 m at 5000 (TUM); the other formats hold any
        depth.

    Raises
    ------
    TypeError
        If the map is not an array of float32 or float64.
    ValueError
        If its shape is not (H, W), it holds infinities or depths <= 0, the suffix or the unit is
        unknown, a ``.png`` gets no unit, or no depth is in its range.
    OSError
        If the file cannot be written.
    ImportError
        If the format needs the extra ``io`` and that is not installed.
    """
    ending = known_suffix(path, "depth", COLMAP)
    if unit is None and ending == ".png":
        raise ValueError(
            "unit: got None for a .png, which holds lengths; accepts mm, cm or m, the unit of the "
            "depths"
        )
    scale = _scale(unit or "m", depth_scale)
    checked = check_map(depth, "depth")

    if (checked <= 0).any():  # false for NaN
        raise ValueError(
            f"depth must be positive, or NaN for no depth; got {checked[checked <= 0].min():g}"
        )

    if ending == ".png":
        write_image(path, _encode(checked * np.float64(scale), depth_scale))
    elif ending == COLMAP:
        write_colmap(path, np.nan_to_num(checked))
    else:
        write_floats(path, checked)


def _encode(depth: NDArray[np.float64], per_meter: float) -> NDArray[np.uint16]:
    """Round to whole units, halves up; NaN and values out of range become 0."""
    held = (depth >= _PNG_START) & (depth < FARTHEST)
    known = depth[~np.isnan(depth)]
    if known.size and not held.any():
        raise ValueError(
            f"depth must lie in [{_PNG_START / per_meter:g}, {FARTHEST / per_meter:g}) m for a "
            f"16-bit .png of {per_meter:g} units a meter, but all of it is from "
            f"{known.min() / per_meter:g} to {known.max() / per_meter:g} m: is the unit right? "
            "A .tif holds any depth"
        )

    return np.floor(np.where(held, depth, 0) + 0.5).astype(np.uint16)


def meters_in(unit: str) -> float:
    """Return the meters in a unit.

    Raises
    ------
    ValueError
        If it is unknown.
    """
    return _scale(unit, 1.0)


def _scale(unit: str, depth_scale: float) -> float:
    """Return the units of a ``.png`` in a unit of length."""
    if unit not in _PER_METER:
        raise ValueError(f"unit must be one of {', '.join(get_args(LengthUnit))}, got {unit!r}")
    return as_number("depth_scale", depth_scale, positive=True) / _PER_METER[unit]

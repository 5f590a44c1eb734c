"""Depth maps: whole millimetres in a 16-bit PNG, as RGB-D data sets have them, or floats."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from phasestereo.io.files import StrPath
from phasestereo.io.image import write_image
from phasestereo.io.maps import check_map, known_suffix, read_stored, write_floats

LengthUnit: TypeAlias = Literal["mm", "cm", "m"]
"""A unit of length."""

_MILLIMETRES: dict[str, float] = {"mm": 1, "cm": 10, "m": 1000}
_PNG_END = 65535.5  # mm; the first depth to round to 65536
_PNG_START = 0.5


def read_depth(path: StrPath, *, unit: LengthUnit = "mm") -> NDArray[np.float32]:
    """Read a depth map in the format that the suffix names.

    Parameters
    ----------
    path
        A ``.png`` file of uint16 millimetres, 0 for "no depth"; or a ``.pfm``, ``.npy``, ``.tif``
        or ``.tiff`` file of floats, in which anything not finite or not positive is "no depth".
    unit
        The unit of the depths that are returned. It matters for ``.png`` alone: floats come as
        they are stored, in whatever unit that is.

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
    scale = _scale(unit)
    stored = read_stored(path, "depth")

    known = np.isfinite(stored) & (stored > 0)
    if stored.dtype == np.uint16:
        stored = (stored / scale).astype(np.float32)

    return np.where(known, stored, np.float32(np.nan))


def write_depth(
    path: StrPath, depth: NDArray[np.floating[Any]], *, unit: LengthUnit = "mm"
) -> None:
    """Write a depth map in the format that the suffix names; see `read_depth`.

    Parameters
    ----------
    path
        The file; an existing one is replaced, and only once the new one is complete.
    depth
        float32 or float64 (rounded to float32), shape (H, W), positive; NaN where there is none.
    unit
        The unit of the depths. It matters for ``.png`` alone, which holds whole millimetres from 1
        to 65535: depths are rounded to them, and those below 0.5 mm and from 65.5355 m on become 0,
        "no depth", as depth cameras do with what is out of their range. Floats are written as they
        are.

    Raises
    ------
    TypeError
        If the map is not an array of float32 or float64.
    ValueError
        If its shape is not (H, W), it holds infinities or depths <= 0, the suffix or the unit is
        unknown, or not a single one of the depths is in the range of a ``.png``.
    OSError
        If the file cannot be written.
    ImportError
        If the format needs the extra ``io`` and that is not installed.
    """
    ending = known_suffix(path, "depth")
    scale = _scale(unit)
    checked = check_map(depth, "depth")

    if (checked <= 0).any():  # false for NaN
        raise ValueError(
            f"depth must be positive, or NaN for no depth; got {checked[checked <= 0].min():g}"
        )

    if ending == ".png":
        write_image(path, _encode_millimetres(checked * np.float64(scale)))
    else:
        write_floats(path, checked)


def _encode_millimetres(depth: NDArray[np.float64]) -> NDArray[np.uint16]:
    """Round to whole millimetres, halves up; 0 for NaN and for what is out of range."""
    held = (depth >= _PNG_START) & (depth < _PNG_END)
    known = depth[~np.isnan(depth)]
    if known.size and not held.any():
        raise ValueError(
            f"depth must lie in [{_PNG_START:g}, {_PNG_END:g}) mm for a 16-bit .png, but all of it "
            f"is from {known.min():g} to {known.max():g} mm: is the unit right? "
            "A .tif holds any depth"
        )

    return np.floor(np.where(held, depth, 0) + 0.5).astype(np.uint16)


def _scale(unit: str) -> float:
    """Return the millimetres in a unit."""
    if unit not in _MILLIMETRES:
        raise ValueError(f"unit must be one of {', '.join(get_args(LengthUnit))}, got {unit!r}")
    return _MILLIMETRES[unit]

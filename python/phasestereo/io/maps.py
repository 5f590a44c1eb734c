"""Common parts of disparity and depth maps: float32 with NaN in memory, and their formats."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo._images import as_numbers
from phasestereo.io.files import StrPath, suffix
from phasestereo.io.image import read_samples, write_image
from phasestereo.io.pixels import channels

FLOAT_SUFFIXES = (".pfm", ".npy", ".tif", ".tiff")
_SUFFIXES = (*FLOAT_SUFFIXES, ".png")
_DTYPES = ("uint8", "uint16", "int16", "float32")


def known_suffix(path: StrPath, name: str, *more: str) -> str:
    """Return the suffix of a map's path, if it is a map format or one of `more`."""
    ending, known = suffix(path), (*_SUFFIXES, *more)
    if ending not in known:
        raise ValueError(
            f"path of a {name} map must end in one of {', '.join(known)}, got {ending!r}"
        )
    return ending


def check_map(values: NDArray[np.floating[Any]], name: str) -> NDArray[np.float32]:
    """Return a map as float32, if it is valid."""
    given = as_numbers(values, name, ("float32", "float64"))
    with np.errstate(over="ignore"):  # overflows are refused as infinite
        checked = given.astype(np.float32)
    if np.isinf(checked).any():
        what = "estimate" if name == "disparity" else name
        raise ValueError(f"{name} must be finite in float32, or NaN for no {what}; got inf")
    return checked


def read_stored(
    path: StrPath,
    name: str,
    *,
    dtypes: Sequence[str] = (),
    hints: Mapping[str, str] = MappingProxyType({}),
) -> NDArray[Any]:
    """Read a map as it is stored.

    Parameters
    ----------
    path
        The file.
    name
        What it maps, for messages.
    dtypes
        The accepted dtypes. Default: uint16 from a PNG, else float32.
    hints
        What messages add for other dtypes.

    Raises
    ------
    ValueError
        If the suffix is unknown, or the file is damaged or does not hold a map.
    """
    ending = known_suffix(path, name)
    stored = read_samples(path, _DTYPES)
    accepted = dtypes or (("uint16",) if ending == ".png" else ("float32",))

    if channels(stored.shape) != 1 or stored.dtype.name not in accepted:
        raise ValueError(
            f"{os.fspath(path)}: a {name} map in {ending} is {' or '.join(accepted)} of shape "
            f"(H, W), this is {stored.dtype} of shape {stored.shape}"
            f"{hints.get(stored.dtype.name, '')}"
        )
    return stored


def write_floats(path: StrPath, values: NDArray[np.float32]) -> None:
    """Write a map in one of the formats of `FLOAT_SUFFIXES`; NaN is +inf in a PFM file."""
    if suffix(path) == ".pfm":
        values = np.where(np.isnan(values), np.float32(np.inf), values)
    write_image(path, values)

"""Disparity maps: NaN for "no estimate" in memory, the mark of each format in its files."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo._numbers import as_integer, as_number
from phasestereo.io.files import StrPath
from phasestereo.io.image import read_image, write_image
from phasestereo.io.maps import FLOAT_SUFFIXES, check_map, known_suffix, read_stored, write_floats
from phasestereo.io.pixels import channels

_HINTS = {
    "int16": " (restore takes OpenCV's sixteenths of a pixel by their unit)",
    "uint8": " (read_truth reads gray-coded maps of any scale)",
}
_KITTI_SCALE = 256
_KITTI_END = 65535.5 / _KITTI_SCALE  # the first value to round to 65536


def read_disparity(path: StrPath) -> NDArray[np.float32]:
    """Read a disparity map in the format that the suffix names.

    Parameters
    ----------
    path
        A ``.pfm``, ``.npy``, ``.tif`` or ``.tiff`` file of floating-point disparities, in which
        anything not finite is "no estimate" (PFM: +inf by convention); or a ``.png`` file in
        KITTI's coding [1]_, uint16 = 256 d, 0 for "no estimate".

    Returns
    -------
    ndarray
        float32, shape (H, W), pixels; NaN where there is no estimate.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If the suffix is unknown, or the file is damaged or does not hold such a map.
    ImportError
        If the format needs the extra ``io`` and that is not installed.

    See Also
    --------
    read_truth : Gray-coded ground truth with another scale.

    References
    ----------
    .. [1] M. Menze, A. Geiger, Object scene flow for autonomous vehicles, CVPR 2015; the stereo
       development kit, https://www.cvlibs.net/datasets/kitti/eval_scene_flow.php
    """
    stored = read_stored(path, "disparity", hints=_HINTS)
    if stored.dtype == np.uint16:
        return _decode_gray(stored, scale=_KITTI_SCALE, unknown=0)
    return np.where(np.isfinite(stored), stored, np.float32(np.nan))


def read_sixteenths(path: StrPath) -> NDArray[Any]:
    """Read a map of sixteenths of a pixel as it is stored: int16, as OpenCV's, uint16 or float32.

    Raises
    ------
    OSError, ValueError, ImportError
        As `read_disparity`.
    """
    return read_stored(path, "disparity", dtypes=("int16", "uint16", "float32"))


def write_disparity(path: StrPath, disparity: NDArray[np.floating[Any]]) -> None:
    """Write a disparity map in the format that the suffix names; see `read_disparity`.

    Parameters
    ----------
    path
        The file; an existing one is replaced once the new one is complete.
    disparity
        float32 or float64 (rounded to float32), shape (H, W), pixels; NaN where there is no
        estimate. A ``.png`` keeps them to 1/512 pixel; they must lie in [0, 65535.5/256), and those
        below 1/512 become 1/256, as in KITTI's own writer, since 0 means "no estimate".

    Raises
    ------
    TypeError
        If the map is not an array of float32 or float64.
    ValueError
        If its shape is not (H, W), it holds infinities, the suffix is unknown, or a disparity
        cannot be represented in the format.
    OSError
        If the file cannot be written.
    ImportError
        If the format needs the extra ``io`` and that is not installed.
    """
    ending = known_suffix(path, "disparity")
    checked = check_map(disparity, "disparity")

    if ending == ".png":
        write_image(path, _encode_kitti(checked))
    else:
        write_floats(path, checked)


def read_truth(path: StrPath, *, scale: float, unknown: int | None = 0) -> NDArray[np.float32]:
    """Read gray-coded ground truth, as in Middlebury's data sets of 2001 to 2006.

    Parameters
    ----------
    path
        An image of uint8 or uint16 gray levels.
    scale
        Gray levels per pixel of disparity, greater than 0: 16 for tsukuba, 8 for venus, 4 for
        cones and teddy, 3 for the third-size scenes of 2005 and 2006.
    unknown
        The gray level that means "unknown"; None: no level does.

    Returns
    -------
    ndarray
        float32, shape (H, W), pixels: gray level / scale, NaN where unknown.

    Raises
    ------
    OSError
        If the file cannot be read.
    TypeError
        If scale is not a number or unknown not an integer.
    ValueError
        If scale is not positive and finite, unknown is not a gray level, or the file is not a gray
        image of integers (`read_disparity` reads PFM and KITTI's PNG).
    ImportError
        If the format needs the extra ``io`` and that is not installed.
    """
    as_number("scale", scale, positive=True)
    if unknown is not None:
        as_integer("unknown", unknown, least=0, most=np.iinfo(np.uint16).max)

    stored = read_image(path)
    if channels(stored.shape) != 1 or stored.dtype == np.float32:
        raise ValueError(
            f"{os.fspath(path)}: gray-coded ground truth is uint8 or uint16 of shape (H, W), "
            f"this is {stored.dtype} of shape {stored.shape} (read_disparity reads float maps)"
        )

    return _decode_gray(stored, scale=scale, unknown=unknown)


def _encode_kitti(disparity: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Code a map as round(256 d), halves up and at least 1, and NaN as 0."""
    known = ~np.isnan(disparity)
    outside = known & ~((disparity >= 0) & (disparity < _KITTI_END))
    if outside.any():
        low, high = disparity[known].min(), disparity[known].max()
        raise ValueError(
            f"disparity must lie in [0, 65535.5/256) for a 16-bit .png; "
            f"{np.count_nonzero(outside)} values do not (the map spans {low:g} to {high:g}): "
            f"write {', '.join(FLOAT_SUFFIXES)} instead"
        )

    codes = np.floor(np.where(known, disparity, 0) * np.float64(_KITTI_SCALE) + 0.5)
    return np.where(known, np.maximum(codes, 1), 0).astype(np.uint16)


def _decode_gray(stored: NDArray[Any], *, scale: float, unknown: int | None) -> NDArray[np.float32]:
    disparity = (stored / np.float64(scale)).astype(np.float32)
    if unknown is not None:
        disparity[stored == unknown] = np.nan
    return disparity

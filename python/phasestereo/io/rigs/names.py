"""Map the names that people give matrices to OpenCV's."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from itertools import product
from typing import Any

import numpy as np

from phasestereo._extras import require
from phasestereo.io.depth import LengthUnit
from phasestereo.io.rigs.cameras import MAPS, Cameras, Matrix
from phasestereo.io.rigs.documents import ACCEPTED

_OF_PAIR = {
    "R": "r rot rotation rotmat rotmatrix rotationmatrix rotationofcamera2 stereor",
    "T": "t trans transvec translation translationvector translationvec translationofcamera2 "
    "stereot",
    "Q": "q qmatrix disptodepthmat disparitytodepth disparitytodepthmap dispartitytodepthmap",
}
_OF_CAMERA = {
    "K": "k m mtx cammat cammats cammtx cameramat cameramatrix intrinsic intrinsics "
    "intrinsicmatrix newcameramatrix",
    "D": "d dist distcoeff distcoeffs distcoef distcoefs distortion distortioncoeffs "
    "distortioncoefficients",
    "R": "r rect recttrans rectmat rectrot rectification rectificationmatrix",
    "P": "p proj projmat projmats projmatrix projection projectionmatrix",
}
_MAPS = ["map", "stereomap", "rectmap", "rectifymap", "undistmap", "undistortmap"]
_SIDES = {"1": ("1", "l", "left"), "2": ("2", "r", "right")}
_SIDES_FROM_0 = {"1": ("0",), "2": ("1",)}
_SHAPES = {"K": (3, 3), "R": (3, 3), "P": (3, 4), "Q": (4, 4)}
_LARGEST = 1e9  # in pixels, and in any unit of length for rigs
_FOCAL = 0.1, 1e7  # pixels
_ROTATION = 0.01  # largest difference of a number of R R^T from 1 or 0: files round theirs
_SHOWN = 6  # names of a file that is not a calibration
_COEFFICIENTS = (4, 5, 8, 12, 14)  # of distortion, that OpenCV knows


def _spellings(sides: Mapping[str, tuple[str, ...]]) -> Iterator[tuple[str, str]]:
    """Yield names as people write them, in small letters and digits alone, each with OpenCV's."""
    for number, words in sides.items():
        for word, (kind, stems) in product(words, _OF_CAMERA.items()):
            for stem in stems.split():
                yield stem + word, kind + number
                yield word + stem, kind + number
        for word, stem, axis in product(words, _MAPS, "xy"):
            name = f"map{number}{axis}"
            yield stem + word + axis, name
            yield stem + axis + word, name
            yield word + stem + axis, name
        for word in words:  # as StereoVision names them
            yield "undistortionmap" + word, f"map{number}x"
            yield "rectificationmap" + word, f"map{number}y"


_PAIR = {name: kind for kind, names in _OF_PAIR.items() for name in names.split()}
_FROM_1 = dict(_spellings(_SIDES)) | _PAIR
_FROM_0 = dict(_spellings(_SIDES_FROM_0)) | _PAIR


def as_cameras(
    arrays: Mapping[str, Any],
    *,
    size: tuple[int, int] | None = None,
    fisheye: bool = False,
    unit: LengthUnit | None = None,
) -> Cameras:
    """Return the camera pair from named matrices; skip names without a meaning.

    Parameters
    ----------
    arrays
        Matrices by any usual name: ``K1``, ``M1``, ``cameraMatrix1``, ``cam_mats_left`` ...
    size, fisheye, unit
        As those of `Cameras`.

    Raises
    ------
    ValueError
        If a matrix is given twice or is of another shape, or matrices are missing.
    """
    found: dict[str, Matrix] = {}
    for name, known in kinds_of(arrays).items():
        if known in found:
            raise ValueError(f"gives {known} twice, the second time as {name}")
        found[known] = _checked(known, arrays[name], fisheye=fisheye)
    if not found.keys() & {"K1", "K2", "map1x", "P1"}:
        some = ", ".join(map(str, list(arrays)[:_SHOWN])) or "nothing"
        raise ValueError(
            f"is not a calibration of two cameras: it holds {some}; accepts {ACCEPTED}"
        )
    return Cameras(matrices=_as_floats(found), size=size, fisheye=fisheye, unit=unit)


def kinds_of(names: Iterable[str]) -> dict[str, str]:
    """Return the meaning of each name that has one: ``K1``, ``R``, ``map2x``, ``Q`` ..."""
    plain = {name: re.sub(r"[^a-z0-9]", "", str(name).lower()) for name in names}
    # A name for a side 0 means that sides are counted from 0.
    from_0 = any(_FROM_0.get(name, "")[1:] == "1" for name in plain.values())
    known = _FROM_0 if from_0 else _FROM_1
    return {name: known[words] for name, words in plain.items() if words in known}


def _as_floats(found: dict[str, Matrix]) -> dict[str, Matrix]:
    """Return matrices with maps of fixed point (CV_16SC2) as maps of floats."""
    for side in "12":
        x, y = f"map{side}x", f"map{side}y"
        if x in found and found[x].ndim == 3:
            if y not in found or found[y].shape != found[x].shape[:2]:
                raise ValueError(f"{y}: {x} is of fixed point, and this is not its other part")
            cv2 = require("cv2", extra="rectify")
            parts = found[x].astype(np.int16), found[y].astype(np.uint16)
            found[x], found[y] = cv2.convertMaps(*parts, cv2.CV_32FC1)
    return found


def _checked(name: str, value: Any, *, fisheye: bool) -> Matrix:
    """Return a matrix in the shape that OpenCV takes, or refuse it."""
    matrix = _as_numbers(name, value)
    if name in MAPS:
        if matrix.ndim == 3 and matrix.shape[2] == 2 and name.endswith("x") and matrix.size:
            return matrix  # OpenCV's fixed point, see `_as_floats`
        if matrix.ndim != 2 or 0 in matrix.shape:
            raise ValueError(f"{name}: got shape {matrix.shape}; accepts (H, W)")
        return matrix

    if name[0] == "D":
        return _as_coefficients(name, matrix, fisheye=fisheye)

    # A rotation may be given as a vector, after Rodrigues.
    if name in ("R", "T") and matrix.size == 3:
        column = matrix.reshape(3, 1)
        return column if name == "T" else require("cv2", extra="rectify").Rodrigues(column)[0]

    if matrix.shape != (shape := _SHAPES.get(name[0], (3, 1))):
        raise ValueError(f"{name}: got shape {matrix.shape}; accepts {shape}")

    if name[0] == "R":
        check_rotation(name, matrix)
    if name[0] in "KP":
        _check_camera(name, matrix)
    return matrix


def _as_numbers(name: str, value: Any) -> Matrix:
    """Return an array of finite numbers of sizes that occur."""
    array = np.asarray(value)
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{name}: holds {array.dtype}; accepts numbers")

    matrix = array.astype(np.float64)
    if not np.isfinite(matrix).all():
        raise ValueError(f"{name}: holds a value that is not a finite number")
    if (size := np.abs(matrix).max(initial=0)) > _LARGEST:
        raise ValueError(f"{name}: got a number of size {size:g}; accepts {_LARGEST:g} at most")
    return matrix


def _as_coefficients(name: str, matrix: Matrix, *, fisheye: bool) -> Matrix:
    """Return coefficients of distortion as a column; without any, zeros."""
    allowed = (4,) if fisheye else _COEFFICIENTS
    if not matrix.size:
        return np.zeros((allowed[0], 1))
    if fisheye and not matrix.ravel()[4:].any():
        matrix = matrix.ravel()[:4]
    if matrix.size not in allowed or matrix.size != max(matrix.shape, default=0):
        raise ValueError(
            f"{name}: got shape {matrix.shape}; accepts {', '.join(map(str, allowed))} numbers"
        )
    return matrix.reshape(-1, 1)


def check_rotation(name: str, matrix: Matrix) -> None:
    """Refuse a 3 x 3 matrix that scales, shears or mirrors instead of rotating.

    Raises
    ------
    ValueError
        If R R^T is not the identity to 0.01, or the determinant is negative.
    """
    apart = np.abs(matrix @ matrix.T - np.eye(3)).max()
    if not apart <= _ROTATION:
        raise ValueError(
            f"{name}: is not a rotation: R R^T differs from the identity by {apart:.3g}; accepts "
            f"{_ROTATION} at most"
        )
    if np.linalg.det(matrix) < 0:
        raise ValueError(f"{name}: is a mirror, not a rotation: its determinant is negative")


def _check_camera(name: str, matrix: Matrix) -> None:
    """Refuse a camera matrix, or a projection, with impossible focal lengths."""
    focal, bottom = matrix[[0, 1], [0, 1]], matrix[2, :3]
    if not ((focal >= _FOCAL[0]) & (focal <= _FOCAL[1])).all():
        got = " and ".join(f"{each:g}" for each in focal)
        raise ValueError(
            f"{name}: got no positive focal lengths of a camera, but {got}; accepts {_FOCAL[0]:g} "
            f"to {_FOCAL[1]:g} pixels"
        )
    if tuple(bottom) != (0, 0, 1):
        got = " ".join(f"{each:g}" for each in bottom)
        raise ValueError(f"{name}: got the last row {got}; accepts 0 0 1 (is it transposed?)")

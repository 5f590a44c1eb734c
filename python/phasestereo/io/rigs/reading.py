"""Calibrations in any format: detect the kind of each file, and read its cameras."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias, get_args

import numpy as np

from phasestereo.io.calibration import Calibration, of_middlebury
from phasestereo.io.depth import LengthUnit
from phasestereo.io.files import StrPath
from phasestereo.io.rigs.cameras import Cameras
from phasestereo.io.rigs.documents import MIDDLEBURY, NUMBERS, Document, read_document
from phasestereo.io.rigs.makers import cameras_of_maker
from phasestereo.io.rigs.names import as_cameras, kinds_of
from phasestereo.io.rigs.singles import (
    FISHEYE,
    as_size,
    cameras_of_chain,
    cameras_of_pair,
    is_camera,
    is_chain,
)

CalibrationSource: TypeAlias = (
    "str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | Mapping[str, Any]"
)

_PAIRS = (
    ("cam0/sensor.yaml", "cam1/sensor.yaml"),
    ("left.yaml", "right.yaml"),
    ("left.yml", "right.yml"),
    ("intrinsics.yml", "extrinsics.yml"),
)
"""Files that a folder may hold."""

_SIZES = "imageSize", "image_size", "img_size", "resolution", "res1"
_Q_NUMBERS = 16
_SIDES = "image_width", "image_height"
_FAULTS = AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError
"""Errors of files of a known kind with missing or wrong content."""


def read_calibration(
    path: StrPath | Sequence[StrPath], size: tuple[int, int] | None = None
) -> Calibration:
    """Read the geometry of a rectified pair from a calibration of any kind.

    Parameters
    ----------
    path
        A file, a folder, or the files of both cameras, as `phasestereo.rectify` takes them:
        Middlebury's and KITTI's ``calib.txt``, FoundationStereo's ``K.txt``, OpenCV's, ROS's,
        Kalibr's, EuRoC's, ORB-SLAM's, OKVIS's, mrcal's, OAK's, ZED's, MATLAB's, COLMAP's,
        Metashape's. A file of raw cameras gives the geometry of the pairs that
        `phasestereo.rectify` makes with it.
    size
        Columns and rows of the images; None: from the file. A calibration of images of another
        size, but the same proportions, is scaled.

    Returns
    -------
    Calibration
        Its `unit` is m if the format defines one, mm for Middlebury's, and None if a format leaves
        it open.

    Raises
    ------
    OSError
        If a file cannot be read.
    ValueError
        If it holds no camera pair or no baseline, is for images of other proportions, or has no
        size and none is given.
    ImportError
        If the extra ``rectify`` is not installed, and the format needs it.

    Examples
    --------
    >>> calibration = ps.io.read_calibration("SN1267.conf", size=(1280, 720))
    >>> calibration.depth(result.disparity)  # m
    """
    return read_geometry(path, size)[0]


def read_geometry(
    path: StrPath | Sequence[StrPath], size: tuple[int, int] | None
) -> tuple[Calibration, tuple[str, ...]]:
    """Return `read_calibration`'s result and its assumptions, in sentences."""
    paths, documents = read_documents(path)
    name = named_all(paths)
    try:
        if len(documents) == 1 and MIDDLEBURY in documents[0]:
            return _of_middlebury(documents[0], size)
        if len(documents) == 1 and (q := _q_alone(documents[0])) is not None:
            if size is None:
                raise ValueError("size: got None for a matrix Q; accepts (columns, rows)")
            return Calibration.from_q(q, width=size[0], height=size[1]), ()
        return cameras_of(documents).geometry(size)
    except _FAULTS as error:
        raise ValueError(f"{name}: {_in_words(error)}") from error


def _q_alone(document: Document) -> Any:
    """Return OpenCV's matrix Q from a file without cameras; None: the file has none."""
    values = document.get(NUMBERS, ())
    if len(values) == _Q_NUMBERS:
        return np.reshape(values, (4, 4))
    kinds = kinds_of(document)
    has_cameras = {"K1", "map1x"} & {*kinds.values()}
    return None if has_cameras else next((document[n] for n, k in kinds.items() if k == "Q"), None)


def _of_middlebury(
    document: Document, size: tuple[int, int] | None
) -> tuple[Calibration, tuple[str, ...]]:
    found = of_middlebury(document[MIDDLEBURY])
    known = found.width, found.height
    if size in (None, known):
        return found, ()
    said = f"the calibration of {known[0]} x {known[1]} pixels is scaled to {size[0]} x {size[1]}"
    return found.scaled(*size), (said,)


def read_cameras(source: CalibrationSource) -> Cameras:
    """Return the camera pair of a calibration.

    Parameters
    ----------
    source
        A file or a folder; a pair of files, (left, right) or two that complete each other; or
        matrices by name.

    Raises
    ------
    TypeError
        If it is anything else.
    OSError
        If a file cannot be read.
    ValueError
        If it holds no camera pair.
    ImportError
        If the extra ``rectify`` is not installed.
    """
    if isinstance(source, Mapping):
        try:
            return _of_matrices(dict(source))
        except ValueError as error:
            raise ValueError(f"calibration: {error}") from error
    paths, documents = read_documents(source)
    return cameras_of_files(documents, named_all(paths))


def cameras_of_files(documents: list[Document], name: str) -> Cameras:
    """Return the camera pair in the contents of files; errors begin with their name.

    Raises
    ------
    ValueError
        If they hold no camera pair.
    """
    try:
        return cameras_of(documents)
    except _FAULTS as error:
        raise ValueError(f"{name}: {_in_words(error)}") from error


def _in_words(error: Exception) -> str:
    if isinstance(error, KeyError):
        return f"has no {error.args[0]}"
    return str(error) if isinstance(error, ValueError) else f"is damaged ({error})"


def read_documents(source: Any) -> tuple[list[str | os.PathLike[str]], list[Document]]:
    """Return the paths of the one or two files, and their contents by name.

    Raises
    ------
    TypeError, OSError, ValueError, ImportError
        As `read_cameras`.
    """
    paths = _paths(source)
    return paths, [read_document(path) for path in paths]


def named_all(paths: Sequence[StrPath]) -> str:
    """Return the names of files for errors."""
    return " and ".join(os.fspath(path) for path in paths)


def _paths(source: Any) -> list[str | os.PathLike[str]]:
    """Return the paths of the one or two files."""
    if isinstance(source, Sequence) and len(source) == 1:
        source = source[0]
    if isinstance(source, str | os.PathLike):
        folder = Path(source)
        for names in _PAIRS if folder.is_dir() else ():
            pair = [folder / name for name in names]
            if all(path.is_file() for path in pair):
                return list(pair)
        return [source]

    paths = list(source) if isinstance(source, Sequence) else []
    if not 1 <= len(paths) <= 2 or not all(isinstance(path, str | os.PathLike) for path in paths):
        raise TypeError(
            f"calibration: got {type(source).__name__}; accepts a path, a pair of paths (left, "
            "right), matrices by name, a Rectification, or None"
        )
    return paths


def cameras_of(documents: list[Document]) -> Cameras:
    """Return the camera pair in the contents of one or two files.

    Raises
    ------
    KeyError, TypeError, ValueError
        If they hold none.
    """
    single = [is_camera(document) or "lensmodel" in document for document in documents]
    if single == [True]:
        raise ValueError("holds one camera; give the files of both, left and right")
    if any(single) and not all(single):
        raise ValueError("one file holds a camera, and the other one does not")

    found = cameras_of_maker(documents)
    if found is not None:
        return found
    if all(single):
        return cameras_of_pair(*documents)
    if is_chain(documents[0]) and len(documents) == 1:
        return cameras_of_chain(documents[0])
    return _of_matrices(documents[0] | documents[-1])


def _of_matrices(document: Document) -> Cameras:
    size = next((document[name] for name in _SIZES if name in document), None)
    if size is not None and "rotationOfCamera2" in document:
        size = np.ravel(size)[::-1]  # as in MATLAB's stereoParametersToOpenCV
    if size is None and all(name in document for name in _SIDES):
        size = [document[name] for name in _SIDES]
    unit = document.get("unit")
    known = next((one for one in get_args(LengthUnit) if one == unit), None)
    is_fisheye = str(document.get("distortion_model", "")).lower() in FISHEYE
    return as_cameras(document, size=as_size(size), fisheye=is_fisheye, unit=known)

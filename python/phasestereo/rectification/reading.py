"""Calibrations as people have them: which kind of file each is, and the cameras in it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from phasestereo.rectification.cameras import Cameras
from phasestereo.rectification.documents import Document, read_document
from phasestereo.rectification.names import as_cameras
from phasestereo.rectification.record import Rectification, from_document, is_saved
from phasestereo.rectification.rigs import (
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

_SIZES = "imageSize", "image_size", "img_size", "resolution"
_SIDES = "image_width", "image_height"


def read_calibration(
    source: CalibrationSource | Rectification | Cameras,
) -> Cameras | Rectification:
    """Return the camera pair of a calibration, or a rectification that was saved.

    Parameters
    ----------
    source
        A file or a folder; a pair of files, (left, right) or of things that complete each other;
        or matrices by name. What is a camera pair or a rectification already is returned.

    Raises
    ------
    TypeError
        If it is nothing of that.
    OSError
        If a file cannot be read.
    ValueError
        If it holds no camera pair.
    ImportError
        If the extra ``rectify`` is not installed.
    """
    if isinstance(source, Rectification | Cameras):
        return source
    if isinstance(source, Mapping):
        try:
            return _of_matrices(dict(source))
        except ValueError as error:
            raise ValueError(f"calibration: {error}") from error

    paths = _paths(source)
    documents = [read_document(path) for path in paths]
    name = " and ".join(os.fspath(path) for path in paths)
    try:
        if len(documents) == 1 and is_saved(documents[0]):
            return from_document(documents[0])
        return _of_documents(documents)
    except (KeyError, OverflowError, TypeError, ValueError) as error:
        raise ValueError(f"{name}: {error}") from error


def _paths(source: Any) -> list[str | os.PathLike[str]]:
    """Return the one or two files that are meant."""
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


def _of_documents(documents: list[Document]) -> Cameras:
    single = [is_camera(document) for document in documents]

    if all(single) and len(documents) == 2:
        return cameras_of_pair(*documents)
    if any(single):
        raise ValueError("holds one camera; give the files of both, left and right")

    if is_chain(documents[0]) and len(documents) == 1:
        return cameras_of_chain(documents[0])

    return _of_matrices(documents[0] | documents[-1])


def _of_matrices(document: Document) -> Cameras:
    size = next((document[name] for name in _SIZES if name in document), None)
    if size is None and all(name in document for name in _SIDES):
        size = [document[name] for name in _SIDES]
    return as_cameras(document, size=as_size(size))

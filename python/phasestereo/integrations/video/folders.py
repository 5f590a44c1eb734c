"""Folders of images: the views of a rig found in them, sorted as people count, and paired."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from itertools import repeat
from pathlib import Path
from typing import TypeVar

from phasestereo.integrations.video.capture import Capture, CaptureSource, Image, Pair
from phasestereo.io import read_image

T = TypeVar("T")

_SUFFIXES = (
    ".png",
    ".jpg",
    ".jpeg",
    ".webp",
    ".heic",
    ".heif",
    ".bmp",
    ".tif",
    ".tiff",
    ".pbm",
    ".pgm",
    ".ppm",
    ".pfm",
    ".npy",
)
# How data sets and recorders name the folders of both views; in KITTI color comes before gray.
_VIEWS = (
    ("left", "right"),
    ("image_left", "image_right"),
    ("cam0/data", "cam1/data"),
    ("cam0", "cam1"),
    ("image_02/data", "image_03/data"),
    ("image_2", "image_3"),
    ("image_00/data", "image_01/data"),
    ("image_0", "image_1"),
)
_LEFT = re.compile(r"(?<![a-z])left(?![a-z])", re.IGNORECASE)
_SWAPPED = {"left": "right", "LEFT": "RIGHT", "Left": "Right"}


def open_folder(folder: Path) -> CaptureSource[Image]:
    """Return the images of a folder, one after another.

    Raises
    ------
    OSError, ValueError
        If the folder cannot be read, or holds no image.
    """
    return _source([partial(read_image, path) for path in _images(folder)])


def open_folders(left: Path, right: Path) -> CaptureSource[Pair]:
    """Pair the images of two folders: by their names where these agree, else in their order.

    Raises
    ------
    OSError
        If a folder cannot be read.
    ValueError
        If one holds no image, or they hold different numbers of them and no name is in both.
    """
    return _paired(_paths(left, right))


def open_rig(folder: Path) -> CaptureSource[Pair]:
    """Find both views in one folder and pair their images, as `paths_of_rig` does.

    Raises
    ------
    OSError, ValueError
        As `paths_of_rig`.
    """
    return _paired(paths_of_rig(folder))


def paths_of_rig(folder: Path) -> list[tuple[Path, Path]]:
    """Find both views in one folder; return the left and the right file of each pair.

    They are in subfolders, ``left`` and ``right`` or as KITTI and EuRoC name them, or in files
    side by side whose names say ``left`` and ``right``.

    Raises
    ------
    OSError
        If the folder cannot be read.
    ValueError
        If there is nothing of the kind.
    """
    for left, right in _VIEWS:
        if (folder / left).is_dir() and (folder / right).is_dir():
            return _paths(folder / left, folder / right)

    lefts = [path for path in _images(folder) if _LEFT.search(path.name)]
    if not lefts:
        raise ValueError(
            f"source: {folder} has neither folders left and right (or cam0 and cam1, or image_2 "
            "and image_3) nor images named left... and right...; name both folders, or say layout "
            "if each image holds both views"
        )

    return [(path, path.with_name(_LEFT.sub(_partner, path.name))) for path in lefts]


def _paths(left: Path, right: Path) -> list[tuple[Path, Path]]:
    """Return the files of two folders in pairs; of those without a partner, where it would be."""
    views = [_images(folder) for folder in (left, right)]
    named = [{path.stem: path for path in view} for view in views]

    if named[0].keys() & named[1].keys():
        # A frame of one view alone fails when it is read; the others keep their numbers.
        stems = sorted(named[0].keys() | named[1].keys(), key=_natural)
        return [
            (named[0].get(stem, left / stem), named[1].get(stem, right / stem)) for stem in stems
        ]

    if len(views[0]) != len(views[1]):
        raise ValueError(
            f"right: got {len(views[1])} images in {right} for {len(views[0])} in {left}, no two "
            "of one name; accepts as many, or the same names"
        )

    return list(zip(*views, strict=True))


def folders_of(folder: Path) -> list[Path]:
    """Return the folders whose images are those of a folder, if it is opened: itself and views."""
    views = [folder / name for pair in _VIEWS for name in pair]
    return [folder, *(view for view in views if view.is_dir())]


def _partner(word: re.Match[str]) -> str:
    return _SWAPPED.get(word[0], "right")


def _paired(pairs: Sequence[tuple[Path, Path]]) -> CaptureSource[Pair]:
    return _source([partial(_read_pair, *pair) for pair in pairs])


def _read_pair(left: Path, right: Path) -> Pair:
    return read_image(left), read_image(right)


def _source(takes: Sequence[Callable[[], T]]) -> CaptureSource[T]:
    return CaptureSource(
        captures=map(Capture, range(len(takes)), repeat(None), takes),
        length=len(takes),
        ahead=True,
    )


def _images(folder: Path) -> list[Path]:
    found = [
        path
        for path in folder.iterdir()
        if path.suffix.lower() in _SUFFIXES and not path.name.startswith(".")
    ]

    if not found:
        raise ValueError(f"{folder}: there is no image in this folder")

    return sorted(found, key=lambda path: _natural(path.name))


def _natural(name: str) -> list[tuple[int, str]]:
    """Return what sorts frame10 after frame9."""
    return [
        (int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"([0-9]+)", name)
    ]

"""Folders of images: find the views of a rig, sort them in natural order, and pair them."""

from __future__ import annotations

import re
from pathlib import Path

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
# Folder names of both views in data sets and recorders; KITTI's color comes before gray.
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
_LETTER = re.compile(r"(?<![a-z])l(?![a-z])", re.IGNORECASE)
_SWAPPED = {"left": "right", "LEFT": "RIGHT", "Left": "Right", "l": "r", "L": "R"}


TWO_FOLDERS = "name both folders, or say layout if each image holds both views"


def paths_of_rig(folder: Path, remedy: str = TWO_FOLDERS) -> list[tuple[Path, Path]]:
    """Find both views in one folder; return the left and the right file of each pair.

    They are in subfolders, named ``left`` and ``right`` or as in KITTI and EuRoC, or in one folder,
    with ``left`` and ``right``, or ``L`` and ``R`` as words, in the file names.

    Parameters
    ----------
    folder
        The folder.
    remedy
        What else the caller accepts, for the message.

    Raises
    ------
    OSError
        If the folder cannot be read.
    ValueError
        If no such files are found.
    """
    for left, right in _VIEWS:
        if (folder / left).is_dir() and (folder / right).is_dir():
            return pair_paths(folder / left, folder / right)

    images = images_of(folder)
    for word in (_LEFT, _LETTER):
        if lefts := [path for path in images if word.search(path.stem)]:
            break
    else:
        raise ValueError(
            f"source: {folder} has neither folders left and right (or cam0 and cam1, or image_2 "
            f"and image_3) nor images named left... and right..., or ..._L and ..._R; {remedy}"
        )

    return [(path, path.with_name(word.sub(_partner, path.stem) + path.suffix)) for path in lefts]


def pair_paths(left: Path, right: Path) -> list[tuple[Path, Path]]:
    """Return the files of two folders in pairs; a missing partner gets the path it would have.

    Raises
    ------
    OSError, ValueError
        If a folder cannot be read or holds no image, or if their numbers differ and they share no
        name.
    """
    views = [images_of(folder) for folder in (left, right)]
    named = [{path.stem: path for path in view} for view in views]

    if named[0].keys() & named[1].keys():
        # A frame with one view fails when it is read; the others keep their numbers.
        lefts, rights = named
        return [
            (
                lefts.get(stem) or left / rights[stem].name,
                rights.get(stem) or right / lefts[stem].name,
            )
            for stem in sorted(lefts.keys() | rights.keys(), key=_natural)
        ]

    if len(views[0]) != len(views[1]):
        raise ValueError(
            f"right: got {len(views[1])} images in {right} for {len(views[0])} in {left}, no two "
            "of one name; accepts as many, or the same names"
        )

    return list(zip(*views, strict=True))


def folders_of(folder: Path) -> list[Path]:
    """Return the folders whose images belong to a folder: itself and its views."""
    views = [folder / name for pair in _VIEWS for name in pair]
    return [folder, *(view for view in views if view.is_dir())]


def _partner(word: re.Match[str]) -> str:
    return _SWAPPED.get(word[0], "right")


def images_of(folder: Path) -> list[Path]:
    """Return the images of a folder in natural order.

    Raises
    ------
    OSError, ValueError
        If the folder cannot be read, or holds no image.
    """
    found = [
        path
        for path in folder.iterdir()
        if path.suffix.lower() in _SUFFIXES and not path.name.startswith(".")
    ]

    if not found:
        raise ValueError(f"{folder}: there is no image in this folder")

    return sorted(found, key=lambda path: _natural(path.name))


def _natural(name: str) -> list[tuple[int, str]]:
    """Return the key that sorts frame10 after frame9."""
    return [
        (int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"([0-9]+)", name)
    ]

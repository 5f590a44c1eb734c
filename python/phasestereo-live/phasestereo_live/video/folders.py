"""Folders of images as sources of captures, one after another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import repeat
from pathlib import Path
from typing import TypeVar

from phasestereo.io import read_image
from phasestereo.io.folders import images_of, pair_paths, paths_of_rig
from phasestereo_live.video.capture import Capture, CaptureSource, Image, Pair

T = TypeVar("T")


def open_folder(folder: Path) -> CaptureSource[Image]:
    """Return the images of a folder, one after another.

    Raises
    ------
    OSError, ValueError
        If the folder cannot be read, or holds no image.
    """
    return _source([partial(read_image, path) for path in images_of(folder)])


def open_folders(left: Path, right: Path) -> CaptureSource[Pair]:
    """Pair the images of two folders: by name if names agree, else in order.

    Raises
    ------
    OSError
        If a folder cannot be read.
    ValueError
        If one holds no image, or they hold different numbers of images and share no name.
    """
    return _paired(pair_paths(left, right))


def open_rig(folder: Path) -> CaptureSource[Pair]:
    """Find both views in one folder and pair their images, as `paths_of_rig` does.

    Raises
    ------
    OSError, ValueError
        As in `paths_of_rig`.
    """
    return _paired(paths_of_rig(folder))


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

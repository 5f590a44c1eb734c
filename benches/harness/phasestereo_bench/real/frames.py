"""Recordings: folders with the raw frames of two cameras and their calibration."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from phasestereo.io import read_image, read_pair

if TYPE_CHECKING:
    import os

    import numpy as np
    from numpy.typing import NDArray

    Image = NDArray[np.uint8]

_ENDINGS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".pgm", ".ppm", ".bmp")
_SIDE_BY_SIDE = 2  # times as wide as high, or wider: both views in one picture
_PLACES = (("cam0", "cam1"), ("cam0/data", "cam1/data"), ("left", "right"), ("image_0", "image_1"))


@dataclass(frozen=True, slots=True)
class RigRecording:
    """The raw frames of one rig.

    Attributes
    ----------
    folder
        Where they are, and the calibration: as `phasestereo.rectify` takes a folder.
    frames
        Of each frame the files, by name: the left and the right one, or one with both views side
        by side.
    """

    folder: Path
    frames: tuple[tuple[Path, ...], ...]

    @property
    def name(self) -> str:
        """What tables call it."""
        return self.folder.name


def find_recording(folder: str | os.PathLike[str]) -> RigRecording:
    """Find the frames of a recording.

    Parameters
    ----------
    folder
        Holds the calibration and one of these: folders ``cam0`` and ``cam1`` (as EuRoC's, with or
        without ``data`` below), ``left`` and ``right`` or ``image_0`` and ``image_1``, with files
        of the same names; or files ``left*`` and ``right*`` with the same ending of the name. Other
        pictures in it that are at least twice as wide as high have both views side by side.

    Raises
    ------
    OSError
        If the folder cannot be read.
    ValueError
        If there is no frame.
    """
    root = Path(folder)
    if not root.is_dir():
        raise NotADirectoryError(f"{root}: no such folder")

    frames = [pair for places in _PLACES for pair in _of_folders(root, *places)]
    pictures = [path for path in sorted(root.iterdir()) if path.suffix.lower() in _ENDINGS]
    by_name = {path.name: path for path in pictures}

    # Files left* and right* whose names end alike are pairs.
    frames += [
        (path, by_name[f"right{path.name.removeprefix('left')}"])
        for path in pictures
        if path.name.startswith("left") and f"right{path.name.removeprefix('left')}" in by_name
    ]

    # All other wide pictures hold both views.
    frames += [
        (path,)
        for path in pictures
        if not path.name.startswith(("left", "right")) and _is_wide(path)
    ]

    if not frames:
        raise ValueError(
            f"{root}: no frames; accepts cam0 and cam1, left and right or image_0 and image_1 with "
            "files of the same names, files left* and right*, or pictures of both views"
        )

    return RigRecording(root, tuple(frames))


def read_frame(files: tuple[Path, ...]) -> tuple[Image, Image]:
    """Return the left and the right image of a frame, without an alpha channel.

    Raises
    ------
    OSError, ValueError, ImportError
        As `phasestereo.io.read_image`.
    """
    if len(files) == 1:
        left, right = read_pair(files[0], "side-by-side")
    else:
        left, right = (read_image(path) for path in files)

    return _opaque(left), _opaque(right)


def _opaque(image: NDArray[np.generic]) -> Image:
    found: Image = image[:, :, :3] if image.ndim == 3 else image  # type: ignore[assignment]
    return found


def _of_folders(root: Path, left: str, right: str) -> list[tuple[Path, ...]]:
    if not (root / left).is_dir():
        return []

    names = [path for path in sorted((root / left).iterdir()) if path.suffix.lower() in _ENDINGS]
    pairs = [(path, root / right / path.name) for path in names]
    return [(path, other) for path, other in pairs if other.is_file()]


def _is_wide(path: Path) -> bool:
    height, width = read_image(path).shape[:2]
    return bool(width >= _SIDE_BY_SIDE * height)

"""Finds and reads recordings: folders with raw frames of two cameras and their calibration."""

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from phasestereo.io import read_image, read_pair
from phasestereo.io.folders import images_of, paths_of_rig
from phasestereo_bench.arrays import Image

_SIDE_BY_SIDE = 2  # width over height: a picture this wide or wider holds both views


@dataclass(frozen=True, slots=True)
class RigRecording:
    """The raw frames of one rig.

    Attributes
    ----------
    folder
        Folder of the frames and of the calibration, as for `phasestereo.rectify`.
    frames
        Files of each frame, in order of their names: the left and the right one, or one with both
        views side by side.
    """

    folder: Path
    frames: tuple[tuple[Path, ...], ...]

    @property
    def name(self) -> str:
        """Name of the recording in tables."""
        return self.folder.name


def find_recording(folder: str | os.PathLike[str]) -> RigRecording:
    """Find the frames of a recording.

    Parameters
    ----------
    folder
        Folder with the calibration, and both views in folders or files as a batch finds them:
        folders ``cam0`` and ``cam1``, ``left`` and ``right`` and so on, or files ``left*`` and
        ``right*``. Other pictures in it that are at least twice as wide as high have both views
        side by side.

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

    frames: list[tuple[Path, ...]] = []
    with suppress(ValueError):  # no pairs
        frames += [both for both in paths_of_rig(root) if all(map(_is_picture, both))]
    with suppress(ValueError):  # no pictures
        others = {*filter(_is_picture, images_of(root))} - {
            path for both in frames for path in both
        }
        frames += [(path,) for path in sorted(others) if _is_wide(path)]

    if not frames:
        raise ValueError(
            f"{root}: no frames; accepts cam0 and cam1, left and right or image_0 and image_1, "
            "files left* and right*, or pictures of both views"
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
    return image[:, :, :3] if image.ndim == 3 else image  # type: ignore[return-value]


def _is_picture(path: Path) -> bool:
    return path.suffix != ".npy" and path.is_file()  # .npy files belong to a calibration


def _is_wide(path: Path) -> bool:
    height, width = read_image(path).shape[:2]
    return bool(width >= _SIDE_BY_SIDE * height)

"""Masks as image files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from phasestereo.io import read_image


def read_mask(path: Path | None, *, level: int = 1) -> NDArray[np.bool_] | None:
    """Read a mask: True where a channel other than alpha reaches the level; None without a file.

    Raises
    ------
    OSError, ValueError
        As `phasestereo.io.read_image`; ValueError also if the samples are not integers.
    """
    if path is None:
        return None

    pixels = np.atleast_3d(read_image(path))[:, :, :3]
    if pixels.dtype.kind != "u":
        raise ValueError(f"{path}: a mask has 8 or 16-bit samples, this has {pixels.dtype}")
    return np.any(pixels >= level, axis=2)

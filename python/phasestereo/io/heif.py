"""HEIF, the format of phone photos (HEIC), through pillow-heif."""

from __future__ import annotations

import os
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo.io.limits import check_size, check_unpacked

# The first box of a file: its length, then its kind. MP4 begins the same way; the brand decides.
HEIF_MAGICS = tuple(bytes([0, 0, 0, length]) + b"ftyp" for length in range(16, 68, 4))
_BRANDS = b"heic", b"heix", b"heim", b"heis", b"mif1", b"msf1"


def decode_heif(file: BinaryIO) -> NDArray[Any]:
    """Decode the only picture of a file: uint8, or uint16 for more bits, gray or color.

    Samples of 10 or 12 bits become the high bits of 16. Rotations and mirrorings that the file asks
    for are applied, since in HEIF they belong to the picture.

    Raises
    ------
    ValueError
        If it is another kind of file with the same start, or holds several pictures.
    ImportError
        If pillow-heif is not installed.
    """
    pictures = _opened(file)
    if len(pictures) > 1:
        raise ValueError(
            f"the file holds {len(pictures)} images, and only one can be meant; "
            "phasestereo.io.read_pair reads stereo photographs"
        )

    _check(pictures, file)
    return np.array(pictures)


def decode_spatial(file: BinaryIO) -> tuple[list[NDArray[Any]], float | None]:
    """Decode a spatial photograph: both views, as `decode_heif` does, and their focal length.

    The group ``ster`` of ISO/IEC 23008-12 names the images, the left one first, in any order in the
    file.

    Returns
    -------
    tuple
        The views, empty without such a group; the focal length in pixels, None if it is missing or
        the two differ.

    Raises
    ------
    ValueError
        If it is another kind of file with the same start, or the group does not name two images,
        which libheif checks.
    ImportError
        If pillow-heif is not installed.
    """
    pictures = _opened(file)
    groups = pictures.info.get("entity_groups", [])
    found = [group["images"] for group in groups if group["type"] == "ster"]
    if not found:
        return [], None
    if None in found[0]:
        raise ValueError("its stereo group names what is not an image; accepts two images")

    views, focals = [], []
    for index in found[0]:
        _check(pictures[index], file)
        views.append(np.array(pictures[index]))
        camera = pictures[index].info.get("heif", {}).get("camera_intrinsic_matrix") or {}
        focals.append(float(camera.get("focal_length_x", 0)))
    return views, focals[0] if focals[0] == focals[1] > 0 else None


def _check(picture: Any, file: BinaryIO) -> None:
    """Refuse a picture that is too large, or larger than its file can hold."""
    width, height = picture.size
    check_size(width, height)
    check_unpacked(width * height, file.seek(0, os.SEEK_END))  # gray ones have one sample


def _opened(file: BinaryIO) -> Any:
    """Open a file's images with pillow-heif."""
    brand = file.read(12)[8:]
    file.seek(0)
    if brand not in _BRANDS:
        raise ValueError(f"not a HEIF picture, but a file of the brand {brand!r}")
    return require("pillow_heif", extra="heif").open_heif(file, convert_hdr_to_8bit=False)

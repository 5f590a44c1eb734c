"""Arrays as text: what a page can hold without a file beside it."""

from __future__ import annotations

import base64
import io
import zlib
from typing import TYPE_CHECKING, Any

import numpy as np

from phasestereo.io.raster import encode_raster

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Picture = NDArray[np.uint8]

__all__ = ["as_picture", "packed", "picture_uri", "stretch"]

_OUTLIERS = (0.1, 99.9)  # percentiles that become black and white where intensities need stretching
_SPEED = 6  # of zlib: higher levels take long and gain 1 %


def packed(array: NDArray[Any]) -> str:
    """Return an array of numbers as text, exact and small.

    Its first bytes come first, then all second ones, and so on, little-endian: neighbours are alike
    in their high bytes, which makes zlib find more; then base64.
    """
    plain = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
    planes = plain.reshape(-1, 1).view(np.uint8).T
    return base64.b64encode(zlib.compress(planes.tobytes(), _SPEED)).decode()


def picture_uri(picture: Picture) -> str:
    """Return a picture, uint8 (H, W), (H, W, 1) or (H, W, 3), as the URI of a PNG.

    Raises
    ------
    ImportError
        If Pillow is not installed.
    """
    flat = picture[:, :, 0] if picture.shape[2:] == (1,) else picture
    file = io.BytesIO()
    encode_raster(file, np.ascontiguousarray(flat), "PNG")
    return f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}"


def as_picture(pixels: NDArray[Any], ends: tuple[float, float] | None) -> Picture:
    """Return an image in 8 bits: as it is, or with its intensities stretched between ends."""
    if ends is None:
        return np.asarray(pixels, dtype=np.uint8)
    low, high = ends
    share = (pixels.astype(np.float64) - low) / (high - low)
    return np.round(255 * np.clip(np.nan_to_num(share), 0, 1)).astype(np.uint8)


def stretch(pair: tuple[NDArray[Any], NDArray[Any]]) -> tuple[float, float] | None:
    """Return the intensities to show as black and white, the same for both; None: 0 and 255."""
    if pair[0].dtype == np.uint8:
        return None
    known = np.concatenate([pixels[np.isfinite(pixels)] for pixels in pair])
    if not known.size:
        return 0.0, 1.0
    low, high = np.percentile(known, _OUTLIERS).tolist()
    return (low, high) if high > low else (low, low + 1.0)

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

__all__ = ["packed", "picture_uri"]

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

"""Arrays as text, for a page without other files."""

from __future__ import annotations

import base64
import io
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require

Picture = NDArray[np.uint8]


_NONE = 2**16 - 1  # code of no disparity
_FINEST = 1 / 128  # pixels
_QUALITY = 85  # of a photograph: the eye sees no difference from the original
_SPEED = 6  # of zlib: higher levels take long and gain 1 %


def packed(array: NDArray[Any]) -> str:
    """Return an array of unsigned integers as text, exact and small.

    It keeps the difference of each integer from the one before, which wraps. All first bytes come
    first, then all second ones, little-endian: neighbors are alike, so zlib finds more. Base64
    comes last.
    """
    flat = np.ascontiguousarray(array).ravel()
    steps = np.diff(flat, prepend=flat.dtype.type(0))

    plain = np.ascontiguousarray(steps, steps.dtype.newbyteorder("<"))
    planes = plain.reshape(-1, 1).view(np.uint8).T
    return base64.b64encode(zlib.compress(planes.tobytes(), _SPEED)).decode()


@dataclass(frozen=True, slots=True)
class Coding:
    """A coding of disparities in 16 bits: ``low + step * code``; the last code: no disparity."""

    low: float
    step: float

    def encode(self, values: NDArray[np.float32]) -> NDArray[np.uint16]:
        """Return the codes of disparities."""
        known = np.isfinite(values)
        codes = np.rint((np.where(known, values, self.low) - self.low) / self.step)
        return np.where(known, np.clip(codes, 0, _NONE - 1), _NONE).astype(np.uint16)


def coding_of(*maps: NDArray[np.float32] | None) -> Coding:
    """Return a coding for all of these, in steps of `_FINEST` if that fits into 16 bits."""
    known = [values[np.isfinite(values)] for values in maps if values is not None]
    ends = [(float(part.min()), float(part.max())) for part in known if part.size] or [(0.0, 0.0)]
    low, high = min(end[0] for end in ends), max(end[1] for end in ends)
    return Coding(low, max(_FINEST, (high - low) / (_NONE - 1)))


def photograph_uri(picture: Picture, *, exact: bool) -> str:
    """Return a picture, uint8 (H, W), (H, W, 1) or (H, W, 3), as the URI of a WebP.

    Raises
    ------
    ImportError
        If Pillow is not installed.
    """
    options: dict[str, Any] = {"lossless": True} if exact else {"quality": _QUALITY}
    return _uri(picture, "WEBP", method=2, **options)


def picture_uri(picture: Picture) -> str:
    """Return a picture, uint8 (H, W), (H, W, 1) or (H, W, 3), as the URI of a PNG.

    Raises
    ------
    ImportError
        If Pillow is not installed.
    """
    return _uri(picture, "PNG")


def _uri(picture: Picture, kind: str, **options: Any) -> str:
    flat = picture[:, :, 0] if picture.shape[2:] == (1,) else picture
    image = require("PIL.Image", extra="report").fromarray(np.ascontiguousarray(flat))
    file = io.BytesIO()
    image.save(file, kind, **options)
    return f"data:image/{kind.lower()};base64,{base64.b64encode(file.getvalue()).decode()}"

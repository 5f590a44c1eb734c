"""HEIF, as telephones write it (HEIC), through pillow-heif."""

from __future__ import annotations

from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo.io.limits import check_size

# The first box of a file: its length, then its kind. MP4 begins so, too; the brand decides.
HEIF_MAGICS = tuple(bytes([0, 0, 0, length]) + b"ftyp" for length in range(16, 68, 4))
_BRANDS = b"heic", b"heix", b"heim", b"heis", b"mif1", b"msf1"


def decode_heif(file: BinaryIO) -> NDArray[Any]:
    """Decode the only picture of a file: uint8, or uint16 from more bits, gray or color.

    Samples of 10 or 12 bits become the high bits of 16. Turns and mirrorings that the file asks for
    are done, since they belong to the picture there.

    Raises
    ------
    ValueError
        If it is another kind of file that begins alike, or holds several pictures.
    ImportError
        If pillow-heif is not installed.
    """
    brand = file.read(12)[8:]
    file.seek(0)
    if brand not in _BRANDS:
        raise ValueError(f"not a HEIF picture, but a file of the brand {brand!r}")

    pictures = require("pillow_heif", extra="heif").open_heif(file, convert_hdr_to_8bit=False)
    if len(pictures) > 1:
        raise ValueError(f"the file holds {len(pictures)} images, and only one can be meant")

    check_size(*pictures.size)
    return np.array(pictures)

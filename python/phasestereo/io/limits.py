"""How large what is read may be: bounds that a file of a few bytes cannot talk its way past.

A picture may have `max_pixels` pixels, which users can raise. Files that hold numbers in words are
read to a size that none of their kind has.
"""

from __future__ import annotations

import os

from phasestereo._numbers import as_integer

PIXELS = 200_000_000
"""Pixels that a picture has at most, unless that is raised: more than any camera's."""

UNPACKING = 1032
"""What a byte unpacks to at most, in the formats of `phasestereo.io`: deflate's limit."""

SMALL = 2**20
"""Bytes of a calibration or of a matrix at most; they have some hundreds."""

STATISTICS = 2**26
"""Bytes of pair statistics at most, unpacked: a map of the tiles has one a tile."""

LIST = 2**28
"""Bytes of a list of pairs at most: a million pairs or so."""

RECORD = 2**28
"""Bytes of a record in a recording of a robot at most: a chunk of messages has some megabytes."""

_VARIABLE = "PHASESTEREO_MAX_PIXELS"
_chosen: int | None = None


def max_pixels() -> int:
    """Return the limit on the pixels of a picture that is read as a whole.

    200 million, unless `set_max_pixels` or the environment variable ``PHASESTEREO_MAX_PIXELS`` says
    otherwise. Files that are read by windows (`phasestereo_large.outofcore`) may have any number.

    Raises
    ------
    ValueError
        If the variable holds something else than a number from 1.
    """
    if _chosen is not None:
        return _chosen

    text = os.environ.get(_VARIABLE, "").strip()
    if not text:
        return PIXELS
    if not (text.isascii() and text.isdecimal() and int(text) > 0):
        raise ValueError(f"{_VARIABLE}: got {text!r}; accepts a number of pixels from 1")
    return int(text)


def set_max_pixels(count: int | None) -> None:
    """Set how many pixels a picture may have that is read as a whole, in this process.

    Parameters
    ----------
    count
        Pixels, from 1; None: as ``PHASESTEREO_MAX_PIXELS`` says, or 200 million.

    Raises
    ------
    TypeError
        If it is not an integer.
    ValueError
        If it is less than 1.
    """
    global _chosen  # noqa: PLW0603 -- one limit for the process, as Pillow has it
    _chosen = None if count is None else as_integer("count", count, least=1)


def check_size(width: int, height: int) -> None:
    """Refuse a size that no picture has, or one above `max_pixels`."""
    if width < 1 or height < 1:
        raise ValueError(f"the header says {width} x {height} pixels: that is not an image")
    if width * height > (most := max_pixels()):
        raise ValueError(
            f"the header says {width} x {height} pixels; at most {most} are read: raise that with "
            f"{_VARIABLE} or phasestereo.io.set_max_pixels, or phasestereo large"
        )


def check_unpacked(needed: int, stored: int, ratio: int = UNPACKING) -> None:
    """Refuse a picture that so few bytes cannot hold, before anything is allocated for it."""
    if needed > stored * ratio:
        raise ValueError(
            f"the header asks for {needed} bytes of samples, which the {stored} bytes that are "
            "there cannot hold: cut short, or not what it claims to be"
        )

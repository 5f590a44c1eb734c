"""Limits on sizes that are read: bounds that a file of a few bytes cannot get around.

A picture may have `max_pixels` pixels, a limit that users can raise. Text files of numbers are read
up to a size that none of their kind reaches.
"""

from __future__ import annotations

import os

from phasestereo._numbers import as_integer

PIXELS = 200_000_000
"""The most pixels of a picture by default: more than any camera's."""

UNPACKING = 1032
"""The most bytes that a byte unpacks to in the formats of `phasestereo.io`: deflate's limit."""

SMALL = 2**20
"""The most bytes of a calibration or a matrix; they have some hundreds."""

STATISTICS = 2**26
"""The most bytes of pair statistics, unpacked: a map of the tiles has one per tile."""

LIST = 2**28
"""The most bytes of a list of pairs: about a million pairs."""

RECORD = 2**28
"""The most bytes of a record in a robot's recording: a chunk of messages has some megabytes."""

_VARIABLE = "PHASESTEREO_MAX_PIXELS"
_chosen: int | None = None


def max_pixels() -> int:
    """Return the limit on the pixels of a picture that is read as a whole.

    200 million, unless `set_max_pixels` or the environment variable ``PHASESTEREO_MAX_PIXELS`` sets
    another. Files that are read by windows (`phasestereo_large.outofcore`) may have any number.

    Raises
    ------
    ValueError
        If the variable is not a number from 1.
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
    """Set the most pixels of a picture that is read as a whole, for this process.

    Parameters
    ----------
    count
        Pixels, from 1; None: the value of ``PHASESTEREO_MAX_PIXELS``, or 200 million.

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
    """Refuse an impossible size, or one above `max_pixels`."""
    if width < 1 or height < 1:
        raise ValueError(f"the header says {width} x {height} pixels: that is not an image")
    if width * height > (most := max_pixels()):
        raise ValueError(
            f"the header says {width} x {height} pixels; at most {most} are read: raise that with "
            f"{_VARIABLE} or phasestereo.io.set_max_pixels, or phasestereo large"
        )


def check_unpacked(needed: int, stored: int, ratio: int = UNPACKING) -> None:
    """Refuse a picture that its few bytes cannot hold, before anything is allocated for it."""
    if needed > stored * ratio:
        raise ValueError(
            f"the header asks for {needed} bytes of samples, which the {stored} bytes that are "
            "there cannot hold: cut short, or not what it claims to be"
        )

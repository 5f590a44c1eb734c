"""Formats that other distributions read and write: found where these are installed."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any

FORMATS = "phasestereo.formats"
"""The group of entry points by which other distributions add formats."""


def geotiff() -> Any:
    """Return the module that reads and writes GeoTIFF files: that of ``phasestereo-large``.

    Raises
    ------
    ImportError
        If it is not installed.
    """
    for point in entry_points(group=FORMATS, name="geotiff"):
        return point.load()

    raise ImportError(
        "phasestereo-large is not installed; it comes with: pip install 'phasestereo[geo]'"
    )

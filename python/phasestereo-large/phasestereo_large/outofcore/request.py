"""The request for a run, which checks itself and compares itself with earlier runs."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from phasestereo import _core
from phasestereo._numbers import as_integer
from phasestereo.io.files import StrPath
from phasestereo.known import Known
from phasestereo.result import maps_with
from phasestereo.settings import Settings
from phasestereo_large.outofcore.sinks import check_suffix


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """The inputs and options that determine the result of a run.

    Parameters
    ----------
    sources
        Left image, right image, left mask, right mask.
    outputs
        Files by the layer to write to them.
    settings, min_disparity, num_disparities, known, bands
        As in `phasestereo_large.outofcore.match`.
    """

    sources: tuple[StrPath, StrPath, StrPath | None, StrPath | None]
    outputs: Mapping[str, Path]
    settings: Settings
    min_disparity: int
    num_disparities: int
    known: Known
    bands: Sequence[int] | None

    def __post_init__(self) -> None:
        """Check the values that no other code checks."""
        for name in ("min_disparity", "num_disparities"):
            as_integer(name, getattr(self, name))

        for layer in set(self.outputs) - set(maps_with(self.settings)):
            raise ValueError(
                f"{layer}_output: got a file, and settings that work none out; accepts None"
            )

    def identity(self) -> dict[str, Any]:
        """Return the request in JSON form: two runs with the same form have the same result."""
        names = "left", "right", "left_mask", "right_mask"
        files = zip(names, self.sources, strict=True)

        return {
            "version": _core.__version__,
            **{name: None if path is None else _identity(path) for name, path in files},
            "bands": None if self.bands is None else [int(band) for band in self.bands],
            "min_disparity": self.min_disparity,
            "num_disparities": self.num_disparities,
            "settings": asdict(self.settings),
            "noise": self.known.noise,
            "layers": list(self.outputs),
        }


def as_outputs(
    paths: dict[str, StrPath | None], sources: Sequence[StrPath | None]
) -> dict[str, Path]:
    """Return the requested outputs by layer; refuse unknown formats and files already in use."""
    taken = {os.path.realpath(path) for path in sources if path is not None}
    outputs = {layer: Path(path) for layer, path in paths.items() if path is not None}

    for layer, path in outputs.items():
        name = "output" if layer == "disparity" else f"{layer}_output"
        check_suffix(path, name)
        if os.path.realpath(path) in taken:
            raise ValueError(f"{name}: {path} is in use already; accepts another file")
        taken.add(os.path.realpath(path))
    return outputs


def _identity(path: StrPath) -> dict[str, Any]:
    """Return the identity of a file: its name, size and time.

    The mask that GDAL finds beside a TIFF file also counts.
    """
    place = Path(os.path.realpath(path))
    if place.is_file():
        mask = Path(f"{os.fspath(path)}.msk")
        files = [place, mask] if mask.is_file() else [place]
    else:
        files = [file for file in place.rglob("*") if file.is_file()]

    # A Zarr array is a folder of many files: their sizes add up, and the latest time counts.
    found = [file.stat() for file in files] or [place.stat()]
    return {
        "path": str(place),
        "size": sum(each.st_size for each in found),
        "time": max(each.st_mtime_ns for each in found),
    }

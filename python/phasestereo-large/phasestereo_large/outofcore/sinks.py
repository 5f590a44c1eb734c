"""Write output files by windows as drafts, read them back, and only then rename them.

GDAL does not report every error when it closes a file, so the run compares the written values with
the intended ones.
"""

from __future__ import annotations

import errno
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo.io.drafts import publish
from phasestereo.io.files import suffix, target_of
from phasestereo.result import MAPS
from phasestereo_large.geotiff import (
    TILE,
    Georeference,
    placed,
    point_tag,
    storage,
    unplaced_allowed,
)
from phasestereo_large.outofcore.sizes import format_bytes
from phasestereo_large.windows import open_raster

Write = Callable[[int, NDArray[Any]], None]
Windows = Callable[[], Iterator[tuple[int, NDArray[Any]]]]

WINDOW_ROWS = TILE
"""Rows of a window; windows begin at multiples of it."""

_CHUNK = (WINDOW_ROWS, 2048)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sink:
    """A file to write.

    Parameters
    ----------
    path
        The file; for Zarr the folder.
    layer
        The layer of the result that it holds, one of `phasestereo.result.MAPS`.
    size
        Rows and columns.
    place
        Its georeferencing.
    run
        A name that distinguishes the drafts of runs that share this output.
    """

    path: Path
    layer: str
    size: tuple[int, int]
    place: Georeference
    run: str

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of its values."""
        return np.dtype(MAPS[self.layer].dtype)

    @property
    def target(self) -> Path:
        """The file itself, even if the path is a symbolic link."""
        return place_of(self.path)

    @property
    def draft(self) -> Path:
        """The file until it is complete."""
        return self.target.with_name(f".{self.target.name}.{self.run}.draft")

    def rehearse(self) -> None:
        """Write a draft of one pixel and remove it: only this finds all possible errors."""
        pixel = np.zeros((1, 1), self.dtype)
        small = replace(self, size=(1, 1))
        try:
            small.write(lambda: iter([(0, pixel)]))
        finally:
            remove(self.draft)

    def write(self, windows: Windows) -> None:
        """Write a draft of all windows (first row, values), and read it back.

        Raises
        ------
        OSError
            If it cannot be written; it then leaves no draft.
        """
        try:
            with ExitStack() as stack:
                with self._blamed():
                    remove(self.draft)
                    write = stack.enter_context(_WRITERS[suffix(self.path)](self))
                # The maker of the windows has its own errors; do not blame the file for them.
                for row, values in windows():
                    with self._blamed():
                        write(row, values)
                with self._blamed():
                    stack.close()
            self._compare(windows)
        except BaseException:
            remove(self.draft)
            raise

    def publish(self) -> None:
        """Give the draft its name, once it is on the disk."""
        publish(self.draft, self.target)

    def _compare(self, windows: Windows) -> None:
        with ExitStack() as stack:
            with self._blamed():
                raster = stack.enter_context(open_raster(self.draft))
            for row, values in windows():
                with self._blamed():
                    found, _ = raster.read(row, row + len(values))
                    if not np.array_equal(found, values, equal_nan=values.dtype.kind == "f"):
                        raise OSError(errno.EIO, f"rows from {row} on are not what was written")

    @contextmanager
    def _blamed(self) -> Iterator[None]:
        """Add the file that could not be written, and the space it takes, to the error."""
        try:
            yield
        except (OSError, ValueError) as error:
            size = self.size[0] * self.size[1] * self.dtype.itemsize
            reason = getattr(error, "strerror", None) or error.__cause__ or error
            raise OSError(
                getattr(error, "errno", None) or errno.EIO,
                f"cannot be written ({reason}); it may take {format_bytes(size)}",
                str(self.path),
            ) from error


def place_of(path: Path) -> Path:
    """Return the path of an output; for a symbolic link, its target, which the run replaces.

    Raises
    ------
    OSError
        If its folder does not exist, or something else has its name.
    """
    if suffix(path) == ".zarr":
        return target_of(path, "a Zarr array", _is_zarr)
    return target_of(path)


def _is_zarr(path: Path) -> bool:
    return any((path / name).exists() for name in _ZARR_FILES)


def check_suffix(path: Path, name: str) -> None:
    """Refuse a format that does not allow writing by windows."""
    if suffix(path) not in _WRITERS:
        raise ValueError(f"{name}: got {path}; accepts {', '.join(_WRITERS)}")


def remove(path: Path) -> None:
    """Remove a file, or the folder of a Zarr array, if it exists."""
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


@contextmanager
def _tiff(sink: Sink) -> Iterator[Write]:
    rasterio = require("rasterio", extra="geo")
    dtype = sink.dtype
    options = placed(sink.place) | ({"nodata": np.nan} if dtype.kind == "f" else {})
    height, width = sink.size

    with (
        unplaced_allowed(),
        rasterio.open(
            sink.draft, "w", count=1, height=height, width=width, **storage(dtype), **options
        ) as file,
    ):
        file.update_tags(**point_tag(sink.place))
        file.set_band_description(1, sink.layer)

        def write(row: int, values: NDArray[Any]) -> None:
            part = (row, row + len(values)), (0, width)
            file.write(values, 1, window=part)

        yield write


@contextmanager
def _npy(sink: Sink) -> Iterator[Write]:
    dtype = sink.dtype
    header = {"descr": dtype.str, "fortran_order": False, "shape": sink.size}

    with sink.draft.open("wb") as file:
        npy_format.write_array_header_1_0(file, header)
        start, line = file.tell(), sink.size[1] * dtype.itemsize

        def write(row: int, values: NDArray[Any]) -> None:
            file.seek(start + row * line)
            file.write(np.ascontiguousarray(values).data)

        yield write


@contextmanager
def _zarr(sink: Sink) -> Iterator[Write]:
    zarr = require("zarr", extra="large")
    dtype = sink.dtype

    array = zarr.create_array(
        sink.draft,
        shape=sink.size,
        chunks=tuple(map(min, _CHUNK, sink.size)),
        dtype=dtype,
        fill_value=np.nan if dtype.kind == "f" else 0,
        dimension_names=("y", "x"),
        attributes=_attributes(sink),
    )

    def write(row: int, values: NDArray[Any]) -> None:
        array[row : row + len(values)] = values

    yield write


def _attributes(sink: Sink) -> dict[str, Any]:
    """Return the attributes of a Zarr array: its place under GDAL's names."""
    kind = MAPS[sink.layer]
    attributes: dict[str, Any] = {"long_name": kind.meaning, "units": kind.unit}
    if sink.place.crs is not None:
        wkt = getattr(placed(sink.place)["crs"], "to_wkt", str)()
        attributes["_CRS"] = {"wkt": wkt}

    if sink.place.transform is not None:
        attributes["transform"] = [float(term) for term in tuple(sink.place.transform)[:6]]

    return attributes


_ZARR_FILES = ("zarr.json", ".zarray", ".zgroup")
_WRITERS = {".tif": _tiff, ".tiff": _tiff, ".npy": _npy, ".zarr": _zarr}

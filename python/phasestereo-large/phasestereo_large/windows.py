"""Read images larger than memory by windows: TIFF, Zarr, ``.npy``.

A window has the same values as the whole file there. This module does not map files into memory,
which would count as resident: only the returned arrays hold the data.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo._images import Mask, join_masks
from phasestereo.io.files import StrPath, decoding, is_of_the_system, named, open_regular
from phasestereo.io.npy import read_header
from phasestereo.io.pixels import Pixels, as_samples, channels
from phasestereo.io.tiff_layout import TIFF_MAGICS
from phasestereo_large.geotiff import (
    Georeference,
    as_bands,
    as_image,
    check_agreement,
    check_tiff,
    choose_bands,
    georeference_of,
    read_valid,
    unplaced_allowed,
)
from phasestereo_large.zarr_folders import open_array

Window = tuple[slice, slice]
Piece = Callable[[Window], tuple[Pixels, Mask | None]]

MAX_BYTES = 2**30
"""Default limit on the memory for the blocks across an image."""

_LEAST = 64  # rows to read at once: fewer would be slow
_NPY_MAGIC = b"\x93NUMPY"
_NO_DATA = ("_FillValue", "missing_value", "nodata")
_FORMATS = "TIFF (also GeoTIFF, COG, BigTIFF), Zarr arrays and .npy"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Raster:
    """An open file to read by windows; see `open_raster`.

    Parameters
    ----------
    path
        The file.
    size
        Rows and columns.
    itemsize
        Bytes of one pixel as read, with all its channels.
    dtype
        uint8, uint16 or float32.
    georeference
        Its georeferencing.
    block
        Rows of a block of the file, which is always read as a whole, and the bytes in a row of
        blocks.
    piece
        Reads a window: pixels, and a mask (True = valid) or None.
    by_gdal
        Whether GDAL reads it; GDAL keeps blocks in a cache.
    """

    path: str
    size: tuple[int, int]
    itemsize: int
    dtype: np.dtype[Any]
    georeference: Georeference
    block: tuple[int, int]
    piece: Piece
    by_gdal: bool = False

    def read(
        self, first: int, last: int, columns: tuple[int, int] | None = None
    ) -> tuple[Pixels, Mask | None]:
        """Read rows [first, last), and columns [columns[0], columns[1]) or all of them.

        Returns
        -------
        tuple
            Pixels, (rows, columns) or (rows, columns, 3 or 4), and the mask, bool (rows, columns),
            True = valid; None: all are valid.

        Raises
        ------
        OSError
            If the system refuses a part of the file; the message names file and rows.
        ValueError
            If a part is damaged, or samples are not valid in an image.
        """
        across = slice(*(columns or (0, self.size[1])))
        cuts = [first, *_cuts(first, last, self.block[0]), last]
        pixels: Pixels | None = None
        valid: Mask | None = None

        for start, stop in pairwise(cuts):
            with _rows_named(self.path, start, stop):
                piece, mask = self.piece((slice(start, stop), across))

            if pixels is None:
                pixels = np.empty((last - first, *piece.shape[1:]), piece.dtype)
            pixels[start - first : stop - first] = piece
            if mask is not None:
                if valid is None:
                    valid = np.ones(pixels.shape[:2], np.bool_)
                valid[start - first : stop - first] = mask

        assert pixels is not None  # noqa: S101  # at least two cuts exist
        return pixels, valid


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RasterPair:
    """Both images of a stereo pair, and masks in addition to those in the files.

    Parameters
    ----------
    left, right
        The images.
    left_mask, right_mask
        Images, non-zero at valid pixels; None: all are valid.
    """

    left: Raster
    right: Raster
    left_mask: Raster | None = None
    right_mask: Raster | None = None

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.left.size

    @property
    def itemsize(self) -> int:
        """Bytes per pixel, in the image with more of them."""
        return max(self.left.itemsize, self.right.itemsize)

    @property
    def rasters(self) -> list[Raster]:
        """All files to read."""
        every = self.left, self.right, self.left_mask, self.right_mask
        return [raster for raster in every if raster]

    def reader(
        self, columns: tuple[int, int] | None = None
    ) -> Callable[[int, int], tuple[Pixels, Pixels, Mask | None, Mask | None]]:
        """Return a reader for rows [first, last) of both images, in the given columns or all.

        It returns the left and the right image and their masks, as `Raster.read` does.
        """

        def read(first: int, last: int) -> tuple[Pixels, Pixels, Mask | None, Mask | None]:
            left, left_valid = _masked(self.left, self.left_mask, first, last, columns)
            right, right_valid = _masked(self.right, self.right_mask, first, last, columns)
            return left, right, left_valid, right_valid

        return read


@contextmanager
def open_raster(
    path: StrPath, *, bands: Sequence[int] | None = None, max_bytes: int = MAX_BYTES
) -> Iterator[Raster]:
    """Open an image to read it by windows.

    Parameters
    ----------
    path
        A TIFF file (GeoTIFF, COG, BigTIFF) by rasterio; a Zarr array, (H, W) or (H, W, C), local,
        by its folder; or a ``.npy`` file in C order.
    bands
        For a TIFF file, as in `read_geotiff`.
    max_bytes
        Largest memory for the blocks (strips, tiles, chunks) across the image, which are always
        read as a whole.

    Yields
    ------
    Raster
        Samples and masks are as in `read_geotiff`. In Zarr arrays and ``.npy``, NaN is "no data";
        in Zarr arrays also values equal to their attribute ``_FillValue``, ``missing_value`` or
        ``nodata`` (for colors, in all bands). A missing chunk of a Zarr array has its fill value,
        as in Zarr.

    Raises
    ------
    OSError
        If the file cannot be read.
    TypeError, ValueError
        If it is of another format, damaged or not an image; as `read_geotiff`; if its blocks take
        more than `max_bytes`.
    ImportError
        If rasterio or zarr is needed and not installed.
    """
    chosen = None if bands is None else as_bands(bands)
    name = os.fspath(path)

    with ExitStack() as stack:
        if Path(path).is_dir():
            yield _open_zarr(name, max_bytes)
            return

        with decoding(path) as file:
            head = file.read(len(_NPY_MAGIC))
        if head.startswith(TIFF_MAGICS):
            yield _open_tiff(stack, name, chosen, max_bytes)
        elif head == _NPY_MAGIC:
            yield _open_npy(stack, name, max_bytes)
        else:
            raise ValueError(f"{name}: cannot be read by parts; these can: {_FORMATS}")


@contextmanager
def open_pair(
    left: StrPath,
    right: StrPath,
    *,
    bands: Sequence[int] | None = None,
    left_mask: StrPath | None = None,
    right_mask: StrPath | None = None,
    max_bytes: int = MAX_BYTES,
) -> Iterator[RasterPair]:
    """Open both images of a stereo pair, and masks, to read them by windows; see `open_raster`.

    Raises
    ------
    OSError, TypeError, ValueError, ImportError
        As in `open_raster`; TypeError also if the images differ in type, ValueError if they differ
        in size, or, if both have them, in reference systems or pixel sizes, or a mask differs in
        size or does not have integers.
    """
    with ExitStack() as stack:
        images = [
            stack.enter_context(open_raster(path, bands=bands, max_bytes=max_bytes))
            for path in (left, right)
        ]
        masks = [
            None if path is None else stack.enter_context(open_raster(path, max_bytes=max_bytes))
            for path in (left_mask, right_mask)
        ]

        check_agreement(
            (images[0].size, images[1].size),
            (images[0].georeference, images[1].georeference),
            (images[0].path, images[1].path),
        )

        if images[0].dtype != images[1].dtype:
            raise TypeError(
                f"{images[1].path}: got {images[1].dtype}; accepts the type of {images[0].path}, "
                f"{images[0].dtype}"
            )

        for mask in masks:
            _check_mask(mask, images[0].size)
        yield RasterPair(left=images[0], right=images[1], left_mask=masks[0], right_mask=masks[1])


def _check_mask(mask: Raster | None, size: tuple[int, int]) -> None:
    if mask is None:
        return

    if mask.size != size:
        raise ValueError(f"{mask.path}: got {mask.size} pixels; accepts those of the image, {size}")
    if mask.dtype.kind != "u":
        raise ValueError(f"{mask.path}: a mask has 8 or 16-bit samples, this has {mask.dtype}")


def _masked(
    raster: Raster, other: Raster | None, first: int, last: int, columns: tuple[int, int] | None
) -> tuple[Pixels, Mask | None]:
    """Read a part of an image, and the mask of pixels that its file and another mark as valid."""
    pixels, valid = raster.read(first, last, columns)
    if other is None:
        return pixels, valid

    levels = np.atleast_3d(other.read(first, last, columns)[0])[:, :, :3]
    counts = np.asarray(levels.any(axis=2))
    return pixels, join_masks(counts, valid)


def _cuts(first: int, last: int, rows: int) -> range:
    """Return the cuts of the rows [first, last): between blocks, to read each block once."""
    step = rows * -(-_LEAST // rows)
    return range((first // step + 1) * step, last, step)


@contextmanager
def _rows_named(path: str, first: int, last: int) -> Iterator[None]:
    """Add the numbers of the unreadable rows to any error of a decoder."""
    where = f"{path}: rows {first} to {last - 1}"
    try:
        yield
    except (ImportError, MemoryError):
        raise
    except Exception as error:
        reason = error.__cause__ or error  # for rasterio's errors, GDAL's message
        kind = OSError if is_of_the_system(error) else ValueError
        raise kind(f"{where} cannot be read: {reason}") from error


def _check_blocks(what: str, needed: int, most: int) -> None:
    """Refuse blocks that take more memory than the limit, before reading one."""
    if needed > most:
        raise ValueError(
            f"stored in {what}, which are read as a whole and take {needed} bytes across the "
            f"image; at most {most} are allowed: store it in smaller tiles, or allow more"
        )


def _raster(
    path: str,
    size: tuple[int, int],
    piece: Piece,
    block: tuple[int, int],
    georeference: Georeference | None = None,
) -> Raster:
    """Describe a raster; its first pixel shows the type and the channels of all pixels."""
    if min(size) < 1:
        raise ValueError(f"{path}: got {size} pixels; accepts at least one")

    with _rows_named(path, 0, 1):
        pixel = piece((slice(0, 1), slice(0, 1)))[0]

    if not channels(pixel.shape):
        raise ValueError(f"{path}: got {pixel.shape[2]} channels; accepts 1, 3 and 4")

    return Raster(
        path=path,
        size=size,
        itemsize=pixel.nbytes,
        dtype=pixel.dtype,
        georeference=georeference or Georeference(),
        block=block,
        piece=piece,
    )


def _open_tiff(stack: ExitStack, path: str, chosen: list[int] | None, max_bytes: int) -> Raster:
    """Open a TIFF file with GDAL; it stays open as long as the stack."""
    rasterio = require("rasterio", extra="geo")
    with decoding(path) as content, unplaced_allowed():
        for directory in check_tiff(path, content):
            if directory.has_pixels:
                width, _ = directory.size
                across, down = directory.block

                # A window may cut all blocks of a row, and each is read as a whole.
                row = directory.block_bytes * -(-width // across)
                _check_blocks(f"blocks of {down} rows", row, max_bytes)

        file = stack.enter_context(rasterio.open(path, driver="GTiff"))
        indexes = choose_bands(file, chosen)
        place = georeference_of(file)

    def piece(window: Window) -> tuple[Pixels, Mask | None]:
        part = rasterio.windows.Window.from_slices(*window)
        with unplaced_allowed():
            samples = file.read(indexes, window=part)
            valid = read_valid(file, indexes, samples, window=part)

        image = as_image(file, indexes, samples, valid)
        return image, None if valid.all() else valid

    rows = max(height for height, _ in file.block_shapes)
    sample = sum(np.dtype(name).itemsize for name in file.dtypes)
    raster = _raster(
        path, (file.height, file.width), piece, (rows, rows * file.width * sample), place
    )
    return replace(raster, by_gdal=True)


def _open_zarr(path: str, max_bytes: int) -> Raster:
    """Open the folder of a Zarr array."""
    try:
        array = open_array(path, max_bytes)
    except ImportError:
        raise
    except Exception as error:
        if is_of_the_system(error):
            raise
        kept = error if isinstance(error, ValueError | OSError) else repr(error)
        raise ValueError(f"{path}: a folder, and no Zarr array ({kept})") from error

    leading = array.ndim == 3 and array.shape[0] == 1  # one band, as in rioxarray
    if array.ndim != 2 and not (leading or (array.ndim == 3 and array.shape[2] in (1, 3, 4))):
        raise ValueError(f"{path}: got shape {array.shape}; accepts (H, W) and (H, W, channels)")

    attributes = array.attrs.asdict()
    missing = [attributes[name] for name in _NO_DATA if isinstance(attributes.get(name), Real)]

    def piece(window: Window) -> tuple[Pixels, Mask | None]:
        samples = array[(0, *window)] if leading else array[window]
        return _plain(np.asarray(samples), missing)

    size, chunk = array.shape[leading : leading + 2], array.chunks[leading]
    row = array.nbytes // max(array.shape[leading], 1)
    chunks = math.prod(array.chunks) * array.dtype.itemsize

    with named(path):
        across = -(-array.shape[leading + 1] // array.chunks[leading + 1])
        _check_blocks(f"chunks of {chunk} rows", chunks * across, max_bytes)
    return _raster(path, (int(size[0]), int(size[1])), piece, (int(chunk), int(chunk * row)))


def _open_npy(stack: ExitStack, path: str, max_bytes: int) -> Raster:
    """Open a ``.npy`` file, and read rows at their positions."""
    with decoding(path) as head:
        shape, columns_first, dtype = read_header(head)
        start, stored = head.tell(), os.fstat(head.fileno()).st_size

        if len(shape) not in (2, 3) or dtype.hasobject:
            raise ValueError(f"an array of shape {shape} and {dtype}; an image has (H, W) pixels")
        if columns_first:
            raise ValueError("the array is in Fortran order, which cannot be read by rows; save it "
                             "with np.ascontiguousarray")  # fmt: skip

        row = int(np.prod(shape[1:])) * dtype.itemsize
        if stored != start + shape[0] * row:
            raise ValueError(
                f"the header asks for {start + shape[0] * row} bytes, but the file has {stored}"
            )
        _check_blocks("one row", row, max_bytes)

    file = stack.enter_context(open_regular(path))

    def piece(window: Window) -> tuple[Pixels, Mask | None]:
        rows, across = window
        file.seek(start + rows.start * row)
        count = (rows.stop - rows.start) * row // max(dtype.itemsize, 1)
        samples = np.fromfile(file, dtype, count)

        if samples.size != count:
            raise ValueError("the file ends before")
        return _plain(samples.reshape(-1, *shape[1:])[:, across], [])

    return _raster(path, (shape[0], shape[1]), piece, (1, row))


def _plain(samples: NDArray[Any], missing: list[Any]) -> tuple[Pixels, Mask | None]:
    """Return samples in the form of an image, and a mask of the valid ones."""
    if samples.dtype == np.bool_:
        samples = samples.astype(np.uint8)

    # "No data" is NaN in any channel, or a missing value in all of them.
    layers = np.atleast_3d(samples)
    lacking = np.zeros(layers.shape[:2], np.bool_)
    if layers.dtype.kind == "f":
        lacking |= np.isnan(layers).any(axis=2)
    for value in missing:
        lacking |= (layers == value).all(axis=2)

    if samples.shape[2:] == (1,):
        samples = samples[:, :, 0]
    image = as_samples(np.ascontiguousarray(samples), ~lacking)
    return image, ~lacking if lacking.any() else None

"""Read and write GeoTIFF with rasterio: images with their georeferences and masks.

This module does not change georeferences, and never reprojects or resamples an image.
"""

from __future__ import annotations

import logging
import os
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo._extras import require
from phasestereo._images import Mask
from phasestereo._numbers import check_type
from phasestereo.io.drafts import replacing
from phasestereo.io.files import StrPath, decoding
from phasestereo.io.pixels import Pixels, as_samples, channels, look_up
from phasestereo.io.tiff_layout import TIFF_MAGICS, Directory, check_whole, read_layout

# We raise the errors of a file; without a handler, log lines would also reach the terminal.
logging.getLogger("rasterio").addHandler(logging.NullHandler())

_IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)  # GDAL's value without a transform
_SAME = 1e-3  # relative difference of pixel sizes that rounding may cause
_DTYPES = ("uint8", "uint16", "float32")
TILE = 256
"""Side of the tiles of a written file, in pixels."""

_PREDICTORS = {"u": 2, "f": 1}  # none for floats: tifffile alone, as in read_image, cannot read one


@dataclass(frozen=True, slots=True, kw_only=True)
class Georeference:
    """The place of an image's pixels on Earth.

    Parameters
    ----------
    crs
        Coordinate reference system: a ``rasterio.crs.CRS``, or a value that makes one, such as
        "EPSG:32631"; None: unknown, as for most epipolar images.
    transform
        Coordinates of pixels, ``affine.Affine`` or its first six coefficients (a, b, c, d, e, f):
        x = a col + b row + c, y = d col + e row + f at the upper left corner of a pixel; None:
        unknown.
    gcps
        Ground control points, ``rasterio.control.GroundControlPoint``, in coordinates of `crs`; a
        file has either these or a transform.
    rpcs
        Rational polynomial coefficients of the sensor, ``rasterio.rpc.RPC``; None: unknown.
    point
        Whether a sample stands for a point ("PixelIsPoint") rather than an area.
    """

    crs: Any = None
    transform: Any = None
    gcps: tuple[Any, ...] = ()
    rpcs: Any = None
    point: bool = False

    @property
    def pixel_size(self) -> tuple[float, float] | None:
        """Lengths of one column and one row in units of the CRS; None if unknown."""
        if self.transform is None:
            return None
        a, b, _, d, e, _ = tuple(self.transform)[:6]
        return float(np.hypot(a, d)), float(np.hypot(b, e))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GeoImage:
    """An image of a GeoTIFF file.

    Parameters
    ----------
    image
        uint8, uint16 or float32, (H, W) or (H, W, 3), for `phasestereo.match`.
    mask
        bool (H, W), True = valid; None: all are valid.
    georeference
        Its georeference.
    tags
        The metadata of the file by name.
    """

    image: Pixels
    mask: Mask | None
    georeference: Georeference
    tags: Mapping[str, str]


def read_geotiff(path: StrPath, *, bands: Sequence[int] | None = None) -> GeoImage:
    """Read an image, its mask and its georeference.

    Parameters
    ----------
    path
        A GeoTIFF file; GDAL's files next to it (``.tfw``, ``.RPB``, ``.msk`` ...) also count.
    bands
        The number of one band, or the numbers of three bands to use as red, green and blue, counted
        from 1. None: the only band, or those that the file calls red, green and blue; alpha goes
        into the mask.

    Returns
    -------
    GeoImage
        Samples as the file stores them: uint8, uint16, float32; other real types become float32
        (which holds int16 exactly). The mask leaves out pixels with the file's "no data" value (in
        color images those that have it in all bands), those that its mask or alpha leaves out, and
        NaN.

    Raises
    ------
    OSError
        If the file cannot be read.
    TypeError
        If the bands are not integers.
    ValueError
        If it is damaged or not a GeoTIFF; if it does not have these bands, or has too many to
        choose from; if its samples are complex or, where not masked, integers beyond 2**24; if it
        has more pixels than `max_pixels` allows (200 million), or is too short to hold them.
    ImportError
        If rasterio is not installed.

    Notes
    -----
    The function does not apply the scale and offset of a band: matching does not depend on them.
    """
    chosen = None if bands is None else as_bands(bands)
    rasterio = require("rasterio", extra="geo")
    with decoding(path) as content, unplaced_allowed():
        # GDAL allocates the size that a file claims, so check that first.
        for directory in check_tiff(path, content):
            if directory.has_pixels:
                check_whole(content, directory)

        with rasterio.open(os.fspath(path), driver="GTiff") as file:
            indexes = choose_bands(file, chosen)
            samples = file.read(indexes)
            valid = read_valid(file, indexes, samples)
            return GeoImage(
                image=as_image(file, indexes, samples, valid),
                mask=None if valid.all() else valid,
                georeference=georeference_of(file),
                tags=file.tags(),
            )


def read_geotiff_pair(
    left: StrPath, right: StrPath, *, bands: Sequence[int] | None = None
) -> tuple[GeoImage, GeoImage]:
    """Read both images of a stereo pair; see `read_geotiff`.

    Raises
    ------
    OSError, TypeError, ValueError, ImportError
        As in `read_geotiff`; ValueError also if the images differ in size, or, if both have them,
        in their reference systems or pixel sizes.
    """
    pair = read_geotiff(left, bands=bands), read_geotiff(right, bands=bands)
    check_pair(pair[0], pair[1], names=(os.fspath(left), os.fspath(right)))
    return pair


def check_pair(
    left: GeoImage, right: GeoImage, *, names: tuple[str, str] = ("left", "right")
) -> None:
    """Refuse two images that cannot be a rectified stereo pair.

    Raises
    ------
    ValueError
        If the images differ in size, or, if both have them, in their reference systems or pixel
        sizes (by more than 0.1 %). Their positions do not matter.
    """
    check_agreement(
        (left.image.shape[:2], right.image.shape[:2]),
        (left.georeference, right.georeference),
        names,
    )


def check_agreement(
    sizes: tuple[tuple[int, ...], tuple[int, ...]],
    places: tuple[Georeference, Georeference],
    names: tuple[str, str],
) -> None:
    """Refuse images with these sizes and places, as `check_pair` does."""
    if sizes[0] != sizes[1]:
        raise ValueError(f"{names[1]}: got {sizes[1]} pixels; accepts the size of left, {sizes[0]}")

    if places[0].crs and places[1].crs and places[0].crs != places[1].crs:
        raise ValueError(
            f"{names[1]}: got {_name(places[1].crs)}; accepts the reference system of {names[0]}, "
            f"{_name(places[0].crs)}"
        )

    steps = places[0].pixel_size, places[1].pixel_size
    if steps[0] and steps[1] and not np.allclose(steps[0], steps[1], rtol=_SAME, atol=0):
        raise ValueError(
            f"{names[1]}: got pixels of {_by(steps[1])}; accepts those of {names[0]}, "
            f"{_by(steps[0])}: resample one of them"
        )


def write_geotiff(
    path: StrPath,
    image: ArrayLike | Mapping[str, ArrayLike],
    *,
    like: Georeference | GeoImage | None = None,
    tags: Mapping[str, str] | None = None,
) -> None:
    """Write an image, or several bands, with a georeference: tiled, with lossless compression.

    Parameters
    ----------
    path
        The file; a complete new one replaces an existing one.
    image
        uint8, uint16, float32 or float64 (rounded to float32): (H, W), (H, W, 3) RGB, (H, W, 4) RGB
        with alpha; or bands (H, W) under their names, written in the one type that holds them all
        (disparity and flags: float32, exactly). In floats NaN is "no data", and the file declares
        it.
    like
        The georeference, or an image that has it; None: no georeference.
    tags
        Metadata by name; ``AREA_OR_POINT`` comes from `like`.

    Raises
    ------
    TypeError
        If an array has another type, or `like` is something else.
    ValueError
        If a shape is not one of the above, shapes differ, a number is beyond float32, or rasterio
        does not understand the reference system or the transform.
    OSError
        If the file cannot be written.
    ImportError
        If rasterio is not installed.
    """
    memory = require("rasterio.io", extra="geo")
    names, planes, options = _layers(image)

    place = like.georeference if isinstance(like, GeoImage) else like or Georeference()
    options |= placed(place)
    count, height, width = planes.shape

    with replacing(path) as file, unplaced_allowed(), memory.MemoryFile() as draft:
        with draft.open(
            count=count, height=height, width=width, **storage(planes.dtype), **options
        ) as dataset:
            dataset.update_tags(**{**(tags or {}), **point_tag(place)})  # tags of a file include it
            dataset.write(planes)
            for number, name in enumerate(names, start=1):
                dataset.set_band_description(number, name)
        file.write(draft.getbuffer())


def check_tiff(path: StrPath, content: BinaryIO) -> list[Directory]:
    """Return the directories of a TIFF file; refuse those whose layout would mislead GDAL.

    This also checks the mask that GDAL finds beside the file.
    """
    if not content.read(4).startswith(TIFF_MAGICS):
        raise ValueError("not a TIFF file")
    found = read_layout(content)

    for directory in found:
        if directory.has_pixels:
            directory.check_blocks()

    beside = Path(f"{os.fspath(path)}.msk")
    if beside.exists():
        with decoding(beside) as mask:
            check_tiff(beside, mask)

    return found


@contextmanager
def unplaced_allowed() -> Iterator[None]:
    """Ignore rasterio's warnings about images without a georeference, which are valid here.

    Alpha beside a "no data" value is valid, too: both count. And if GDAL quotes a damaged file in
    bytes that are not UTF-8, rasterio fails to log that and warns: we raise the error anyway.
    """
    errors = require("rasterio.errors", extra="geo")
    with warnings.catch_warnings(), _unlogged():
        warnings.simplefilter("ignore", errors.NotGeoreferencedWarning)
        warnings.simplefilter("ignore", errors.NodataShadowWarning)
        yield


@contextmanager
def _unlogged() -> Iterator[None]:
    """Ignore rasterio's messages about lines that it cannot log."""
    before = sys.unraisablehook, sys.excepthook

    def on_unraisable(found: Any) -> None:
        if found.object != "rasterio._env.log_error":
            before[0](found)

    def on_error(kind: type[BaseException], error: BaseException, trace: Any) -> None:
        if kind is not UnicodeDecodeError:
            before[1](kind, error, trace)

    sys.unraisablehook, sys.excepthook = on_unraisable, on_error
    try:
        yield
    finally:
        sys.unraisablehook, sys.excepthook = before


def as_bands(bands: Sequence[int]) -> list[int]:
    """Return the numbers of one or three bands; refuse anything else."""
    is_list = not isinstance(bands, str) and hasattr(bands, "__len__")
    if not (is_list and all(isinstance(band, int | np.integer) for band in bands)):
        raise TypeError(f"bands: got {bands!r}; accepts the numbers of one or three bands")
    if len(bands) not in (1, 3):
        raise ValueError(f"bands: got {len(bands)}; accepts one, or three (red, green, blue)")
    return [int(band) for band in bands]


def choose_bands(file: Any, chosen: list[int] | None) -> list[int]:
    """Return the bands to read: the chosen ones, or the ones that the file's colors name."""
    if chosen is not None:
        if not set(chosen) <= set(file.indexes):
            raise ValueError(f"bands: got {chosen}; accepts 1 to {file.count}")
        return chosen

    colors = {kind.name: band for band, kind in zip(file.indexes, file.colorinterp, strict=True)}
    if {"red", "green", "blue"} <= colors.keys():
        return [colors["red"], colors["green"], colors["blue"]]

    others = [band for band in file.indexes if band != colors.get("alpha")]
    if len(others) == 1:
        return others

    names = ", ".join(f"{band} {file.descriptions[band - 1] or ''}".strip() for band in others)
    raise ValueError(f"bands: the file has {len(others)} ({names}) and no colors; choose 1 or 3")


def read_valid(file: Any, indexes: list[int], samples: NDArray[Any], *, window: Any = None) -> Mask:
    """Return the mask of pixels that are not "no data", masked, transparent or NaN.

    Parameters
    ----------
    file
        The open file.
    indexes, samples
        The bands of the image, and the samples read from them.
    window
        The part of the file that was read, in rasterio's form; None: all.
    """
    valid: Mask = (file.read_masks(indexes, window=window) != 0).any(axis=0)
    for band, kind in zip(file.indexes, file.colorinterp, strict=True):
        if kind.name == "alpha" and band not in indexes:
            valid &= file.read(band, window=window) != 0

    if samples.dtype.kind == "f":
        valid &= ~np.isnan(samples).any(axis=0)
    return valid


def as_image(file: Any, indexes: list[int], samples: NDArray[Any], valid: Mask) -> Pixels:
    """Return bands as gray levels or RGB; look up the colors of a palette."""
    if len(indexes) == 3:
        return as_samples(np.ascontiguousarray(np.moveaxis(samples, 0, 2)), valid)

    plane: NDArray[Any] = samples[0]
    if file.colorinterp[indexes[0] - 1].name == "palette" and plane.dtype == np.uint8:
        entries = file.colormap(indexes[0])
        colors = np.array([entries.get(index, (0, 0, 0))[:3] for index in range(256)], np.uint8)
        return look_up(colors, plane)

    return as_samples(plane, valid)


def georeference_of(file: Any) -> Georeference:
    """Return the georeference of an open file."""
    gcps, gcps_crs = file.gcps
    transform = file.transform

    return Georeference(
        crs=gcps_crs if gcps else file.crs,
        transform=None if tuple(transform)[:6] == _IDENTITY else transform,
        gcps=tuple(gcps),
        rpcs=file.rpcs,
        point=file.tags().get("AREA_OR_POINT") == "Point",
    )


def _layers(
    image: ArrayLike | Mapping[str, ArrayLike],
) -> tuple[list[str], NDArray[Any], dict[str, Any]]:
    """Return the names of bands, the bands (count, H, W), and their metadata for GDAL."""
    options: dict[str, Any] = {}

    if isinstance(image, Mapping):
        names = list(image)
        planes = _stacked({name: _native(band) for name, band in image.items()})
        options["photometric"] = "minisblack"  # else GDAL takes bytes as colors, and a 4th as alpha
    else:
        names, whole = [], _native(image)
        if not channels(whole.shape):
            raise ValueError(
                f"image: got shape {whole.shape}; accepts (H, W), (H, W, 3) and (H, W, 4)"
            )
        planes = np.atleast_3d(whole).transpose(2, 0, 1)
        if len(planes) > 1:
            options |= {"photometric": "rgb"} | ({"alpha": "yes"} if len(planes) == 4 else {})

    if planes.dtype == np.float64:
        planes = _narrowed(planes)
    if planes.dtype.name not in _DTYPES:
        raise TypeError(f"image: got dtype {planes.dtype}; accepts {', '.join(_DTYPES)}, float64")
    if planes.dtype.kind == "f":
        options["nodata"] = np.nan

    return names, np.ascontiguousarray(planes), options


def _narrowed(planes: NDArray[Any]) -> Pixels:
    try:
        return as_samples(planes)
    except ValueError as error:
        raise ValueError(f"image: got {error}") from error


def _native(band: ArrayLike) -> NDArray[Any]:
    """Return an array in the byte order of this machine, which rasterio needs."""
    given = np.asarray(band)
    return given.astype(given.dtype.newbyteorder("="), copy=False)


def _stacked(bands: dict[str, NDArray[Any]]) -> NDArray[Any]:
    shapes = {band.shape for band in bands.values()}
    if len(shapes) != 1 or channels(shape := shapes.pop()) != 1 or len(shape) != 2:
        raise ValueError(f"image: got bands of shapes {shapes or '()'}; accepts one (H, W) for all")

    for name, band in bands.items():
        if band.dtype.name not in (*_DTYPES, "float64"):
            raise TypeError(f"{name}: got dtype {band.dtype}; accepts {', '.join(_DTYPES)}")

    return np.stack(list(bands.values()))


def storage(dtype: np.dtype[Any]) -> dict[str, Any]:
    """Return rasterio's options for storage: tiles, lossless compression."""
    return {
        "driver": "GTiff",
        "dtype": dtype.name,
        "tiled": True,
        "blockxsize": TILE,
        "blockysize": TILE,
        "compress": "deflate",
        "predictor": _PREDICTORS[dtype.kind],
        "bigtiff": "if_safer",
    }


def point_tag(place: Georeference) -> dict[str, str]:
    """Return the tag for whether a sample stands for a point or for an area."""
    return {"AREA_OR_POINT": "Point" if place.point else "Area"}


def placed(place: Georeference) -> dict[str, Any]:
    """Return a georeference as rasterio's arguments."""
    check_type("like", place, Georeference, "Georeference, GeoImage or None")
    options: dict[str, Any] = {"crs": _as_crs(place.crs), "rpcs": place.rpcs}
    if place.gcps:
        options["gcps"] = list(place.gcps)
    elif place.transform is not None:
        options["transform"] = _as_affine(place.transform)
    return {name: value for name, value in options.items() if value is not None}


def _as_crs(crs: Any) -> Any:
    if crs is None:
        return None

    errors = require("rasterio.errors", extra="geo")
    try:
        return require("rasterio.crs", extra="geo").CRS.from_user_input(crs)
    except errors.CRSError as error:
        raise ValueError(
            f"crs: got {crs!r}; accepts a reference system, such as 'EPSG:32631'"
        ) from error


def _as_affine(transform: Any) -> Any:

    terms = tuple(transform)[:6]
    if len(terms) != 6:
        raise ValueError(f"transform: got {transform!r}; accepts six numbers (a, b, c, d, e, f)")
    return require("affine", extra="geo").Affine(*terms)


def _name(crs: Any) -> str:
    return getattr(crs, "to_string", lambda: str(crs))()


def _by(size: tuple[float, float]) -> str:
    return f"{size[0]:g} x {size[1]:g}"

"""Match xarray's labeled arrays; the result has the coordinates of the left image.

Dimensions count by name, in any order. This module imports xarray (extra ``geo`` or ``dask``) on
first use.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from numbers import Real
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phasestereo import _core
from phasestereo._extras import require
from phasestereo._images import Mask, as_mask, join_masks
from phasestereo._numbers import check_type
from phasestereo.io.pixels import Pixels, as_samples
from phasestereo.matching import match as match_pair
from phasestereo.result import MAPS, Flag, Result

if TYPE_CHECKING:
    from xarray import DataArray, Dataset


__all__ = ["as_dataset", "match"]

ROWS = ("y", "row", "lat", "latitude")
"""Possible names for the dimension of the rows."""

COLUMNS = ("x", "col", "lon", "longitude")
"""Possible names for the dimension of the columns."""

_NO_DATA = ("_FillValue", "missing_value", "nodata")
_PACKED = {"scale_factor", "add_offset"}
_SAME = 1e-3  # of a row: computed coordinates have rounding errors


def match(
    left: DataArray,
    right: DataArray,
    *,
    num_disparities: int | None = None,
    min_disparity: int = 0,
    left_mask: DataArray | ArrayLike | None = None,
    right_mask: DataArray | ArrayLike | None = None,
    **options: Any,
) -> Dataset:
    """Match a rectified stereo pair of labeled arrays.

    Parameters
    ----------
    left, right
        Images with a dimension of rows (named "y", "row", "lat" or "latitude"), one of columns
        ("x", "col", "lon", "longitude") and, if any, one of 1, 3 (RGB) or 4 (RGBA) bands, under any
        other name; in any order. Integers and floats of any size; types other than uint8, uint16
        and float32 are matched as float32. Chunked arrays are computed. If an image has a "no data"
        value (``_FillValue``, ``missing_value`` or ``nodata``, among its attributes or in its
        encoding), pixels that have it in all bands are masked, as is NaN. A value in an encoding
        with a scale or an offset does not count: it belongs to the packed numbers, which xarray
        already unpacked.
    num_disparities, min_disparity
        The disparities to search, in pixels, as in `phasestereo.match`; without them, the range
        that it finds.
    left_mask, right_mask
        bool, True = valid: a labeled array with the rows and columns of its image, in any order, or
        a plain one (H, W). They can only add to the pixels that "no data" masks.
    **options
        Further arguments of `phasestereo.match`.

    Returns
    -------
    Dataset
        The result of `as_dataset`, with the coordinates of the left image that belong to its rows
        and columns or to no dimension (such as ``spatial_ref``).

    Raises
    ------
    TypeError
        If an image is not a DataArray, or as `phasestereo.match`.
    ValueError
        If dimensions are unclear or sizes differ, if the rows of the images have different
        coordinates, or as `phasestereo.match`.
    ImportError
        If xarray is not installed.
    """
    xarray = require("xarray", extra="geo")
    views = _ordered(left, "left", xarray), _ordered(right, "right", xarray)
    _check_rows(*views)
    pixels = _computed(views)

    given = left_mask, right_mask
    masks = [
        join_masks(_valid(view, image), _as_mask(mask, view, name, xarray))
        for view, image, mask, name in zip(
            views, pixels, given, ("left_mask", "right_mask"), strict=True
        )
    ]

    result = match_pair(
        _as_image(pixels[0], masks[0], "left"),
        _as_image(pixels[1], masks[1], "right"),
        num_disparities=num_disparities,
        min_disparity=min_disparity,
        left_mask=masks[0],
        right_mask=masks[1],
        **options,
    )

    if result.search is not None:
        min_disparity, num_disparities = result.search.min_disparity, result.search.num_disparities
    search = {"min_disparity": min_disparity, "num_disparities": num_disparities}
    return as_dataset(result, like=views[0]).assign_attrs(search)


def as_dataset(result: Result, *, like: DataArray | None = None) -> Dataset:
    """Label the result of a match with the conventions for climate and forecast metadata (CF).

    Parameters
    ----------
    result
        The result.
    like
        The left image, which gives the result its dimensions and coordinates along them; None:
        dimensions "y" and "x", without coordinates.

    Returns
    -------
    Dataset
        ``disparity``: float32, pixels, NaN = no estimate; ``flags``: uint16, with the meaning of
        every bit in ``flag_masks`` and ``flag_meanings``; ``confidence``, if there is any: float32
        in [0, 1]; ``uncertainty``: float32, pixels, NaN = no estimate. Attributes give the version,
        the settings (as JSON) and the blur found. You can write everything to netCDF and Zarr.

    Raises
    ------
    TypeError
        If the result is not a `Result`, or `like` is not a DataArray.
    ValueError
        If its dimensions are unclear, or its size differs from the result's.
    ImportError
        If xarray is not installed.
    """
    check_type("result", result, Result, "a phasestereo.Result")

    xarray = require("xarray", extra="geo")
    dims, coords = ("y", "x"), {}
    if like is not None:
        view = _ordered(like, "like", xarray)
        dims = cast("tuple[str, str]", view.dims[:2])
        if view.shape[:2] != result.disparity.shape:
            raise ValueError(
                f"like: got {view.shape[:2]} pixels; accepts the size of the result, "
                f"{result.disparity.shape}"
            )
        coords = {name: each for name, each in view.coords.items() if set(each.dims) <= set(dims)}

    # CF: each layer names the variable that holds the reference system.
    placed = {"grid_mapping": "spatial_ref"} if "spatial_ref" in coords else {}
    variables = {
        name: (dims, values, _attributes(name) | placed) for name, values in result.maps.items()
    }
    beside = [name for name in variables if name != "disparity"]
    variables["disparity"][2]["ancillary_variables"] = " ".join(beside)

    attrs = {
        "Conventions": "CF-1.11",
        "title": "disparities of a rectified stereo pair",
        "source": f"phasestereo {_core.__version__}",
        "settings": json.dumps(asdict(result.settings)),
    }
    if result.blur is not None:
        attrs["blur"] = str(result.blur)

    return xarray.Dataset(variables, coords, attrs)


def _attributes(name: str) -> dict[str, Any]:
    """Return the attributes of a map of a result."""
    kind = MAPS[name]
    found: dict[str, Any] = {"long_name": kind.meaning, "units": kind.unit}
    if name == "disparity":
        found["comment"] = (
            "left column x corresponds to right column x - disparity; NaN: no estimate"
        )
    elif name == "flags":
        del found["units"]  # bits have none
        named = [flag for flag in Flag if flag.name]
        found["flag_masks"] = np.array(named, dtype=np.uint16)
        found["flag_meanings"] = " ".join(str(flag.name).lower() for flag in named)
    return found


def _ordered(image: DataArray, name: str, xarray: Any) -> DataArray:
    """Return a view of an image with rows first, columns second, bands last."""
    check_type(name, image, xarray.DataArray, "an xarray.DataArray")
    rows = [dim for dim in image.dims if dim in ROWS]
    columns = [dim for dim in image.dims if dim in COLUMNS]
    if len(rows) != 1 or len(columns) != 1 or image.ndim > 3:
        raise ValueError(
            f"{name}: got dimensions {image.dims}; accepts rows ({', '.join(ROWS)}), columns "
            f"({', '.join(COLUMNS)}) and at most one more, of bands"
        )

    return image.transpose(rows[0], columns[0], ...)


def _check_rows(left: DataArray, right: DataArray) -> None:
    """Refuse images whose coordinates show that their rows do not correspond."""
    sizes = left.shape[:2], right.shape[:2]
    if sizes[0] != sizes[1]:
        raise ValueError(f"right: got {sizes[1]} pixels; accepts the size of left, {sizes[0]}")

    dims = left.dims[0], right.dims[0]
    if dims[0] not in left.coords or dims[1] not in right.coords or not sizes[0][0]:
        return

    # Coordinates may differ by rounding, which is far less than the distance between rows.
    rows = [np.asarray(image.coords[dim]) for image, dim in zip((left, right), dims, strict=True)]
    step = abs(rows[0][-1] - rows[0][0]) / max(1, len(rows[0]) - 1)
    apart = np.abs(rows[0] - rows[1]).max()

    if apart > _SAME * step:
        raise ValueError(
            f"right: got coordinates {dims[1]!r} up to {apart:g} from those of left; accepts the "
            "same: the images of a rectified pair have their rows in common"
        )


def _computed(views: Iterable[DataArray]) -> list[NDArray[Any]]:
    """Return the pixels of images; compute chunked ones together."""
    views = list(views)
    if any(view.chunks for view in views):
        views = list(require("dask", extra="dask").compute(*views))
    return [view.to_numpy() for view in views]


def _as_image(pixels: NDArray[Any], mask: Mask | None, name: str) -> Pixels:
    try:
        return as_samples(pixels, mask)
    except ValueError as error:
        raise ValueError(f"{name}: got {error}") from error


def _valid(view: DataArray, pixels: NDArray[Any]) -> Mask | None:
    """Return the mask of pixels with data, or None if all have data."""
    layers = np.atleast_3d(pixels)
    missing = np.zeros(layers.shape[:2], dtype=np.bool_)

    if layers.dtype.kind == "f":
        missing |= np.isnan(layers).any(axis=2)

    # The encoding describes packed pixels before unpacking: "no data" is now NaN.
    is_packed = not _PACKED.isdisjoint(view.encoding)
    for attributes in (view.attrs, {} if is_packed else view.encoding):
        for value in (attributes.get(name) for name in _NO_DATA):
            if isinstance(value, Real):
                missing |= (layers == value).all(axis=2)

    return ~missing if missing.any() else None


def _as_mask(
    mask: DataArray | ArrayLike | None, view: DataArray, name: str, xarray: Any
) -> Mask | None:
    if isinstance(mask, xarray.DataArray):
        labeled = cast("DataArray", mask)
        if set(labeled.dims) != set(view.dims[:2]):
            raise ValueError(f"{name}: got dimensions {labeled.dims}; accepts {view.dims[:2]}")
        mask = labeled.transpose(*view.dims[:2]).to_numpy()
    return as_mask(mask, view.shape, name)

"""xarray in, xarray out: dimensions by name, masks, coordinates, and files that others can read."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo_bench.rendering import render_pair
from phasestereo_large import xarray as labeled
from support import counterpart

xarray = counterpart("xarray")

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from phasestereo_bench.datasets import Pair

COUNT = 16


@pytest.fixture(scope="module")
def rendered() -> Pair:
    return render_pair(5, height=70, width=110, num_disparities=COUNT)


def gray(image: NDArray[Any]) -> NDArray[np.uint8]:
    return image[:, :, 1].copy()


def views(rendered: Pair, **attrs: Any) -> list[Any]:
    """Return both images as rioxarray reads a georeferenced pair of one band."""
    coords = {
        "band": [1],
        "y": 4800000 - 0.5 * np.arange(70),
        "x": 500000 + 0.5 * np.arange(110),
        "spatial_ref": 0,
    }

    found = [
        xarray.DataArray(gray(image)[None], coords, ("band", "y", "x"), attrs=attrs)
        for image in (rendered.left, rendered.right)
    ]

    for image in found:
        image.coords["spatial_ref"].attrs["crs_wkt"] = "made up"
    return found


def test_it_is_the_match_of_the_arrays(rendered: Pair) -> None:
    left, right = views(rendered)
    told_nothing = labeled.match(left, right)
    assert told_nothing.attrs["num_disparities"] >= 8

    found = labeled.match(left, right, num_disparities=COUNT)
    plain = ps.match(gray(rendered.left), gray(rendered.right), num_disparities=COUNT)

    assert found["disparity"].dims == ("y", "x")
    np.testing.assert_array_equal(found["disparity"], plain.disparity)
    np.testing.assert_array_equal(found["flags"], plain.flags)
    assert plain.confidence is not None
    assert plain.uncertainty is not None
    np.testing.assert_array_equal(found["confidence"], plain.confidence)
    np.testing.assert_array_equal(found["uncertainty"], plain.uncertainty)
    assert found["uncertainty"].attrs["units"] == "pixel"


def test_coordinates_are_those_of_the_left_image(rendered: Pair) -> None:
    left, right = views(rendered)

    right = right.assign_coords(x=right.x + 33)
    found = labeled.match(left, right, num_disparities=COUNT)

    for name in ("y", "x", "spatial_ref"):
        xarray.testing.assert_identical(found.coords[name], left.coords[name].drop_vars("band",
                                        errors="ignore"))  # fmt: skip

    assert set(found.coords) == {"y", "x", "spatial_ref"}
    assert {found[name].attrs["grid_mapping"] for name in found.data_vars} == {"spatial_ref"}


@pytest.mark.parametrize("dims", [("y", "x", "band"), ("band", "x", "y"), ("x", "band", "y")])
def test_the_order_of_dimensions_does_not_matter(
    rendered: Pair, dims: tuple[str, str, str]
) -> None:
    pair = [
        xarray.DataArray(image, dims=("y", "x", "band")).transpose(*dims)
        for image in (rendered.left, rendered.right)
    ]

    found = labeled.match(*pair, num_disparities=COUNT, preset="fast")
    plain = ps.match(rendered.left, rendered.right, num_disparities=COUNT, preset="fast")
    assert found["disparity"].dims == ("y", "x")
    np.testing.assert_array_equal(found["disparity"], plain.disparity)
    assert list(found) == ["disparity", "flags"]


@pytest.mark.parametrize("dims", [("row", "col"), ("lat", "lon"), ("latitude", "longitude")])
def test_rows_and_columns_have_several_names(rendered: Pair, dims: tuple[str, str]) -> None:
    pair = [xarray.DataArray(gray(image), dims=dims) for image in (rendered.left, rendered.right)]
    assert labeled.match(*pair, num_disparities=COUNT)["disparity"].dims == dims


def test_flags_are_explained_as_cf_has_it(rendered: Pair) -> None:
    flags = labeled.match(*views(rendered), num_disparities=COUNT)["flags"]
    meanings = flags.attrs["flag_meanings"].split()
    assert flags.attrs["flag_masks"].dtype == flags.dtype == np.uint16
    assert dict(zip(meanings, flags.attrs["flag_masks"].tolist(), strict=True)) == {
        str(flag.name).lower(): int(flag) for flag in ps.Flag
    }


def test_attributes_tell_what_was_done(rendered: Pair) -> None:
    found = labeled.match(
        *views(rendered), num_disparities=COUNT, min_disparity=-2, preset="paper", window=7
    )

    assert json.loads(found.attrs["settings"])["window"] == 7
    assert (found.attrs["min_disparity"], found.attrs["num_disparities"]) == (-2, COUNT)
    assert found.attrs["source"] == f"phasestereo {ps.__version__}"
    assert "blur" not in found.attrs
    assert found["disparity"].attrs["units"] == "pixel"
    assert labeled.match(*views(rendered), num_disparities=COUNT).attrs["blur"]


def masked_alike(rendered: Pair, found: Any, left_mask: NDArray[np.bool_]) -> None:
    plain = ps.match(
        gray(rendered.left), gray(rendered.right), num_disparities=COUNT, left_mask=left_mask,
        preset="paper",
    )  # fmt: skip
    np.testing.assert_array_equal(found["disparity"], plain.disparity)
    np.testing.assert_array_equal(found["flags"], plain.flags)


@pytest.mark.parametrize("name", ["_FillValue", "missing_value", "nodata"])
@pytest.mark.parametrize("where", ["attrs", "encoding"])
def test_no_data_is_masked(rendered: Pair, name: str, where: str) -> None:
    left, right = views(rendered)
    left, right = left.astype(np.int16), right.astype(np.int16)
    left[0, 20:30, 40:50] = -32768
    getattr(left, where)[name] = -32768
    found = labeled.match(left, right, num_disparities=COUNT, preset="paper")
    masked_alike(rendered, found, left[0].to_numpy() != -32768)


@pytest.mark.parametrize(
    ("dtype", "nodata"), [("int32", -(2**31)), ("float64", -np.finfo("float64").max)]
)
def test_no_data_may_be_what_float32_does_not_hold(
    rendered: Pair, dtype: str, nodata: float
) -> None:
    left, right = (view.astype(dtype) for view in views(rendered, nodata=nodata))
    left[0, 20:30, 40:50] = nodata
    found = labeled.match(left, right, num_disparities=COUNT, preset="paper")
    masked_alike(rendered, found, left[0].to_numpy() != nodata)


@pytest.mark.parametrize("name", ["scale_factor", "add_offset"])
def test_the_no_data_of_packed_pixels_is_none_of_unpacked_ones(rendered: Pair, name: str) -> None:
    left, right = (view.astype(np.float32) for view in views(rendered))
    left.encoding = {"_FillValue": int(left[0, 30, 50]), name: 2}
    found = labeled.match(left, right, num_disparities=COUNT, preset="paper")
    masked_alike(rendered, found, np.ones(left.shape[1:], np.bool_))


def test_nan_is_masked(rendered: Pair) -> None:
    left, right = views(rendered)
    left, right = left.astype(np.float64), right.astype(np.float64)
    left[0, 20:30, 40:50] = np.nan
    found = labeled.match(left, right, num_disparities=COUNT, preset="paper")
    masked_alike(rendered, found, ~np.isnan(left[0].to_numpy()))


def test_given_masks_add_to_no_data(rendered: Pair) -> None:
    left, right = views(rendered)
    left[0, 20:30, 40:50] = 255
    left.attrs["nodata"] = 255

    mask = xarray.ones_like(left[0], dtype=np.bool_)
    mask[5:9] = False

    expected = (left[0].to_numpy() != 255) & mask.to_numpy()
    found = labeled.match(
        left, right, num_disparities=COUNT, preset="paper", left_mask=mask.transpose("x", "y")
    )
    masked_alike(rendered, found, expected)

    plain = labeled.match(
        left, right, num_disparities=COUNT, preset="paper", left_mask=mask.to_numpy()
    )
    xarray.testing.assert_identical(found, plain)


def test_masks_of_the_right_image_count(rendered: Pair) -> None:
    left, right = views(rendered)
    right[0, :, 60:] = 255
    right.attrs["_FillValue"] = 255

    found = labeled.match(left, right, num_disparities=COUNT, preset="paper")
    plain = ps.match(
        gray(rendered.left), right[0].to_numpy(), num_disparities=COUNT, preset="paper",
        right_mask=right[0].to_numpy() != 255,
    )  # fmt: skip
    np.testing.assert_array_equal(found["flags"], plain.flags)


def test_chunked_arrays_are_computed(rendered: Pair) -> None:
    counterpart("dask.array")
    left, right = views(rendered)
    mask = left[0] > 20
    chunked = [image.chunk({"y": 20, "x": 33}) for image in (left, right, mask)]
    assert all(image.chunks for image in chunked)
    found = labeled.match(*chunked[:2], num_disparities=COUNT, left_mask=chunked[2])
    expected = labeled.match(left, right, num_disparities=COUNT, left_mask=mask)
    xarray.testing.assert_identical(found, expected)
    assert isinstance(found["disparity"].data, np.ndarray)


def test_netcdf_and_dictionaries_hold_it_all(rendered: Pair, tmp_path: Path) -> None:
    counterpart("scipy.io")

    left, right = views(rendered)
    left[0, :10] = 255
    left.attrs["nodata"] = 255
    found = labeled.match(left, right, num_disparities=COUNT)

    found.to_netcdf(tmp_path / "a.nc", engine="scipy")
    with xarray.open_dataset(tmp_path / "a.nc", engine="scipy") as stored:
        for name in found.data_vars:
            np.testing.assert_array_equal(stored[name], found[name])
        np.testing.assert_array_equal(stored.x, found.x)
        assert stored["flags"].attrs["flag_meanings"] == found["flags"].attrs["flag_meanings"]
        assert json.loads(stored.attrs["settings"]) == json.loads(found.attrs["settings"])

    json.dumps(found.to_dict(data=False), default=lambda array: array.tolist())
    xarray.testing.assert_identical(xarray.Dataset.from_dict(found.to_dict()), found)


def test_results_can_be_labeled_by_themselves(rendered: Pair) -> None:
    result = ps.match(rendered.left, rendered.right, num_disparities=COUNT)

    assert labeled.as_dataset(result)["disparity"].dims == ("y", "x")
    assert set(labeled.as_dataset(result, like=views(rendered)[0]).coords) == {
        "y", "x", "spatial_ref"
    }  # fmt: skip

    with pytest.raises(ValueError, match=r"like: got \(9, 9\) pixels.*\(70, 110\)"):
        labeled.as_dataset(result, like=xarray.DataArray(np.zeros((9, 9)), dims=("y", "x")))
    with pytest.raises(TypeError, match="result: got ndarray; accepts a phasestereo.Result"):
        labeled.as_dataset(result.disparity)  # type: ignore[arg-type]  # the wrong type it is


def test_rows_must_correspond(rendered: Pair) -> None:
    left, right = views(rendered)
    with pytest.raises(ValueError, match="right: got coordinates 'y' up to 0.5 from"):
        labeled.match(left, right.assign_coords(y=right.y + 0.5), num_disparities=COUNT)
    rounded = right.assign_coords(y=right.y + 1e-5)
    labeled.match(left, rounded, num_disparities=COUNT, preset="fast")
    labeled.match(left, right.drop_vars("y"), num_disparities=COUNT, preset="fast")


@pytest.mark.parametrize(
    ("dims", "message"),
    [
        (("time", "x"), "left: got dimensions"),
        (("y", "band"), "left: got dimensions"),
        (("y", "lat"), "left: got dimensions"),
        (("y", "x", "band", "time"), "left: got dimensions"),
        (("y", "x", "row"), "left: got dimensions"),
    ],
)
def test_dimensions_that_tell_nothing_are_refused(dims: tuple[str, ...], message: str) -> None:
    image = xarray.DataArray(np.zeros((8,) * len(dims), np.uint8), dims=dims)
    with pytest.raises(ValueError, match=message):
        labeled.match(image, image, num_disparities=4)


def test_wrong_arguments_are_named(rendered: Pair) -> None:
    left, right = views(rendered)
    two = [xarray.concat([image, image], "band") for image in (left, right)]
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"left": left.to_numpy()}, "left: got ndarray; accepts an xarray.DataArray"),
        ({"right": right.to_dataset(name="a")}, "right: got Dataset"),
        ({"right": right[:, :, :100]}, r"right: got \(70, 100\) pixels"),
        ({"left": left.astype("complex64")}, "left: got samples of type complex64"),
        ({"left_mask": left[0, :, 0] > 0}, r"left_mask: got dimensions \('y',\)"),
        ({"right_mask": right[0]}, "right_mask: got dtype uint8"),
        ({"num_disparities": 0}, "num_disparities"),
        ({"left": left[:, :0], "right": right[:, :0]}, "left: got shape .*at least one pixel"),
        ({"left": two[0], "right": two[1]}, r"left: got shape \(70, 110, 2\)"),
    ]
    for change, error in wrong:
        given = {"left": left, "right": right, "num_disparities": COUNT} | change
        with pytest.raises((TypeError, ValueError), match=error):
            labeled.match(given.pop("left"), given.pop("right"), **given)

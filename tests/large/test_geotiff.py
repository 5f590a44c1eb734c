"""GeoTIFF, checked by rasterio itself: pixels, masks and georeferences come and go unchanged."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.io import read_image
from phasestereo_large.geotiff import (
    GeoImage,
    Georeference,
    read_geotiff,
    read_geotiff_pair,
    write_geotiff,
)
from support import counterpart

rasterio = counterpart("rasterio")
control = counterpart("rasterio.control")
rpc = counterpart("rasterio.rpc")

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

PLACE = Georeference(crs="EPSG:32631", transform=(0.5, 0, 500000.25, 0, -0.5, 4800000.75))
RPCS = rpc.RPC(
    height_off=1200.5,
    height_scale=700.25,
    lat_off=43.123456789,
    lat_scale=0.1,
    line_off=2000.5,
    line_scale=2000.0,
    line_num_coeff=[i / 7e3 for i in range(20)],
    line_den_coeff=[1.0, *(i / 9e5 for i in range(19))],
    long_off=1.987654321,
    long_scale=0.15,
    samp_off=1500.0,
    samp_scale=1500.0,
    samp_num_coeff=[-i / 3e4 for i in range(20)],
    samp_den_coeff=[1.0, *(i / 11e6 for i in range(19))],
    err_bias=0.5,
    err_rand=0.25,
)


def noise(shape: tuple[int, ...], dtype: str, seed: int = 0) -> NDArray[Any]:
    random = np.random.default_rng(seed)
    if np.dtype(dtype).kind == "f":
        return random.normal(0, 100, shape).astype(dtype)
    ends = np.iinfo(dtype)
    return random.integers(max(ends.min, -30000), min(ends.max, 30000), shape, dtype)


def names(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


def save(path: Path, planes: NDArray[Any], **profile: Any) -> Path:
    """Write bands (count, H, W) by rasterio alone."""
    mask, colors = profile.pop("mask", None), profile.pop("colors", None)

    count, height, width = planes.shape
    profile = {"crs": "EPSG:32631", "transform": rasterio.Affine(*PLACE.transform)} | profile
    size = {"count": count, "height": height, "width": width, "dtype": planes.dtype.name}

    with rasterio.open(path, "w", driver="GTiff", **size, **profile) as file:
        file.write(planes)
        if colors is not None:
            file.colorinterp = [rasterio.enums.ColorInterp[name] for name in colors]
        if mask is not None:
            file.write_mask(mask)

    return path


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
@pytest.mark.parametrize("channels", [(), (3,)])
def test_images_round_trip(tmp_path: Path, dtype: str, channels: tuple[int, ...]) -> None:
    image = noise((37, 301, *channels), dtype)
    write_geotiff(tmp_path / "image.tif", image, like=PLACE, tags={"SENSOR": "made up"})

    found = read_geotiff(tmp_path / "image.tif")
    assert found.image.dtype == dtype
    np.testing.assert_array_equal(found.image, image)

    assert found.mask is None
    assert found.tags["SENSOR"] == "made up"
    assert found.georeference.crs.to_epsg() == 32631
    assert tuple(found.georeference.transform)[:6] == PLACE.transform

    np.testing.assert_array_equal(read_image(tmp_path / "image.tif"), image)  # as tifffile has it


def test_disparities_are_what_rasterio_reads(tmp_path: Path) -> None:
    disparity = noise((300, 270), "float32")
    disparity[10:20, 30:50] = np.nan

    write_geotiff(tmp_path / "disparity.tif", disparity, like=PLACE)

    with rasterio.open(tmp_path / "disparity.tif") as file:
        np.testing.assert_array_equal(file.read(1), disparity)
        np.testing.assert_array_equal(file.read_masks(1) == 0, np.isnan(disparity))
        assert np.isnan(file.nodata)
        assert file.crs.to_epsg() == 32631
        assert tuple(file.transform)[:6] == PLACE.transform
        profile = file.profile

    assert (profile["tiled"], profile["compress"], profile["blockxsize"]) == (True, "deflate", 256)
    np.testing.assert_array_equal(ps.io.read_disparity(tmp_path / "disparity.tif"), disparity)


def test_bands_have_names_and_one_type_that_holds_all(tmp_path: Path) -> None:
    bands = {"disparity": noise((20, 30), "float32"), "flags": noise((20, 30), "uint16")}
    write_geotiff(tmp_path / "out.tif", bands, like=PLACE)

    with rasterio.open(tmp_path / "out.tif") as file:
        assert file.descriptions == ("disparity", "flags")
        np.testing.assert_array_equal(file.read(1), bands["disparity"])
        np.testing.assert_array_equal(file.read(2), bands["flags"])

    np.testing.assert_array_equal(
        read_geotiff(tmp_path / "out.tif", bands=[2]).image, bands["flags"]
    )


def test_bands_by_name_are_no_colors(tmp_path: Path) -> None:
    bands = {name: np.zeros((20, 30), np.uint8) for name in "abcd"}  # d: not transparent everywhere
    write_geotiff(tmp_path / "out.tif", bands)
    with pytest.raises(ValueError, match=r"4 \(1 a, 2 b, 3 c, 4 d\) and no colors"):
        read_geotiff(tmp_path / "out.tif")
    assert read_geotiff(tmp_path / "out.tif", bands=[1]).mask is None


@pytest.mark.parametrize("dtype", [">u2", ">f4", ">f8"])
def test_the_order_of_bytes_does_not_matter(tmp_path: Path, dtype: str) -> None:
    image = np.arange(600, dtype=dtype).reshape(20, 30)
    write_geotiff(tmp_path / "one.tif", image)
    write_geotiff(tmp_path / "many.tif", {"a": image})
    for name in ("one.tif", "many.tif"):
        np.testing.assert_array_equal(read_geotiff(tmp_path / name).image, image)


def test_tags_that_were_read_can_be_written(tmp_path: Path) -> None:
    point = Georeference(crs="EPSG:32631", transform=PLACE.transform, point=True)
    image = np.zeros((4, 5), np.uint8)
    write_geotiff(tmp_path / "a.tif", image, like=PLACE, tags={"SENSOR": "made up"})
    tags = read_geotiff(tmp_path / "a.tif").tags
    assert tags["AREA_OR_POINT"] == "Area"

    write_geotiff(tmp_path / "b.tif", image, like=point, tags=tags)
    found = read_geotiff(tmp_path / "b.tif")
    assert found.tags == {**tags, "AREA_OR_POINT": "Point"}

    assert found.georeference.point


def test_rpcs_and_the_kind_of_pixel_are_kept(tmp_path: Path) -> None:
    place = Georeference(rpcs=RPCS, point=True, crs="EPSG:4326", transform=(2, 0, 1, 0, -2, 50))
    write_geotiff(tmp_path / "sensor.tif", noise((20, 30), "uint16"), like=place)

    found = read_geotiff(tmp_path / "sensor.tif")
    write_geotiff(tmp_path / "out.tif", noise((20, 30), "float32"), like=found)

    with rasterio.open(tmp_path / "out.tif") as file:
        for name, value in RPCS.to_dict().items():
            assert getattr(file.rpcs, name) == pytest.approx(value, rel=1e-14), name
        assert file.tags()["AREA_OR_POINT"] == "Point"
        assert tuple(file.transform)[:6] == (2, 0, 1, 0, -2, 50)

    assert read_geotiff(tmp_path / "out.tif").georeference.point


def test_rpcs_alone_are_no_reference_system(tmp_path: Path) -> None:
    image = noise((20, 30), "uint16")
    write_geotiff(tmp_path / "sensor.tif", image, like=Georeference(rpcs=RPCS))
    found = read_geotiff(tmp_path / "sensor.tif").georeference
    assert (found.crs, found.transform, found.gcps) == (None, None, ())
    assert found.rpcs.lat_off == RPCS.lat_off


def test_ground_control_points_are_kept(tmp_path: Path) -> None:
    points = [
        control.GroundControlPoint(row, col, 2 + col / 100, 48 - row / 100, 12.5)
        for row, col in ((0, 0), (0, 29), (19, 0), (19, 29))
    ]

    place = Georeference(crs="EPSG:4326", gcps=tuple(points))
    write_geotiff(tmp_path / "left.tif", noise((20, 30), "uint8"), like=place)
    write_geotiff(tmp_path / "out.tif", noise((20, 30), "float32"), like=read_geotiff(
        tmp_path / "left.tif"))  # fmt: skip

    with rasterio.open(tmp_path / "out.tif") as file:
        found, crs = file.gcps

    assert crs.to_epsg() == 4326
    assert [(p.row, p.col, p.x, p.y, p.z) for p in found] == [
        (p.row, p.col, p.x, p.y, p.z) for p in points
    ]


def test_images_without_any_place_are_no_mistake(tmp_path: Path) -> None:
    image = noise((20, 30), "uint8")
    write_geotiff(tmp_path / "epipolar.tif", image)
    found = read_geotiff(tmp_path / "epipolar.tif")
    np.testing.assert_array_equal(found.image, image)
    assert found.georeference == Georeference()


def test_a_color_is_no_data_where_all_its_bands_are(tmp_path: Path) -> None:
    planes = noise((3, 20, 30), "uint8") | 1
    planes[:, 3:6] = 0
    planes[1, 10:12] = 0  # a color without green
    found = read_geotiff(save(tmp_path / "a.tif", planes, nodata=0, photometric="rgb"))
    assert found.mask is not None
    assert np.flatnonzero(~found.mask.all(axis=1)).tolist() == [3, 4, 5]
    assert found.image.shape == (20, 30, 3)


@pytest.mark.parametrize("nodata", [None, 9])
def test_alpha_is_a_mask(tmp_path: Path, nodata: int | None) -> None:
    planes = noise((4, 20, 30), "uint8")
    planes[:3, 5] = 9
    planes[3] = 255
    planes[3, :, :4] = 0

    found = read_geotiff(
        save(tmp_path / "a.tif", planes, photometric="rgb", alpha="yes", nodata=nodata)
    )

    valid = planes[3] > 0
    if nodata is not None:
        valid &= (planes[:3] != nodata).any(axis=0)

    assert found.mask is not None
    np.testing.assert_array_equal(found.mask, valid)
    np.testing.assert_array_equal(found.image, np.moveaxis(planes[:3], 0, 2))


@pytest.mark.parametrize("internal", ["YES", "NO"])
def test_mask_bands_count_within_and_beside_the_file(tmp_path: Path, internal: str) -> None:
    mask = np.full((20, 30), 255, np.uint8)
    mask[:, 25:] = 0

    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=internal):
        save(tmp_path / "a.tif", noise((1, 20, 30), "uint8"), mask=mask)

    assert (tmp_path / "a.tif.msk").exists() == (internal == "NO")
    found = read_geotiff(tmp_path / "a.tif").mask
    assert found is not None
    np.testing.assert_array_equal(found, mask > 0)


def test_nan_is_masked_without_being_declared(tmp_path: Path) -> None:
    plane = noise((1, 20, 30), "float64")
    plane[0, 4] = np.nan
    found = read_geotiff(save(tmp_path / "a.tif", plane))
    assert found.image.dtype == np.float32
    assert found.mask is not None
    assert np.flatnonzero(~found.mask.all(axis=1)).tolist() == [4]


@pytest.mark.parametrize("dtype", ["int16", "int32", "uint32", "int8"])
def test_other_integers_become_floats_exactly(tmp_path: Path, dtype: str) -> None:
    plane = noise((1, 20, 30), dtype)
    plane[0, 2, 3] = np.iinfo("int8").max
    found = read_geotiff(save(tmp_path / "a.tif", plane, nodata=127))
    assert found.image.dtype == np.float32
    np.testing.assert_array_equal(found.image, plane[0])
    assert found.mask is not None
    assert not found.mask[2, 3]


@pytest.mark.parametrize(
    ("dtype", "nodata"),
    [("int32", -(2**31)), ("uint32", 2**32 - 1), ("float64", -np.finfo("float64").max)],
)
def test_no_data_may_be_what_float32_does_not_hold(
    tmp_path: Path, dtype: str, nodata: float
) -> None:
    plane = noise((3, 20, 30), dtype)
    plane[:, 4:7] = nodata

    for planes, colors in ((plane[:1], None), (plane, ["red", "green", "blue"])):
        found = read_geotiff(save(tmp_path / "a.tif", planes, nodata=nodata, colors=colors))
        assert found.mask is not None
        assert np.flatnonzero(~found.mask.all(axis=1)).tolist() == [4, 5, 6]
        kept = np.squeeze(np.moveaxis(planes, 0, 2))[found.mask]
        np.testing.assert_array_equal(found.image[found.mask], kept.astype(np.float32))


def test_a_palette_is_looked_up(tmp_path: Path) -> None:
    plane = noise((1, 20, 30), "uint8") % 4
    save(tmp_path / "a.tif", plane, photometric="palette")
    colors = {0: (9, 8, 7, 255), 1: (255, 0, 0, 255), 2: (0, 255, 0, 255), 3: (0, 0, 255, 255)}
    with rasterio.open(tmp_path / "a.tif", "r+") as file:
        file.write_colormap(1, colors)
    expected = np.array([color[:3] for color in colors.values()], np.uint8)[plane[0]]
    np.testing.assert_array_equal(read_geotiff(tmp_path / "a.tif").image, expected)


def test_bands_are_chosen(tmp_path: Path) -> None:
    planes = noise((5, 20, 30), "uint16")

    save(tmp_path / "a.tif", planes, photometric="minisblack")
    with pytest.raises(ValueError, match=r"a\.tif: bands: the file has 5 .*choose 1 or 3"):
        read_geotiff(tmp_path / "a.tif")

    np.testing.assert_array_equal(read_geotiff(tmp_path / "a.tif", bands=[4]).image, planes[3])
    found = read_geotiff(tmp_path / "a.tif", bands=[3, 2, 1]).image
    np.testing.assert_array_equal(found, np.moveaxis(planes[[2, 1, 0]], 0, 2))

    with pytest.raises(ValueError, match=r"bands: got \[6\]; accepts 1 to 5"):
        read_geotiff(tmp_path / "a.tif", bands=[6])


def test_colors_follow_the_file_not_their_order(tmp_path: Path) -> None:
    planes = noise((4, 20, 30), "uint16")
    save(tmp_path / "a.tif", planes, colors=["blue", "green", "red", "undefined"])
    found = read_geotiff(tmp_path / "a.tif").image
    np.testing.assert_array_equal(found, np.moveaxis(planes[[2, 1, 0]], 0, 2))


@pytest.mark.parametrize(
    ("bands", "kind", "message"),
    [
        ([1, 2], ValueError, "bands: got 2; accepts one, or three"),
        ([], ValueError, "bands: got 0"),
        ("123", TypeError, "bands: got '123'"),
        (3, TypeError, "bands: got 3; accepts the numbers of one or three bands"),
        ([1.5], TypeError, "bands"),
    ],
)
def test_wrong_bands_are_refused(
    tmp_path: Path, bands: Any, kind: type[Exception], message: str
) -> None:
    with pytest.raises(kind, match=message):
        read_geotiff(tmp_path / "none.tif", bands=bands)


@pytest.mark.parametrize(
    ("planes", "message"),
    [
        (np.ones((1, 8, 8), np.complex64), "complex64"),
        (np.full((1, 8, 8), 2**24 + 1, np.int32), "int32 samples beyond 2\\*\\*24"),
        (np.full((1, 8, 8), 1e300), "float64 samples beyond the range of float32"),
    ],
)
def test_samples_that_are_no_image_are_refused(
    tmp_path: Path, planes: NDArray[Any], message: str
) -> None:
    save(tmp_path / "a.tif", planes)
    with pytest.raises(ValueError, match=rf"a\.tif: .*{message}"):
        read_geotiff(tmp_path / "a.tif")


def test_missing_and_foreign_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"missing\.tif"):
        read_geotiff(tmp_path / "missing.tif")
    (tmp_path / "text.tif").write_text("no image")
    with pytest.raises(ValueError, match=r"text\.tif"):
        read_geotiff(tmp_path / "text.tif")


@pytest.mark.parametrize("share", [0.001, 0.02, 0.3, 0.7, 0.999])
def test_truncated_files_are_refused_by_name(tmp_path: Path, share: float) -> None:
    write_geotiff(tmp_path / "a.tif", noise((300, 600), "uint16"), like=PLACE)
    whole = (tmp_path / "a.tif").read_bytes()
    (tmp_path / "a.tif").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(ValueError, match=r"a\.tif"):
        read_geotiff(tmp_path / "a.tif")


def pair(tmp_path: Path, left: Georeference | None, right: Georeference | None) -> list[Path]:
    paths = [tmp_path / "left.tif", tmp_path / "right.tif"]
    for path, place in zip(paths, (left, right), strict=True):
        write_geotiff(path, noise((20, 30), "uint8"), like=place)
    return paths


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (Georeference(crs="EPSG:32632", transform=PLACE.transform), "EPSG:32632.*EPSG:32631"),
        (Georeference(crs="EPSG:32631", transform=(0.6, 0, 1, 0, -0.6, 2)), "0.6 x 0.6.*0.5 x 0.5"),
    ],
)
def test_images_that_are_no_pair_are_refused(
    tmp_path: Path, other: Georeference, message: str
) -> None:
    with pytest.raises(ValueError, match=rf"right\.tif: got .*{message}"):
        read_geotiff_pair(*pair(tmp_path, PLACE, other))


def test_pairs_of_other_sizes_are_refused(tmp_path: Path) -> None:
    paths = pair(tmp_path, PLACE, PLACE)
    write_geotiff(paths[1], noise((20, 31), "uint8"))
    with pytest.raises(ValueError, match=r"right\.tif: got \(20, 31\)"):
        read_geotiff_pair(*paths)


@pytest.mark.parametrize(
    "other", [None, Georeference(crs="EPSG:32631", transform=(0.5, 0, 77, 0, -0.5, 88))]
)
def test_pairs_may_lie_anywhere(tmp_path: Path, other: Georeference | None) -> None:
    left, right = read_geotiff_pair(*pair(tmp_path, PLACE, other))
    assert isinstance(left, GeoImage)
    assert left.georeference != right.georeference


@pytest.mark.parametrize(
    ("image", "like", "kind", "message"),
    [
        (np.zeros((4, 5, 2), np.uint8), None, ValueError, r"image: got shape \(4, 5, 2\)"),
        (np.zeros((0, 5), np.uint8), None, ValueError, "image: got shape"),
        (np.zeros((4, 5), np.int16), None, TypeError, "image: got dtype int16"),
        (np.full((4, 5), 1e300), None, ValueError, "image: got float64 samples beyond"),
        ({"a": np.zeros((4, 5), np.bool_)}, None, TypeError, "a: got dtype bool"),
        ({"a": np.zeros((4, 5, 3), np.uint8)}, None, ValueError, "image: got bands of shapes"),
        ({}, None, ValueError, "image: got bands"),
        (np.zeros((4, 5), np.uint8), "EPSG:32631", TypeError, "like: got str"),
        (np.zeros((4, 5), np.uint8), Georeference(crs="Mars"), ValueError, "crs: got 'Mars'"),
        (np.zeros((4, 5), np.uint8), Georeference(transform=(1, 2)), ValueError, "transform: got"),
    ],
)
def test_what_cannot_be_written_leaves_no_file(
    tmp_path: Path, image: Any, like: Any, kind: type[Exception], message: str
) -> None:
    (tmp_path / "a.tif").write_bytes(b"before")
    with pytest.raises(kind, match=message):
        write_geotiff(tmp_path / "a.tif", image, like=like)
    assert (tmp_path / "a.tif").read_bytes() == b"before"
    assert names(tmp_path) == ["a.tif"]

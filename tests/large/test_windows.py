"""Rasters read by windows: what comes out is what the whole file holds there, or a clear error."""

from __future__ import annotations

import gzip
import re
import struct
import sys
from os import truncate
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from phasestereo.io import read_image, write_image
from phasestereo_large.geotiff import Georeference, read_geotiff, write_geotiff
from phasestereo_large.windows import open_pair, open_raster
from support import counterpart

rasterio = counterpart("rasterio")
shutil = counterpart("rasterio.shutil")
tifffile = counterpart("tifffile")
zarr = counterpart("zarr")
numcodecs = counterpart("numcodecs")

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

HEIGHT, WIDTH = 300, 130
PLACE = Georeference(crs="EPSG:32631", transform=(0.5, 0, 500000, 0, -0.5, 4800000))
WINDOWS = [
    (0, HEIGHT, None),
    (0, 1, None),
    (63, 65, (7, 9)),
    (120, HEIGHT, (0, 64)),
    (HEIGHT - 1, HEIGHT, (WIDTH - 1, WIDTH)),
]


def noise(*shape: int, dtype: str = "uint8") -> NDArray[Any]:
    random = np.random.default_rng(0)
    if dtype == "float32":
        return random.normal(0, 9, shape).astype(dtype)
    return random.integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)


def save(path: Path, planes: NDArray[Any], **profile: Any) -> Path:
    """Write bands (count, H, W) by rasterio alone."""
    count, height, width = planes.shape
    profile = {"crs": "EPSG:32631", "transform": rasterio.Affine(*PLACE.transform)} | profile
    size = {"count": count, "height": height, "width": width, "dtype": planes.dtype.name}
    with rasterio.open(path, "w", driver="GTiff", **size, **profile) as file:
        file.write(planes)
    return path


def check(path: Path, image: NDArray[Any], mask: NDArray[np.bool_] | None = None) -> None:
    """Hold every window of a file against the same part of what the whole of it holds."""
    with open_raster(path) as raster:
        assert (raster.size, raster.dtype) == (image.shape[:2], image.dtype)
        assert raster.itemsize == image[0, 0].nbytes

        for first, last, columns in WINDOWS:
            pixels, valid = raster.read(first, last, columns)
            part = slice(first, last), slice(*(columns or (0, WIDTH)))
            np.testing.assert_array_equal(pixels, image[part], strict=True)

            counts = np.ones(image.shape[:2], bool) if mask is None else mask
            assert (valid is None) == counts[part].all()
            if valid is not None:
                np.testing.assert_array_equal(valid, counts[part], strict=True)


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
@pytest.mark.parametrize("channels", [(), (3,)])
@pytest.mark.parametrize("ending", ["tif", "npy", "zarr"])
def test_windows_hold_what_the_whole_holds(
    tmp_path: Path, ending: str, channels: tuple[int, ...], dtype: str
) -> None:
    image = noise(HEIGHT, WIDTH, *channels, dtype=dtype)
    path = tmp_path / f"image.{ending}"
    if ending == "tif":
        write_geotiff(path, image)
    elif ending == "npy":
        np.save(path, image)
    else:
        zarr.create_array(path, data=image, chunks=(70, 50, *channels))

    check(path, image)


@pytest.mark.parametrize("profile", [
    {"tiled": True, "blockxsize": 64, "blockysize": 16, "compress": "lzw"},
    {"blockysize": 7, "compress": "deflate"},
    {"blockysize": HEIGHT, "compress": "deflate"},
    {"bigtiff": "yes"},
    {"driver": "COG"},
])  # fmt: skip
def test_tiffs_of_any_layout_are_read(tmp_path: Path, profile: dict[str, Any]) -> None:
    planes = noise(1, HEIGHT, WIDTH, dtype="uint16")
    path = tmp_path / "image.tif"
    if profile.pop("driver", None):
        draft = save(tmp_path / "draft.tif", planes)
        shutil.copy(draft, path, driver="COG", blocksize=128)
    else:
        save(path, planes, **profile)

    check(path, planes[0])


def test_a_plain_tiff_is_read(tmp_path: Path) -> None:
    path = tmp_path / "image.tif"
    write_image(path, noise(HEIGHT, WIDTH, 3))
    check(path, read_image(path))


@pytest.mark.parametrize("kind", ["nodata", "nan", "mask", "alpha", "int16", "palette"])
def test_windows_are_those_of_the_geotiff(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "image.tif"
    planes = noise(1, HEIGHT, WIDTH)
    if kind == "nodata":
        planes[:, 100:140] = 7
        save(path, planes, nodata=7)
    elif kind == "nan":
        save(path, np.where(planes < 9, np.float32(np.nan), planes).astype(np.float32))
    elif kind == "mask":
        save(path, planes)
        with rasterio.open(path, "r+") as file:
            file.write_mask(planes[0] > 99)
    elif kind == "alpha":
        save(path, noise(4, HEIGHT, WIDTH), photometric="rgb", alpha="yes")
        with rasterio.open(path, "r+") as file:
            file.write(np.where(planes[0] > 99, 255, 0).astype(np.uint8), 4)
    elif kind == "int16":
        save(path, planes.astype(np.int16) - 100, nodata=-99)
    else:
        save(path, planes, photometric="palette")
        with rasterio.open(path, "r+") as file:
            file.write_colormap(1, {level: (level, 0, 255 - level, 255) for level in range(256)})

    whole = read_geotiff(path)
    check(path, whole.image, whole.mask)


@pytest.mark.parametrize("attribute", ["_FillValue", "missing_value", "nodata"])
def test_what_a_zarr_array_calls_no_data_is_masked(tmp_path: Path, attribute: str) -> None:
    image = noise(HEIGHT, WIDTH, dtype="uint16")
    image[40:70, 5:80] = 12
    array = zarr.create_array(tmp_path / "image.zarr", data=image, chunks=(64, 64))
    array.attrs[attribute] = 12
    check(tmp_path / "image.zarr", image, image != 12)


def test_a_leading_band_of_a_zarr_array_and_nan_of_npy(tmp_path: Path) -> None:
    image = noise(HEIGHT, WIDTH, dtype="float32")
    zarr.create_array(tmp_path / "image.zarr", data=image[np.newaxis], chunks=(1, 64, 64))
    check(tmp_path / "image.zarr", image)
    image[3:9] = np.nan
    np.save(tmp_path / "image.npy", image)
    check(tmp_path / "image.npy", image, ~np.isnan(image))


def test_chosen_bands_are_read(tmp_path: Path) -> None:
    planes = noise(5, 20, 30)
    path = save(tmp_path / "image.tif", planes, photometric="minisblack")
    with open_raster(path, bands=[4]) as raster:
        np.testing.assert_array_equal(raster.read(3, 9)[0], planes[3, 3:9])
    with pytest.raises(ValueError, match="bands: the file has 5"), open_raster(path):
        pass


def test_georeferences_are_those_of_the_file(tmp_path: Path) -> None:
    write_geotiff(tmp_path / "image.tif", noise(20, 30), like=PLACE)
    with open_raster(tmp_path / "image.tif") as raster:
        assert raster.georeference == read_geotiff(tmp_path / "image.tif").georeference


# Pairs


def test_a_pair_is_read_with_masks_of_all_kinds(tmp_path: Path) -> None:
    left, right = noise(2, HEIGHT, WIDTH)

    save(tmp_path / "left.tif", left[np.newaxis], nodata=3)
    np.save(tmp_path / "right.npy", right)
    np.save(tmp_path / "mask.npy", left > 50)
    write_image(tmp_path / "mask.tif", right // 99)

    with open_pair(
        tmp_path / "left.tif",
        tmp_path / "right.npy",
        left_mask=tmp_path / "mask.npy",
        right_mask=tmp_path / "mask.tif",
    ) as pair:
        assert (pair.size, pair.itemsize, len(pair.rasters)) == ((HEIGHT, WIDTH), 1, 4)
        found = pair.reader((10, 100))(60, 200)
    part = slice(60, 200), slice(10, 100)
    for got, expected in zip(found, (left, right, left > 50, right >= 99), strict=True):
        np.testing.assert_array_equal(got, expected[part])


@pytest.mark.parametrize(("change", "error"), [
    ({"planes": noise(1, 20, 31)}, r"right.tif: got \(20, 31\) pixels; accepts the size of left"),
    ({"crs": "EPSG:32632"}, "right.tif: got EPSG:32632; accepts the reference system of"),
    ({"transform": rasterio.Affine(1, 0, 5, 0, -1, 0)}, "right.tif: got pixels of 1 x 1; accepts"),
    ({"planes": noise(1, 20, 30, dtype="uint16")}, "right.tif: got uint16; accepts the type of"),
])  # fmt: skip
def test_what_is_no_pair_is_refused(tmp_path: Path, change: dict[str, Any], error: str) -> None:
    left = save(tmp_path / "left.tif", noise(1, 20, 30))
    right = save(tmp_path / "right.tif", **{"planes": noise(1, 20, 30)} | change)
    with pytest.raises((TypeError, ValueError), match=error), open_pair(left, right):
        pass


@pytest.mark.parametrize(("mask", "error"), [
    (noise(20, 31), r"got \(20, 31\) pixels; accepts those of the image"),
    (noise(20, 30, dtype="float32"), "a mask has 8 or 16-bit samples, this has float32"),
])  # fmt: skip
def test_what_is_no_mask_is_refused(tmp_path: Path, mask: NDArray[Any], error: str) -> None:
    path = tmp_path / "image.npy"
    np.save(path, noise(20, 30))

    np.save(tmp_path / "mask.npy", mask)
    with (
        pytest.raises(ValueError, match=f"mask.npy: {error}"),
        open_pair(path, path, right_mask=tmp_path / "mask.npy"),
    ):
        pass


# Damage


def rows_of(error: pytest.ExceptionInfo[Exception]) -> tuple[int, int]:
    found = re.search(r"rows (\d+) to (\d+)", str(error.value))
    assert found, error.value
    return int(found[1]), int(found[2])


@pytest.mark.parametrize("compress", ["deflate", None])
def test_rows_beyond_the_end_of_a_truncated_tiff_are_reported(
    tmp_path: Path, compress: str | None
) -> None:
    planes = noise(1, HEIGHT, WIDTH, dtype="uint16")
    path = save(tmp_path / "image.tif", planes, blockysize=8, compress=compress)
    path.write_bytes(path.read_bytes()[: -(100 * WIDTH * 2)])

    with open_raster(path) as raster:
        np.testing.assert_array_equal(raster.read(0, 128)[0], planes[0, :128])
        with pytest.raises(ValueError, match="image.tif: rows .* cannot be read: ") as error:
            raster.read(100, HEIGHT)

    first, last = rows_of(error)
    assert 128 <= first <= 200 <= last + 8


def test_a_damaged_tile_is_reported(tmp_path: Path) -> None:
    profile = {"tiled": True, "blockxsize": 64, "blockysize": 64, "compress": "deflate"}
    path = save(tmp_path / "image.tif", noise(1, HEIGHT, WIDTH), **profile)

    with tifffile.TiffFile(path) as file:
        offset = file.pages[0].dataoffsets[7]  # the third row of tiles

    content = bytearray(path.read_bytes())
    content[offset : offset + 900] = bytes(900)
    path.write_bytes(content)

    with open_raster(path) as raster:
        raster.read(0, 128)
        with pytest.raises(ValueError, match="cannot be read: ") as error:
            raster.read(0, HEIGHT)
        assert rows_of(error) == (128, 191)


ZSTD, BLOSC, GZIP = zarr.codecs.ZstdCodec(), zarr.codecs.BloscCodec(), zarr.codecs.GzipCodec()


@pytest.mark.parametrize(("packer", "content", "message"), [
    (ZSTD, b"nonsense", ""),
    (ZSTD, b"\x28\xb5\x2f\xfd\xe0" + bytes([0, 0, 0, 0, 1, 0, 0, 0, 0]), "to 4294967296 bytes"),
    (ZSTD, b"\x28\xb5\x2f\xfd\x00\x58" + bytes(9), "unpacks to 108097 bytes or more"),  # unsaid
    (ZSTD, b"\x28\xb5", "not packed by zstd"),
    (BLOSC, b"\x02\x01\x94\x01" + b"\xff\xff\xff\x7f" + bytes(40), "to 2147483647 bytes"),
    (GZIP, gzip.compress(bytes(2**24), mtime=0), "at most 108096 are read"),
    (GZIP, 2 * gzip.compress(bytes(100), mtime=0), "at most 108096 are read"),
    (GZIP, None, "c/1/0: has 1073741825 bytes; at most 1073741824"),
])  # fmt: skip
def test_a_damaged_or_hostile_chunk_of_a_zarr_array_is_refused(
    tmp_path: Path, packer: Any, content: bytes | None, message: str
) -> None:
    path, image = tmp_path / "image.zarr", noise(HEIGHT, WIDTH)
    zarr.create_array(path, data=image, chunks=(100, WIDTH), compressors=packer)
    check(path, image)
    (path / "c/1/0").write_bytes(content or b"")
    if content is None:
        truncate(path / "c/1/0", 2**30 + 1)
    with open_raster(path) as raster:
        raster.read(0, 100)
        with pytest.raises(ValueError, match=f"image.zarr: rows 100 to 199 .*{message}"):
            raster.read(0, HEIGHT)


@pytest.mark.parametrize("first", [HEIGHT - 1, 0])  # some of a shard, or all of it
def test_a_hostile_chunk_within_a_shard_is_refused(tmp_path: Path, first: int) -> None:
    path, image = tmp_path / "image.zarr", noise(HEIGHT, WIDTH)
    layout = {"chunks": (HEIGHT // 2, WIDTH), "shards": (HEIGHT, WIDTH)}
    array = zarr.create_array(path, shape=image.shape, dtype="u1", compressors=ZSTD, **layout)
    array[:] = np.ones_like(image)
    shard = bytearray((path / "c/0/0").read_bytes())
    check(path, np.ones_like(image))

    place = shard.rindex(b"\x28\xb5\x2f\xfd")
    assert shard[place + 4] >> 5 == 3  # a size of two bytes, which follows
    shard[place + 4 : place + 13] = b"\xe0" + struct.pack("<Q", 2**32)
    (path / "c/0/0").write_bytes(shard)
    with (
        open_raster(path) as raster,
        pytest.raises(ValueError, match=r"image.zarr: rows .* unpacks to 4294967296 bytes"),
    ):
        raster.read(first, HEIGHT)


@pytest.mark.parametrize("packer", ["zlib", "lz4", "lzma", None])
def test_arrays_of_the_second_version_of_zarr_are_read_if_they_are_bounded(
    tmp_path: Path, packer: str | None
) -> None:
    path, image = tmp_path / "image.zarr", noise(HEIGHT, WIDTH)
    more = {"compressor": packer and numcodecs.get_codec({"id": packer}), "zarr_format": 2}
    zarr.create(image.shape, chunks=(100, WIDTH), dtype="u1", store=path, **more)[:] = image
    if packer == "lzma":
        with pytest.raises(ValueError, match="image.zarr: .*packed by lzma; accepts one of zstd"):
            open_raster(path).__enter__()
    else:
        check(path, image)


def test_a_file_that_shrinks_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "image.npy"
    np.save(path, noise(HEIGHT, WIDTH))
    with open_raster(path) as raster:
        path.write_bytes(path.read_bytes()[:-1000])
        with pytest.raises(
            ValueError, match="rows 256 to 299 cannot be read: the file ends before"
        ):
            raster.read(200, HEIGHT)


@pytest.mark.parametrize(("array", "error"), [
    (np.asfortranarray(noise(20, 30)), "the array is in Fortran order"),
    (noise(20), r"an array of shape \(20,\)"),
    (noise(20, 30, 5), "got 5 channels; accepts 1, 3 and 4"),
    (noise(20, 30).astype(complex), "samples of type complex128"),
    (noise(20, 0), r"got \(20, 0\) pixels"),
    (np.full((20, 30), 2**25), "int64 samples beyond"),
])  # fmt: skip
def test_arrays_that_are_no_images_are_refused(
    tmp_path: Path, array: NDArray[Any], error: str
) -> None:
    np.save(tmp_path / "image.npy", array)
    with (
        pytest.raises(ValueError, match=f"image.npy: .*{error}"),
        open_raster(tmp_path / "image.npy"),
    ):
        pass


def test_other_files_are_refused(tmp_path: Path) -> None:
    write_image(tmp_path / "image.png", noise(20, 30))
    (tmp_path / "folder").mkdir()
    (tmp_path / "image.tif").write_bytes(b"II*\0nonsense")
    np.save(tmp_path / "image.npy", noise(20, 30))

    with (tmp_path / "image.npy").open("ab") as file:
        file.write(b"more")

    for name, error in [
        ("image.png", "cannot be read by parts; these can: TIFF"),
        ("folder", "a folder, and no Zarr array"),
        ("image.tif", "image.tif: "),
        ("image.npy", "the header asks for 728 bytes, but the file has 732"),
    ]:
        with pytest.raises(ValueError, match=error), open_raster(tmp_path / name):
            pass

    with pytest.raises(FileNotFoundError), open_raster(tmp_path / "absent.tif"):
        pass


@pytest.mark.parametrize(("module", "extra"), [("rasterio", "geo"), ("zarr", "large")])
def test_what_is_missing_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, extra: str
) -> None:
    tifffile.imwrite(tmp_path / "image.rasterio", noise(20, 30))
    zarr.create_array(tmp_path / "image.zarr", data=noise(20, 30))

    monkeypatch.setitem(sys.modules, module, None)
    with (
        pytest.raises(ImportError, match=rf"phasestereo\[{extra}\]"),
        open_raster(tmp_path / f"image.{module}"),
    ):
        pass

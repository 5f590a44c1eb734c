"""Pairs larger than memory: the bits of `ps.match`, whatever ends a run and whenever."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.result import LAYERS
from phasestereo.settings import PresetName
from phasestereo_large import outofcore
from phasestereo_large.geotiff import Georeference, read_geotiff, write_geotiff
from phasestereo_large.outofcore import as_bytes, format_bytes, sinks
from phasestereo_large.windows import open_raster
from support import EndingError, counterpart

rasterio = counterpart("rasterio")
zarr = counterpart("zarr")
counterpart("filelock")

if TYPE_CHECKING:
    from numpy.typing import NDArray

HEIGHT, WIDTH, COUNT = 208, 300, 24
PLACE = Georeference(crs="EPSG:32631", transform=(0.5, 0, 500000, 0, -0.5, 4800000))
PLACED = rasterio.Affine(*PLACE.transform)
PRESETS = ["robust", "fast"]
MEMORY = "4GB"  # what the tests' own process has counts, too


def texture(height: int, width: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return a pair whose disparities rise from 3 by a step each 40 rows."""
    random = np.random.default_rng(0)
    right = random.integers(0, 256, (height, width), np.uint8)
    shifts = 3 + np.arange(height) // 40 % 15
    left = np.stack([np.roll(row, shift) for row, shift in zip(right, shifts, strict=True)])
    return left, right


@pytest.fixture
def pair(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Write left.tif and right.tif in the current folder, and return their content."""
    monkeypatch.chdir(tmp_path)
    images = texture(HEIGHT, WIDTH)
    for name, image in zip(("left.tif", "right.tif"), images, strict=True):
        write_geotiff(name, image, like=PLACE)
    return images


def match(output: str = "out.npy", **options: Any) -> outofcore.MapReport:
    given: dict[str, Any] = {"num_disparities": COUNT, "max_memory": MEMORY, "band_rows": 32}
    return outofcore.match("left.tif", "right.tif", output, **given | options)


def read(path: str) -> NDArray[Any]:
    with open_raster(path) as raster:
        return raster.read(0, raster.size[0])[0]


def left_over() -> list[str]:
    return sorted(path.name for path in Path().iterdir() if path.name not in _INPUTS)


_INPUTS = {"left.tif", "right.tif"}


# What comes out


SETTINGS: dict[str, dict[str, Any]] = {
    "robust": {},
    "robust so": {"optimizer": "so"},
    "robust, noise given": {"known": ps.Known(noise=1.0), "speckle_size": 9, "precision": "full"},
    "paper": {"preset": "paper"},
    "paper sgm": {"preset": "paper", "optimizer": "sgm", "min_disparity": -3},
    "fast": {"preset": "fast"},
    "fast wta": {"preset": "fast", "optimizer": "wta", "subpixel": True},
    "nsad": {"preset": "fast", "cost": "nsad", "optimizer": "sgm"},
}


@pytest.mark.parametrize("name", SETTINGS)
def test_any_band_with_any_setting_is_that_of_the_whole_pair(
    pair: tuple[NDArray[np.uint8], ...], name: str
) -> None:
    options = {"num_disparities": COUNT} | SETTINGS[name]
    whole = ps.match(*pair, **options).disparity
    for rows in (1, 7, 63, 64, 65, 1000, None):
        if rows != 1 or name in ("robust, noise given", "fast"):
            report = match(band_rows=rows, **options)
            np.testing.assert_array_equal(np.load("out.npy"), whole, strict=True)
            assert report.plan.bands == (1 if rows is None else -(-HEIGHT // rows))


@pytest.mark.usefixtures("pair")
def test_a_band_larger_than_the_pair_takes_no_more_memory_than_all_of_it() -> None:
    plans = [match(preset="fast", band_rows=rows).plan for rows in (HEIGHT, 10**7)]
    assert [(plan.rows, plan.bands) for plan in plans] == [(HEIGHT, 1)] * 2


@pytest.mark.parametrize("ending", ["tif", "npy", "zarr"])
def test_all_layers_come_out(pair: tuple[NDArray[np.uint8], ...], ending: str) -> None:
    files: dict[str, str] = {name: f"{name}.{ending}" for name in LAYERS}

    report = match(
        f"out.{ending}",
        fill=False,
        flags_output=files["flags"],
        confidence_output=files["confidence"],
        uncertainty_output=files["uncertainty"],
    )

    whole = ps.match(*pair, num_disparities=COUNT, fill=False)
    for name, values in whole.maps.items():
        path = files.get(name, f"out.{ending}")
        np.testing.assert_array_equal(read(path), values, strict=True)
    assert len(whole.maps) == 1 + len(files)

    assert np.isnan(whole.disparity).any()
    assert report.flags == {flag: int((whole.flags & flag != 0).sum()) for flag in ps.Flag}
    assert left_over() == sorted([f"out.{ending}", *files.values()])
    assert (report.plan.bands, report.plan.finished, report.plan.rows) == (7, 0, 32)
    assert report.estimated == np.isfinite(whole.disparity).mean()
    assert report.seconds > 0
    assert json.loads(json.dumps(report.as_dict(), allow_nan=False))["width"] == WIDTH


def test_what_has_no_data_is_masked(pair: tuple[NDArray[np.uint8], ...]) -> None:
    write_geotiff("left.tif", np.where(pair[0] < 200, pair[0], np.float32(np.nan)))
    write_geotiff("right.tif", pair[1].astype(np.float32))

    valid = np.ones((HEIGHT, WIDTH), bool)
    valid[50:120, 30:70] = False
    np.save("mask.npy", valid)
    match(right_mask="mask.npy")

    left = read_geotiff("left.tif")
    assert left.mask is not None

    whole = ps.match(
        left.image,
        pair[1].astype(np.float32),
        num_disparities=COUNT,
        left_mask=left.mask,
        right_mask=valid,
        scales=False,
    )

    np.testing.assert_array_equal(np.load("out.npy"), whole.disparity)


@pytest.mark.usefixtures("pair")
def test_the_map_lies_where_the_left_image_does() -> None:
    write_geotiff("right.tif", texture(HEIGHT, WIDTH)[1])
    match("out.tif", flags_output="flags.tif")

    for name in ("out.tif", "flags.tif"):
        found = read_geotiff(name)
        assert found.georeference.crs == rasterio.CRS.from_epsg(32631)
        assert tuple(found.georeference.transform)[:6] == PLACE.transform
        assert "APPROXIMATE" not in found.tags

    with rasterio.open("out.tif") as file:
        assert np.isnan(file.nodata)
        assert file.profile["tiled"]
        assert file.descriptions == ("disparity",)

    match("out.zarr")
    attributes = zarr.open_array("out.zarr").attrs
    assert tuple(attributes["transform"]) == PLACE.transform
    assert "32631" in attributes["_CRS"]["wkt"]


@pytest.mark.usefixtures("pair")
def test_an_output_that_is_there_is_replaced() -> None:
    for output in ("out.zarr", "out.npy"):
        match(output, preset="fast", num_disparities=4)
        before = read(output)
        match(output, preset="fast")
        assert not np.array_equal(read(output), before)


@pytest.mark.parametrize(("size", "count"), [
    ("2GB", 2 * 10**9), ("800MiB", 800 * 2**20), ("1.5 g", 15 * 10**8), ("7k", 7000), (12, 12),
    ("512", 512), ("1 TiB", 2**40),
])  # fmt: skip
def test_sizes_are_read(size: int | str, count: int) -> None:
    assert as_bytes(size, "max_memory") == count


@pytest.mark.parametrize("size", ["", "GB", "-1GB", "1GBB", "1e9", "2 bits", "0"])
def test_what_is_no_size_is_refused(size: str) -> None:
    with pytest.raises(ValueError, match="^max_memory: got '.*'; accepts "):
        as_bytes(size, "max_memory")


@pytest.mark.parametrize(("count", "words"), [
    (12, "12 bytes"), (1000, "1 kB"), (812_000_001, "813 MB"), (1_340_000_000, "1.4 GB"),
    (99_900_000, "99.9 MB"),
])  # fmt: skip
def test_sizes_are_rounded_up(count: int, words: str) -> None:
    assert format_bytes(count) == words
    assert as_bytes(words.removesuffix("ytes"), "") >= count


# What ends a run


def end_after(bands: int, error: type[BaseException] = EndingError) -> Any:
    """Return a progress that ends the run after this many bands."""

    def progress(done: int, _rows: int) -> None:
        if done >= bands * 32:
            raise error

    return progress


def blocks() -> dict[str, tuple[int, int]]:
    """Return a function that shows whether a finished block was written again."""
    found = Path("out.npy.part").glob("rows*.npz")
    return {path.name: (path.stat().st_ino, path.stat().st_mtime_ns) for path in found}


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("error", [EndingError, KeyboardInterrupt])
def test_a_run_goes_on_where_it_ended(
    pair: tuple[NDArray[np.uint8], ...], error: type[BaseException], preset: PresetName
) -> None:
    with pytest.raises(error):
        match(preset=preset, progress=end_after(3, error))

    before = blocks()
    assert len(before) == 3
    seen: list[int] = []

    def progress(done: int, _rows: int) -> None:
        seen.append(done)
        assert before.items() <= blocks().items()

    report = match(preset=preset, progress=progress)
    assert sorted(seen) == seen
    assert {96, 128, 160, 192, HEIGHT} <= set(seen)
    assert (report.plan.bands, report.plan.finished) == (4, 3)

    whole = ps.match(*pair, num_disparities=COUNT, preset=preset)
    np.testing.assert_array_equal(np.load("out.npy"), whole.disparity)


@pytest.mark.parametrize("preset", PRESETS)
def test_a_band_that_is_missing_is_matched_alone(
    pair: tuple[NDArray[np.uint8], ...], preset: PresetName
) -> None:
    with pytest.raises(EndingError):
        match(preset=preset, progress=end_after(5))

    names = sorted(blocks())
    for name in names[1:3]:
        Path("out.npy.part", name).unlink()
    kept = blocks()

    with pytest.raises(EndingError):
        match(preset=preset, band_rows=40, progress=end_after(4))

    (added,) = blocks().keys() - kept.keys()
    assert added.startswith("rows00000032-00000040")

    report = match(preset=preset, band_rows=7, threads=1, max_memory="3GB")
    assert (report.plan.bands, report.plan.finished, report.plan.threads) == (9 + 8, 4, 1)

    whole = ps.match(*pair, num_disparities=COUNT, preset=preset)
    np.testing.assert_array_equal(np.load("out.npy"), whole.disparity)


@pytest.mark.usefixtures("pair")
def test_an_output_that_fails_at_the_end_costs_no_band(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(sinks.Sink, "publish", lambda _: end_after(0)(0, 0))
        with pytest.raises(EndingError):
            match()
    assert match().plan.bands == 0
    assert left_over() == ["out.npy"]


SLOW = """
import sys, time
from phasestereo_large import outofcore
outofcore.match("left.tif", "right.tif", "out.npy", num_disparities=24, max_memory="4GB",
                band_rows=32, preset=sys.argv[1], progress=lambda *_: time.sleep(0.05))
"""


# What a run refuses


@pytest.mark.parametrize(("change", "words"), [
    ({"num_disparities": 16}, "with num_disparities 24 (now 16); accepts True to drop them"),
    ({"window": 7}, "with window 9 (now 7);"),
    ({"flags_output": "flags.npy"}, "with layers ['disparity'] (now ['disparity', 'flags']);"),
    ({"left_mask": "left.tif"}, "with left_mask None (now "),
])  # fmt: skip
@pytest.mark.usefixtures("pair")
def test_a_run_of_another_kind_is_refused(change: dict[str, Any], words: str) -> None:
    with pytest.raises(EndingError):
        match(preset="fast", progress=end_after(3))
    before = blocks()

    with pytest.raises(ValueError, match=r"^restart: got False, but .*part holds") as error:
        match(preset="fast", **change)
    assert words in str(error.value)
    assert blocks() == before

    report = match(preset="fast", restart=True, **change)
    assert (report.plan.bands, report.plan.finished) == (7, 0)


@pytest.mark.usefixtures("pair")
def test_a_run_of_other_images_is_refused() -> None:
    with pytest.raises(EndingError):
        match(progress=end_after(3))
    write_geotiff("right.tif", texture(HEIGHT, WIDTH)[1] // 2)
    with pytest.raises(ValueError, match=r"^restart: .* with another right; accepts"):
        match()


@pytest.mark.usefixtures("pair")
def test_what_has_no_finished_band_is_no_obstacle() -> None:
    with pytest.raises(KeyboardInterrupt):
        match(progress=end_after(0, KeyboardInterrupt))
    assert left_over() == ["out.npy.part"]
    match(num_disparities=16)
    with pytest.raises(EndingError):
        match(progress=end_after(0))
    assert left_over() == ["out.npy"]


@pytest.mark.usefixtures("pair")
def test_two_runs_that_have_an_output_in_common_do_not_share_its_draft() -> None:
    begun: list[str] = []

    def second(stage: str) -> None:
        if "together" in stage and not begun:
            begun.append(stage)
            match("other.npy", preset="fast", num_disparities=4, flags_output="flags.npy")

    match("out.npy", preset="fast", flags_output="flags.npy", stage=second)
    match("alone.npy", preset="fast", flags_output="alone_flags.npy")
    assert begun
    assert Path("flags.npy").read_bytes() == Path("alone_flags.npy").read_bytes()
    assert not list(Path().glob(".*.draft"))


@pytest.mark.usefixtures("pair")
def test_two_runs_at_once_are_refused() -> None:
    seen: list[int] = []

    def progress(done: int, _rows: int) -> None:
        if done == 64 and not seen:
            seen.append(done)
            other = subprocess.run(  # noqa: S603  # our own
                [sys.executable, "-c", SLOW, "robust"], capture_output=True, text=True, check=False
            )
            assert "OSError" in other.stderr
            assert "out.npy.part: another run is at work there" in other.stderr

    assert match(progress=progress).plan.bands == 7
    assert seen


@pytest.mark.usefixtures("pair")
def test_folders_of_others_are_left_alone() -> None:
    Path("out.npy.part").mkdir()
    Path("out.npy.part/diary.txt").write_text("dear", encoding="utf-8")
    with pytest.raises(OSError, match=r"holds diary.txt, which is not of a run"):
        match()
    assert Path("out.npy.part/diary.txt").exists()


@pytest.mark.usefixtures("pair")
def test_too_little_memory_is_named_with_what_would_do() -> None:
    with pytest.raises(ValueError, match=r"^max_memory: got 1 MB; accepts .* or more") as error:
        match(max_memory="1MB", band_rows=None)
    message = str(error.value)
    assert "300 columns and 24 disparities" in message
    assert left_over() == []
    enough = re.findall(r"accepts (.*?) or more", message)[0]
    assert match(max_memory=as_bytes(enough, "") + 10**8).plan.rows == 32


@pytest.mark.usefixtures("pair")
@pytest.mark.parametrize("memory", ["1MB", "50MB"], ids=["at opening", "with all else"])
def test_large_blocks_of_a_file_are_named_where_they_are_to_blame(memory: str) -> None:
    side = 6144

    for name in ("left.tif", "right.tif"):
        with rasterio.open(
            name, "w", driver="GTiff", dtype="uint8", count=1, width=side, height=side, tiled=True,
            blockxsize=side, blockysize=side, sparse_ok=True, transform=PLACED,
        ):  # fmt: skip
            pass

    with pytest.raises(ValueError, match=r"stored in blocks of 6144 rows, which are read"):
        match(max_memory=memory, preset="fast", num_disparities=1)


@pytest.mark.parametrize(("options", "error"), [
    ({"max_memory": "much"}, "^max_memory: got 'much'; accepts a number of bytes"),
    ({"max_memory": "0GB"}, "^max_memory: got '0GB'; accepts 1 byte or more"),
    ({"band_rows": 0}, "^band_rows: got 0; accepts 1 or more"),
    ({"output": "out.pfm"}, "^output: got out.pfm; accepts .tif, .tiff, .npy, .zarr"),
    ({"output": "left.tif"}, "^output: left.tif is in use already"),
    ({"flags_output": "flags.png"}, "^flags_output: got flags.png; accepts"),
    ({"flags_output": "out.npy"}, "^flags_output: out.npy is in use already"),
    ({"confidence_output": "c.npy", "preset": "fast"}, "^confidence_output: got a file, and"),
    ({"num_disparities": 0}, "^num_disparities: got 0"),
    ({"num_disparities": 301}, "^num_disparities: got 301"),
    ({"preset": "best"}, "^preset: got 'best'"),
    ({"max_memory": "1MB", "preset": "fast", "num_disparities": 4},
     "less would do with fewer disparities$"),
    ({"max_memory": 1.5}, "^max_memory: got float; accepts a number of bytes"),
    ({"band_rows": "32"}, "^band_rows: got str; accepts an integer"),
    ({"size": 3}, "^size: no such setting"),
])  # fmt: skip
@pytest.mark.usefixtures("pair")
def test_wrong_values_are_refused(options: dict[str, Any], error: str) -> None:
    with pytest.raises((TypeError, ValueError), match=error):
        match(**options)
    assert left_over() == []


@pytest.mark.usefixtures("pair")
def test_outputs_that_cannot_be_are_refused_before_anything_is_matched() -> None:
    Path("folder.npy").mkdir()
    Path("folder.zarr").mkdir()
    Path("folder.zarr/diary.txt").touch()

    for output, kind in (("folder.npy", "a regular file"), ("folder.zarr", "a Zarr array")):
        with pytest.raises(OSError, match=f"{output} exists and is not {kind}"):
            match(output)

    with pytest.raises(FileNotFoundError, match="no such folder"):
        match("nowhere/out.npy")
    with pytest.raises(FileNotFoundError, match="no such folder"):
        match(flags_output="nowhere/out.npy")

    assert left_over() == ["folder.npy", "folder.zarr"]


@pytest.mark.parametrize(("module", "output", "extra"), [
    ("filelock", "out.npy", "large"),
    ("zarr", "out.zarr", "large"),
    ("rasterio", "out.tif", "geo"),
])  # fmt: skip
@pytest.mark.usefixtures("pair")
def test_what_is_missing_is_reported(
    monkeypatch: pytest.MonkeyPatch, module: str, output: str, extra: str
) -> None:
    images = texture(40, 40)
    for name, image in zip(("left.npy", "right.npy"), images, strict=True):
        np.save(name, image)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match=rf"phasestereo\[{extra}\]"):
        outofcore.match("left.npy", "right.npy", output, num_disparities=4, max_memory=MEMORY)
    assert not Path(output).exists()


# Disks and files that fail


def test_a_truncated_image_ends_the_run_and_keeps_what_is_finished(
    pair: tuple[NDArray[np.uint8], ...],
) -> None:
    for name, image in zip(("left.npy", "right.npy"), pair, strict=True):
        np.save(name, image)

    whole = Path("right.npy").read_bytes()
    given: dict[str, Any] = {"num_disparities": COUNT, "max_memory": MEMORY, "band_rows": 32}
    given["preset"] = "fast"  # which reads few rows ahead

    def progress(done: int, _rows: int) -> None:
        if done == 64:
            Path("right.npy").write_bytes(whole[: len(whole) // 2])

    with pytest.raises(
        ValueError, match=r"right.npy: rows \d+ to \d+ cannot be read: the file ends"
    ):
        outofcore.match("left.npy", "right.npy", "out.npy", progress=progress, **given)

    assert len(blocks()) >= 2
    assert left_over() == ["left.npy", "out.npy.part", "right.npy"]


LIMITED = """
import resource, signal, sys
from phasestereo_large import outofcore
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
limit = int(sys.argv[2])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
outofcore.match("left.npy", "right.npy", sys.argv[1], num_disparities=24, max_memory="4GB",
                band_rows=32, optimizer="wta", preset="fast", subpixel=True, confidence=True,
                confidence_output="confidence" + sys.argv[1][3:])
"""


@pytest.mark.skipif(os.name == "nt", reason="the size of files cannot be limited")
@pytest.mark.parametrize(("output", "limit", "words"), [
    ("out.npy", 20_000, r"kB are needed\): '.*part/rows0"),
    ("out.npy", 200_000, "cannot be written .* is finished is kept .*'out.npy'"),
    ("out.tif", 200_000, "cannot be written .* is finished is kept .*'out.tif'"),
    ("out.zarr", 60_000, "cannot be written .* is finished is kept .*'out.zarr'"),
])  # fmt: skip
def test_a_full_disk_is_reported_and_what_is_finished_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, output: str, limit: int, words: str
) -> None:
    monkeypatch.chdir(tmp_path)

    random = np.random.default_rng(0)
    for name in ("left.npy", "right.npy"):
        np.save(name, random.integers(0, 256, (1000, 100), np.uint8))

    done = subprocess.run(  # noqa: S603  # our own
        [sys.executable, "-c", LIMITED, output, str(limit)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip

    assert done.returncode == 1
    last = done.stderr.strip().splitlines()[-1]
    assert re.match(f"^OSError: .*{words}", last), last

    kept = list(Path().glob("out.*.part/rows*.npz"))
    assert len(kept) == (0 if limit == 20_000 else 32)
    assert not [path for path in Path().iterdir() if path.name.endswith(".draft")]
    assert not Path(output).exists()


# Awkward cases


@pytest.mark.parametrize("sign", [1, -1])
def test_disparities_beyond_the_sample_are_searched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sign: int
) -> None:
    monkeypatch.chdir(tmp_path)
    right = np.random.default_rng(0).integers(0, 256, (40, 2600), np.uint8)

    left = np.roll(right, sign * 2150, axis=1)
    write_geotiff("left.tif", left)
    write_geotiff("right.tif", right)

    search: dict[str, Any] = {
        "num_disparities": 16,
        "min_disparity": sign * 2150 - 8,
        "preset": "fast",
    }

    match(**search)
    np.testing.assert_array_equal(np.load("out.npy"), ps.match(left, right, **search).disparity)


def test_numbers_of_numpy_are_numbers(pair: tuple[NDArray[np.uint8], ...]) -> None:
    given: dict[str, Any] = {"num_disparities": np.int64(COUNT)}
    given["known"] = ps.Known(noise=np.float32(2))  # type: ignore[arg-type]  # the point
    given["window"] = np.int64(7)
    with pytest.raises(EndingError):
        match(progress=end_after(2), bands=np.array([1]), **given)
    report = match(bands=[1], num_disparities=COUNT, known=ps.Known(noise=2.0), window=7)
    assert report.plan.finished == 2
    np.testing.assert_array_equal(np.load("out.npy"), ps.match(*pair, **given).disparity)


@pytest.mark.usefixtures("pair")
def test_a_mask_beside_an_image_is_part_of_it() -> None:
    with pytest.raises(EndingError):
        match(progress=end_after(2))
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=False), rasterio.open("left.tif", "r+") as file:
        file.write_mask(np.arange(WIDTH) < np.full((HEIGHT, 1), 200))
    assert Path("left.tif.msk").exists()
    with pytest.raises(ValueError, match="^restart: got False, but .* another left; accepts True"):
        match()


def test_the_cache_of_gdal_is_limited_whatever_the_name_of_a_file(
    pair: tuple[NDArray[np.uint8], ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    limits: list[Any] = []
    env = rasterio.Env

    def limited(**given: Any) -> Any:
        limits.append(given)
        return env(**given)

    monkeypatch.setattr(rasterio, "Env", limited)

    for name in ("left", "right"):
        Path(f"{name}.tif").rename(name)
    outofcore.match("left", "right", "out.npy", num_disparities=COUNT, max_memory=MEMORY)

    assert [list(given) for given in limits] == [["GDAL_CACHEMAX"]]
    np.testing.assert_array_equal(
        np.load("out.npy"), ps.match(*pair, num_disparities=COUNT).disparity
    )


@pytest.mark.usefixtures("pair")
def test_a_run_that_is_refused_leaves_the_lock_of_one_that_begins() -> None:
    lock = counterpart("filelock").FileLock(Path("out.npy.part/lock"))
    Path("out.npy.part").mkdir()
    with lock:
        for _ in range(2):
            with pytest.raises(OSError, match="another run is at work there"):
                match()
        assert Path("out.npy.part/lock").exists()

"""Files: named when they cannot be read, and written whole or not at all."""

import errno
import struct
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from phasestereo import PointCloud
from phasestereo.io import (
    max_pixels,
    read_calibration,
    read_disparity,
    read_image,
    read_pfm,
    read_truth,
    set_max_pixels,
    write_disparity,
    write_image,
    write_maps,
    write_pfm,
    write_ply,
)
from phasestereo_large.geotiff import write_geotiff
from support import ENVIRONMENT, counterpart

READERS: dict[str, Callable[[Path], Any]] = {
    "read_image": read_image,
    "read_pfm": read_pfm,
    "read_disparity": read_disparity,
    "read_truth": lambda path: read_truth(path, scale=1),
    "read_calibration": read_calibration,
}


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("content", [b"", b"\0", b"hello, world\n", bytes(range(256)) * 4])
def test_files_of_anything_else_are_named(tmp_path: Path, reader: str, content: bytes) -> None:
    (tmp_path / "other.pfm").write_bytes(content)
    with pytest.raises(ValueError, match=r"other\.pfm: "):
        READERS[reader](tmp_path / "other.pfm")


def write_geo(path: Path) -> None:
    """Write a GeoTIFF, which takes an extra."""
    counterpart("rasterio")
    write_geotiff(path, np.ones((2, 2), np.float32))


WRITERS: dict[str, Callable[[Path], None]] = {
    "a.pfm": lambda path: write_pfm(path, np.ones((2, 2), np.float32)),
    "a.png": lambda path: write_image(path, np.ones((2, 2), np.uint8)),
    "a.tif": lambda path: write_disparity(path, np.ones((2, 2), np.float32)),
    "a.npy": lambda path: write_disparity(path, np.ones((2, 2), np.float32)),
    "a.ply": lambda path: write_ply(path, PointCloud(np.ones((2, 3), np.float32), None)),
    "geo.tif": write_geo,
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_failed_write_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    (tmp_path / name).write_bytes(b"old")

    def fail(self: Path, target: Path) -> None:
        assert self.parent == target.parent == tmp_path
        assert self.stat().st_size > 3  # complete by now
        raise OSError("disk on fire")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(OSError, match="disk on fire"):
        WRITERS[name](tmp_path / name)

    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_bytes() == b"old"


def test_an_encoder_that_fails_half_way_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"encoder|dimension|broken"):
        write_image(tmp_path / "a.jpg", np.zeros((1, 70000), np.uint8))  # JPEG ends at 65500
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", WRITERS)
def test_places_that_take_no_file_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(FileNotFoundError, match=r"no such folder: .*absent'"):
        WRITERS[name](tmp_path / "absent" / name)
    (tmp_path / name).mkdir()
    with pytest.raises(OSError, match="not a regular file"):
        WRITERS[name](tmp_path / name)
    assert not list((tmp_path / name).iterdir())


@pytest.mark.parametrize("name", WRITERS)
def test_folders_that_cannot_be_written_to_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    def refuse(self: Path, *_: str) -> None:
        raise PermissionError(errno.EACCES, "Permission denied", str(self))

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(PermissionError) as caught:
        WRITERS[name](tmp_path / name)
    assert caught.value.filename == str(tmp_path)


def test_a_symbolic_link_keeps_naming_its_file(tmp_path: Path) -> None:
    (tmp_path / "target.pfm").write_bytes(b"old")
    (tmp_path / "link.pfm").symlink_to(tmp_path / "target.pfm")
    write_pfm(tmp_path / "link.pfm", np.ones((2, 2), np.float32))
    assert (tmp_path / "link.pfm").is_symlink()
    np.testing.assert_array_equal(read_pfm(tmp_path / "target.pfm"), np.ones((2, 2)))


def test_new_files_have_ordinary_permissions(tmp_path: Path) -> None:
    write_pfm(tmp_path / "a.pfm", np.ones((2, 2), np.float32))
    (tmp_path / "b").write_bytes(b"")
    assert (tmp_path / "a.pfm").stat().st_mode == (tmp_path / "b").stat().st_mode


def test_a_result_in_the_place_of_its_maps_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match=r"^maps: got int; accepts arrays by name, as Result\.maps"):
        write_maps(tmp_path / "a.npz", 5)  # type: ignore[arg-type]


# What is read is bounded


def test_the_limit_on_pixels_is_that_of_the_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    images = {name: tmp_path / f"a.{name}" for name in ("png", "pgm", "bmp", "jpg", "tif", "npy")}
    for path in images.values():
        write_image(path, np.zeros((5, 7), np.uint8))
    write_pfm(tmp_path / "a.pfm", np.zeros((5, 7), np.float32))

    every = [*images.values(), tmp_path / "a.pfm"]
    assert max_pixels() == 200_000_000

    monkeypatch.setenv("PHASESTEREO_MAX_PIXELS", "34")
    for path in every:
        with pytest.raises(ValueError, match=rf"{path.name}: .* 7 x 5 pixels; at most 34 are read"):
            read_image(path)

    set_max_pixels(35)
    try:
        assert [read_image(path).size for path in every] == [35] * len(every)
    finally:
        set_max_pixels(None)

    monkeypatch.setenv("PHASESTEREO_MAX_PIXELS", "many")
    with pytest.raises(ValueError, match="PHASESTEREO_MAX_PIXELS: got 'many'; accepts a number"):
        max_pixels()


@pytest.mark.parametrize(("count", "error"), [(0, ValueError), (1.5, TypeError), (True, TypeError)])
def test_what_is_no_limit_is_refused(count: Any, error: type[Exception]) -> None:
    with pytest.raises(error, match=r"^count: got "):
        set_max_pixels(count)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_full_disk_is_named_with_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = partial(Path("/dev/full").open, "wb")
    draft = tmp_path / "draft"
    monkeypatch.setattr("phasestereo.io.drafts._locked_draft", lambda _: (draft, full(), None))
    with pytest.raises(OSError, match=rf"No space left on device: '{tmp_path}/a.npy'"):
        write_image(tmp_path / "a.npy", np.zeros((500, 500), np.uint8))


def test_a_library_does_not_write_into_the_terminal_of_others(tmp_path: Path) -> None:
    tifffile = pytest.importorskip("tifffile")

    tifffile.imwrite(tmp_path / "a.tif", np.zeros((16, 16), np.uint8), description="x" * 5000)
    content = bytearray((tmp_path / "a.tif").read_bytes())
    place = content.index(struct.pack("<HH", 305, 2))  # the tag that names the software
    content[place + 2 : place + 4] = struct.pack("<H", 99)  # has a type that there is not
    (tmp_path / "a.tif").write_bytes(content)

    done = subprocess.run(  # noqa: S603  # our own interpreter on our own code
        [sys.executable, "-c", "import sys, phasestereo as ps; ps.io.read_image(sys.argv[1])",
         str(tmp_path / "a.tif")],
        env=ENVIRONMENT,
        capture_output=True, text=True, check=False,
    )  # fmt: skip

    assert (done.returncode, done.stderr) == (0, "")

"""Files of statistics: they come back as they were, and other files are refused."""

from __future__ import annotations

import io
import json
import math
import pickle
import re
import zipfile
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from test_pair_statistics import RNG, assert_same, gathered, scene

import phasestereo as ps
import phasestereo_large as large
from phasestereo_large import bands

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

KERNEL = np.full((3, 5), 1 / 15)
VERSIONS = ps.BlurCompensation(
    noise=(0.1, 0.7),
    kernels=[(None, KERNEL), (KERNEL.T, None), (None, None)],
    labels=RNG.integers(0, 3, (4, 5)).astype(np.uint8),
    tile=40,
)
NUMPY: dict[str, Any] = {
    "num_disparities": np.int64(16), "min_disparity": np.int32(-2), "preset": "fast",
    "window": np.int16(5), "p1": np.float32(0.1), "p2": np.float64(2.0),
}  # fmt: skip
WRONG: list[Any] = ["", [], {}, "0", 0, [None]]
AREAS = scene((420, 130), "float32", soft=slice(180, None), masked=True)


@pytest.fixture(scope="module")
def areas() -> large.PairStatistics:
    """Return statistics with as much in them as there may be."""
    found = gathered(AREAS)
    assert found.blur is not None
    assert found.blur.gain > 0
    return found


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "statistics"


@pytest.mark.parametrize("options", [
    {"known": ps.Known(blur_compensation=VERSIONS), "min_disparity": -7}, {"preset": "fast"},
    {"preset": "paper", "p1": 1.0, "p2": 2.5, "intensity_range": (3.0, 99.5), "cost": "sad"},
])  # fmt: skip
def test_statistics_come_back_from_files_and_pickles(path: Path, options: dict[str, Any]) -> None:
    statistics = gathered(scene(), **options)
    statistics.save(str(path))
    assert_same(bands.load(path), statistics)
    assert_same(pickle.loads(pickle.dumps(statistics)), statistics)  # noqa: S301 - our own bytes


def test_numbers_of_numpy_can_be_saved(path: Path) -> None:
    statistics = gathered(scene(), **NUMPY)
    statistics.save(path)
    found = bands.load(path)
    assert found.settings == statistics.settings
    assert (found.size, found.num_disparities, found.min_disparity) == ((150, 130), 16, -2)


def test_bands_match_alike_with_statistics_from_a_file(
    areas: large.PairStatistics, path: Path
) -> None:
    areas.save(path)
    assert_same(bands.load(path), areas)
    found = bands.match_rows(AREAS, bands.load(path), 0, 420)
    expected = AREAS.matched(num_disparities=16)
    for layer in ("disparity", "flags", "confidence"):
        assert_same(getattr(found, layer), getattr(expected, layer))


def test_places_without_a_file_are_os_errors(areas: large.PairStatistics, path: Path) -> None:
    for place in (path, path.parent):
        with pytest.raises(OSError, match=place.name):
            bands.load(place)
    with pytest.raises(OSError, match="folder"):
        areas.save(path / "file")


def archive(**arrays: Any) -> bytes:
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def leaves(value: Any, *place: Any) -> Iterator[tuple[Any, ...]]:
    """Yield the places of all values in lists and objects, those that hold others, too."""
    if place:
        yield place
    keys = value if isinstance(value, dict) else range(len(value) if isinstance(value, list) else 0)
    for key in keys:
        yield from leaves(value[key], *place, key)


def changed(value: Any, place: tuple[Any, ...], new: Any) -> Any:
    """Return a copy of lists and objects with another value in a place."""
    if not place:
        return new
    copy = value.copy()
    copy[place[0]] = changed(value[place[0]], place[1:], new)
    return copy


@pytest.mark.parametrize(
    "options", [{}, {"known": ps.Known(blur_compensation=VERSIONS)}, {"preset": "fast"}]
)
def test_a_value_of_another_type_is_refused_with_its_name(
    path: Path, options: dict[str, Any]
) -> None:
    gathered(AREAS, **options).save(path)
    arrays = dict(np.load(path))
    plain = json.loads(str(arrays["plain"]))
    places = list(leaves(plain))
    assert len(places) > 60

    taken: list[tuple[str, Any]] = []
    for place in places:
        field = [key for key in place if isinstance(key, str)][-1]
        for new in WRONG:
            content = json.dumps(changed(plain, place, new))
            path.write_bytes(archive(**arrays | {"plain": np.array(content)}))
            try:
                bands.load(path)
            except ValueError as error:
                assert re.search(rf"statistics: .*\b{field}\b.*: got ", str(error))  # noqa: PT017 - most are refused, not all
            else:
                taken.append((field, new))

    assert {field for field, new in taken if new == ""} <= {"topic", "sentence"}
    assert {field for field, new in taken if new == []} <= {
        "findings",
        "left_out",
        "overlays",
        "sway",
    }
    assert [field for field, new in taken if new in ({}, [None])] == []


@pytest.mark.parametrize("change", [
    {"size": [-1, 5]}, {"size": [64.0, 64.0]}, {"ranges": [[0, 1]]}, {"roughness": [-1, 5]},
    {"roughness": [10**40, 1]}, {"tally": [1, 2, 3]}, {"tally": [1, 2, 3, -4, 5]},
    {"num_disparities": 0}, {"num_disparities": 2**40}, {"min_disparity": -(2**40)},
    {"packing": [0.0, 8, True, True]}, {"packing": [math.nan, 8, True, True]},
    {"packing": [1.0, 17, True, True]}, {"packing": [1.0, 8, 1, 1]},
    {"other": 1}, {"dtype": "int8"},
    {"findings": [["a", "b"]]}, {"alignment": 0}, {"search": 0}, {"blur": False}, {"ranges": 0},
])  # fmt: skip
def test_a_value_out_of_its_range_is_refused(path: Path, change: dict[str, Any]) -> None:
    gathered(scene()).save(path)
    arrays = dict(np.load(path))
    content = json.loads(str(arrays["plain"])) | change
    path.write_bytes(archive(**arrays | {"plain": np.array(json.dumps(content))}))
    with pytest.raises(ValueError, match=rf"statistics: .*\b({next(iter(change))}|statistics)\b"):
        bands.load(path)


def raw_archive() -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as members:
        members.writestr("told.npy", b"\x93NUMPY\x01\x00")
    return file.getvalue()


@pytest.mark.parametrize("content", [
    b"", b"\x80\x04K\x01.", b"%PDF", bytes(1000), b"PK\x03\x04" + bytes(99), raw_archive(),
    archive(), archive(other=np.zeros(3)), archive(plain=np.array([{"pickled": 1}], object)),
    *(archive(plain=np.array(text)) for text in ("[1]", "3", "{", "[" * 100_000)),
])  # fmt: skip
def test_a_file_that_is_no_statistics_is_refused(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"statistics: "):
        bands.load(path)


@pytest.mark.parametrize("labels", [np.zeros(3), np.full((2, 2), 200, np.uint8), None])
def test_arrays_that_do_not_fit_are_refused(path: Path, labels: Any) -> None:
    gathered(scene(), known=ps.Known(blur_compensation=VERSIONS)).save(path)
    arrays = dict(np.load(path))
    (name,) = [name for name, array in arrays.items() if array.dtype == np.uint8]
    kept = {other: array for other, array in arrays.items() if other != name}
    path.write_bytes(archive(**kept if labels is None else kept | {name: labels}))
    with pytest.raises(ValueError, match=r"statistics: "):
        bands.load(path)


def test_a_file_that_is_damaged_anywhere_is_refused_or_whole(path: Path) -> None:
    gathered(scene(), preset="fast").save(path)
    whole, content = bands.load(path), path.read_bytes()

    for place in range(0, len(content), 3):
        damaged = bytearray(content)
        damaged[place] ^= 0xFF
        path.write_bytes(damaged)
        try:
            loaded = bands.load(path)
        except ValueError as error:
            assert "statistics: " in str(error)  # noqa: PT017 - most are refused, not all
        else:
            assert_same(loaded, whole)

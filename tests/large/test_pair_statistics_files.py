"""Files that claim to hold statistics: one that is none is refused, whatever it holds."""

from __future__ import annotations

import io
import json
import zipfile
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from phasestereo_large import bands
from test_pair_statistics import assert_same

if TYPE_CHECKING:
    from pathlib import Path

SIZE = (64, 64)
IMAGE = np.random.default_rng(0).integers(0, 256, SIZE, np.uint8)


def read(first: int, last: int) -> tuple[Any, Any, None, None]:
    return IMAGE[first:last], IMAGE[first:last], None, None


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return a file that holds statistics."""
    bands.pair_statistics(read, SIZE, num_disparities=8).save(tmp_path / "statistics.npz")
    return tmp_path / "statistics.npz"


@pytest.mark.parametrize("name", ["num_disparities", "min_disparity"])
def test_what_is_no_integer_is_refused(name: str) -> None:
    given: Any = {"num_disparities": 8} | {name: 8.0}
    with pytest.raises(TypeError, match=f"^{name}: got float; accepts an integer"):
        bands.pair_statistics(read, SIZE, **given)


@pytest.mark.parametrize("change", [
    {"settings": [1]}, {"settings": "x"}, {"size": [64]}, {"size": [-1, 5]}, {"size": ["a", "b"]},
    {"size": [64.0, 64.0]}, {"num_disparities": "8"}, {"ranges": [[0, 1]]}, {"ranges": "ab"},
    {"roughness": [-1, 5]}, {"roughness": [10**40, 1]}, {"roughness": ["a", 1]},
    {"tally": [1, 2, 3]}, {"tally": [1, 2, 3, -4, 5]}, {"tally": ["a", 2, 3, 4, 5]},
    {"classes": 10**9}, {"classes": "1"}, {"blur": 5}, {"blurs": [{"a": 1}]},
])  # fmt: skip
def test_statistics_with_a_wrong_value_is_refused(path: Path, change: dict[str, Any]) -> None:
    with np.load(path) as file:
        arrays = dict(file)
    content = json.loads(str(arrays["plain"])) | change
    np.savez(path, **arrays | {"plain": np.array(json.dumps(content))})
    with pytest.raises(ValueError, match=r"statistics.npz: "):
        bands.load(path)


def archive(content: str) -> bytes:
    file = io.BytesIO()
    np.savez(file, plain=np.array(content))
    return file.getvalue()


def raw_archive() -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as members:
        members.writestr("told.npy", b"\x93NUMPY\x01\x00")
    return file.getvalue()


@pytest.mark.parametrize("content", [
    archive("[1]"), archive("[" * 100_000), raw_archive(),
])  # fmt: skip
def test_a_file_that_is_no_statistics_is_refused(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"statistics.npz: "):
        bands.load(path)


def test_statistics_that_is_damaged_anywhere_is_refused_or_whole(path: Path) -> None:
    whole, content = bands.load(path), path.read_bytes()

    for place in range(0, len(content), 3):
        damaged = bytearray(content)
        damaged[place] ^= 0xFF
        path.write_bytes(damaged)
        try:
            loaded = bands.load(path)
        except ValueError as error:
            assert "statistics.npz: " in str(error)  # noqa: PT017 - most are refused, not all
        else:
            assert_same(loaded, whole)

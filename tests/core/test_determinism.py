"""The tool that holds spoiled pairs to one map, however they are matched: a few of them."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import determinism
from conftest import counterpart

counterpart("phasestereo_bench")


def test_spoiled_crops_of_real_pairs_have_one_map(data: Path, tmp_path: Path) -> None:
    assert determinism.compare(4, 1, data, tmp_path) == []


def test_a_map_that_differs_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    maps = {"disparity": "a", "findings": "b"}

    def ways(*_: Any) -> Iterator[tuple[str, dict[str, str]]]:
        yield "1 thread", maps
        yield "a file", {"disparity": "a"}
        yield "8 threads", maps | {"findings": "c"}

    monkeypatch.setattr(determinism, "ways", ways)
    differing = determinism.compare(1, 1, None, tmp_path)
    ends = [line.rpartition(": ")[2] for line in differing]
    assert ends == ["8 threads", *determinism.LEVELS]

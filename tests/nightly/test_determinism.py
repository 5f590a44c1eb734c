"""One map of a pair, to the bit, however it is matched: spoiled crops, all estimated.

More of them, and others: ``PHASESTEREO_NIGHTLY=1 PHASESTEREO_SEED=7``, as `make nightly` has it.
"""

# Who tests a thing knows that it is there: no assertions for the type checker alone.
# mypy: no-strict-optional

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo.io import write_image
from support import NIGHTLY, Run, counterpart, determinism, real_data
from support.c_programs import GRAY, RGB, Program, library, planes_of, program
from support.determinism import Maps, Spoiled, digests, digests_of
from support.matcher_page import MatcherPage, address, page

counterpart("phasestereo_bench")

__all__ = ["address", "library", "page", "program"]  # fixtures

PAIRS = int(os.environ.get("PHASESTEREO_PAIRS", "300" if NIGHTLY else "2"))
SEED = int(os.environ.get("PHASESTEREO_SEED", "1"))
LEVELS = "sse2", "avx2", "avx512", "avx512bitalg"
"""Where there are none of them, the processes do all the same."""


@pytest.fixture(scope="module")
def spoiled() -> list[Spoiled]:
    return determinism.drawn(PAIRS, SEED, real_data())


@pytest.fixture
def held(spoiled: list[Spoiled]) -> Callable[..., None]:
    """Return a function that compares ways of matching a pair with the expected result."""

    def hold(
        ways: Callable[[Spoiled], Mapping[str, Maps]],
        expect: Callable[[Spoiled], Maps] = lambda one: digests(one.whole),
    ) -> None:
        differing = []
        for one in spoiled:
            expected = expect(one)
            for way, found in ways(one).items():
                names = [name for name in found if found[name] != expected[name]]
                differing += [f"{one.name}: {way}: {', '.join(names)}"] if names else []
        assert differing == []

    return hold


def test_threads_views_byte_orders_and_used_memory(held: Callable[..., None]) -> None:
    def ways(one: Spoiled) -> dict[str, Maps]:
        images, preset = (one.left, one.right), one.preset
        turned = [np.ascontiguousarray(image[::-1, ::-1])[::-1, ::-1] for image in images]
        swapped = [image.astype(image.dtype.newbyteorder()) for image in images]
        matcher = ps.Matcher(preset=preset, threads=2)
        matcher.match(*images[::-1])

        found = {f"{threads} threads": one.match(threads=threads) for threads in (1, 2, 3, 8)}
        found["views"] = ps.match(*turned, preset=preset)
        found["byte order"] = ps.match(*swapped, preset=preset)
        found["a matcher in use"] = matcher.match(*images)
        return {name: digests(result) for name, result in found.items()}

    held(ways)


@pytest.mark.parametrize("level", LEVELS)
def test_instruction_sets(spoiled: list[Spoiled], level: str, tmp_path: Path) -> None:
    found = determinism.at_level(level, spoiled, tmp_path)
    assert found == [digests(one.whole) for one in spoiled]


def test_rigs_and_streams(held: Callable[..., None]) -> None:
    live = counterpart("phasestereo_live")

    def ways(one: Spoiled) -> dict[str, Maps]:
        pair = one.left, one.right
        with live.stream([pair, pair], preset=one.preset) as frames:
            found = {f"frame {frame.index}": digests(frame.result) for frame in frames}
        assert len(found) == 2
        return found | {"a rig": digests(ps.Rig(preset=one.preset).match(*pair))}

    held(ways)


def test_files_by_the_command_and_in_batches(
    held: Callable[..., None], run: Callable[..., Run], tmp_path: Path
) -> None:
    batch, tifffile = counterpart("phasestereo_large.batch"), counterpart("tifffile")
    left, right, maps = (tmp_path / name for name in ("left.tif", "right.tif", "maps"))

    def ways(one: Spoiled) -> dict[str, Maps]:
        write_image(left, one.left)
        write_image(right, one.right)
        layers = [name for name in one.whole.maps if name != "disparity"]

        outputs = {name: tmp_path / f"{name}.npy" for name in one.whole.maps}
        options = [word for name in layers for word in (f"--{name}-output", outputs[name])]
        command = "match", left, right, "--preset", one.preset, "-o", outputs["disparity"]
        assert run(*command, *options)[0] == 0
        by_command = digests_of(loaded(outputs))

        pairs = [batch.PairFiles(name="a", left=left, right=right)]
        assert batch.run(pairs, maps, layers=layers, preset=one.preset, workers=1).done == 1
        written = {name: maps / f"a.{name}.tif".replace(".disparity", "") for name in outputs}
        by_batch = {name: tifffile.imread(path) for name, path in written.items()}
        return {"match": by_command, "batch": digests_of(by_batch)}

    held(ways)


def test_parts(held: Callable[..., None], tmp_path: Path) -> None:
    """Dask's tasks, and bands from file to file: both at one scale."""
    da, dask = counterpart("dask.array"), counterpart("dask")
    large, lazy = counterpart("phasestereo_large.outofcore"), counterpart("phasestereo_large.dask")
    bands = counterpart("phasestereo_large.bands")
    files = [tmp_path / "left.npy", tmp_path / "right.npy"]

    def options(one: Spoiled) -> dict[str, Any]:
        found = one.whole.search
        search = {"min_disparity": found.min_disparity, "num_disparities": found.num_disparities}
        return search | {"scales": False, "preset": one.preset}

    def statistics(one: Spoiled) -> Any:
        def read(first: int, last: int) -> Any:
            return one.left[first:last], one.right[first:last], None, None

        bands.pair_statistics(read, one.left.shape[:2], **options(one)).save(tmp_path / "known")
        return bands.load(tmp_path / "known")

    def ways(one: Spoiled) -> dict[str, Maps]:
        images = one.left, one.right
        arrays = [da.from_array(image, chunks=(37, 50, *image.shape[2:])) for image in images]
        known = statistics(one)
        lazies = lazy.maps(*arrays, band_rows=40, statistics=known, **options(one))._asdict()
        (by_dask,) = dask.compute({name: lazies[name] for name in one.whole.maps})

        for file, image in zip(files, images, strict=True):
            np.save(file, image)
        outputs = {name: tmp_path / f"{name}.npy" for name in one.whole.maps}
        more = {f"{name}_output": outputs[name] for name in outputs if name != "disparity"}
        bands = {"max_memory": "2GB", "band_rows": 40} | more | options(one)
        large.match(*files, outputs["disparity"], **bands)
        return {"Dask": digests_of(by_dask), "out of core": digests_of(loaded(outputs))}

    held(ways, lambda one: digests_of(ps.match(one.left, one.right, **options(one)).maps))


def loaded(files: Mapping[str, Path]) -> dict[str, NDArray[Any]]:
    return {name: np.load(path) for name, path in files.items()}


def test_c(held: Callable[..., None], program: Program) -> None:
    def ways(one: Spoiled) -> dict[str, Maps]:
        channels = RGB if one.left.ndim == 3 else GRAY
        options: dict[str, Any] = {"preset": one.preset, "disparities": 0, "channels": channels}
        code, lines, output = program.run((one.left, one.right), **options)
        assert code == 0, lines
        planes = planes_of(output, one.left.shape[:2])
        said = [line.removeprefix("matched ") for line in lines if line.startswith("matched ")]
        found = digests_of({name: planes[name] for name in one.whole.maps})
        return {"C": found | {"findings": "\n".join(said)}}

    held(ways)


def test_browser(held: Callable[..., None], page: MatcherPage) -> None:
    def ways(one: Spoiled) -> dict[str, Maps]:
        if one.left.dtype != np.uint8:  # a page has no others
            return {}
        found = page.match((one.left, one.right), preset=one.preset)
        said = [
            (each["topic"], each["severity"], each["sentence"])
            for each in found["found"]["findings"]
        ]
        planes = digests_of({name: found[name] for name in one.whole.maps})
        return {"browser": planes | {"findings": determinism.words(said)}}

    held(ways)

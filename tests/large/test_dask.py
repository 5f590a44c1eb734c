"""Lazy matches of Dask arrays: the bits of `ps.match`, on every scheduler and from any chunks."""

from __future__ import annotations

import logging
import os
import pickle
import signal
import tempfile
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo_large import dask as lazily
from phasestereo_large.bands import halo, match_rows, pair_statistics
from support import counterpart

dask = counterpart("dask")
da = counterpart("dask.array")
callbacks = counterpart("dask.callbacks")

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

pytestmark = [
    # Sockets and pipes of worker processes are closed some time after these have ended.
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]

HEIGHT, WIDTH, COUNT = 331, 97, 24
FAST: dict[str, Any] = {"preset": "fast", "num_disparities": COUNT}
ROBUST: dict[str, Any] = {"num_disparities": COUNT, "scales": False}  # parts have one scale
"""The default preset."""


def views(dtype: Any = np.uint8, height: int = HEIGHT) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return a color pair of noise, of which a part is nearer than the rest."""
    noise = np.random.default_rng(3).integers(0, 256, (height, WIDTH + 30, 3), dtype=np.uint8)
    left, right = noise[:, 30:], noise[:, 26:-4].copy()
    right[height // 3 : height // 2, 10:50] = left[height // 3 : height // 2, 22:62]
    return left.astype(dtype), right.astype(dtype)


LEFT, RIGHT = views()


def lazy(image: NDArray[Any], rows: int = 50, columns: int = WIDTH) -> Any:
    return da.from_array(image, chunks=(rows, columns, *image.shape[2:]))


def read(first: int, last: int, /) -> Any:
    return LEFT[first:last], RIGHT[first:last], None, None


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    """Return a client of two worker processes."""
    distributed = counterpart("distributed")

    with (
        distributed.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        yield client


def assert_same(found: lazily.Maps, wanted: ps.Result, **how: Any) -> None:
    computed = dask.compute(*found, **how)
    for name, each in zip(found._fields, computed, strict=True):
        expected = getattr(wanted, name)
        if expected is None:
            assert each is None
        else:
            np.testing.assert_array_equal(each, expected)
            assert each.dtype == expected.dtype


# The same bits


@pytest.mark.parametrize(
    "options",
    [
        FAST,
        {"preset": "paper", "num_disparities": COUNT},
        {"preset": "paper", "num_disparities": COUNT, "min_disparity": -7, "lr_check": 1},
        ROBUST,
        {**ROBUST, "speckle_size": 30, "uniqueness": 5, "min_disparity": -2},
        {
            **ROBUST,
            "speckle_size": 0,
            "lr_check": None,
            "compensate_blur": False,
            "known": ps.Known(noise=1.0),
        },
        {**ROBUST, "optimizer": "so", "min_confidence": 0.3},
        {**ROBUST, "optimizer": "wta", "fill": False},
        {"preset": "fast", "num_disparities": COUNT, "optimizer": "sgm"},
        {"preset": "paper", "num_disparities": COUNT, "cost": "nsad", "window": 7},
    ],
    ids=str,
)
def test_bands_together_are_the_whole(options: dict[str, Any]) -> None:
    wanted = ps.match(LEFT, RIGHT, **options)
    found = lazily.maps(lazy(LEFT), lazy(RIGHT), band_rows=64, **options)
    assert len(found.disparity.chunks[0]) > 1 or halo(wanted.settings) > HEIGHT // 2
    assert_same(found, wanted, scheduler="sync")


@pytest.mark.parametrize(
    "chunks", [(1000, 1000), (331, 10), (7, 97), (100, 50), ((300, 31), (90, 7)), ((1, 330), 97)]
)
def test_any_chunks(chunks: Any) -> None:
    wanted = ps.match(LEFT, RIGHT, **FAST)
    left = da.from_array(LEFT, chunks=(*chunks, 2))
    right = da.from_array(RIGHT, chunks=(40, 30, 3))
    assert_same(lazily.maps(left, right, band_rows=90, **FAST), wanted)


@pytest.mark.parametrize("height", [1, 5, 40, 64, 65, 128, 331])
@pytest.mark.parametrize("band_rows", [1, 64, 1000, None])
def test_any_height(height: int, band_rows: int | None) -> None:
    left, right = LEFT[:height], RIGHT[:height]
    wanted = ps.match(left, right, **FAST)
    found = lazily.maps(lazy(left), lazy(right), band_rows=band_rows, **FAST)
    assert sum(found.disparity.chunks[0]) == height
    assert_same(found, wanted, scheduler="sync")


def test_masks_of_both_images() -> None:
    valid = np.random.default_rng(4).random((2, HEIGHT, WIDTH)) > 0.1
    wanted = ps.match(LEFT, RIGHT, left_mask=valid[0], right_mask=valid[1], **FAST)
    for masks in (valid, [lazy(mask, 13) for mask in valid]):
        both = {"left_mask": masks[0], "right_mask": masks[1]}
        assert_same(lazily.maps(lazy(LEFT), lazy(RIGHT), band_rows=64, **both, **FAST), wanted)

    wanted = ps.match(LEFT, RIGHT, right_mask=valid[1], **FAST)
    found = lazily.maps(lazy(LEFT), lazy(RIGHT), right_mask=valid[1], band_rows=64, **FAST)
    assert_same(found, wanted)


@pytest.mark.parametrize("scheduler", ["threads", "sync", "processes"])
def test_every_scheduler(scheduler: str) -> None:
    wanted = ps.match(LEFT, RIGHT, **FAST)
    assert_same(lazily.maps(lazy(LEFT), lazy(RIGHT), **FAST), wanted, scheduler=scheduler)


def test_worker_processes(client: Any) -> None:
    found = lazily.match(lazy(LEFT), lazy(RIGHT), band_rows=64, **FAST)
    np.testing.assert_array_equal(
        client.compute(found).result(), ps.match(LEFT, RIGHT, **FAST).disparity
    )


def _shown(block: NDArray[Any], folder: str) -> NDArray[Any]:
    """Return a block, and record in a file who has computed one."""
    time.sleep(0.1)
    os.close(tempfile.mkstemp(prefix=f"{os.getpid()}.", dir=folder)[0])
    return block


def test_a_worker_that_is_killed_half_way_changes_nothing(client: Any, tmp_path: Path) -> None:
    ours = set(client.run(os.getpid).values())
    left = lazy(LEFT, 20).map_blocks(_shown, str(tmp_path), dtype=LEFT.dtype, meta=LEFT[:0])
    future = client.compute(lazily.match(left, lazy(RIGHT), band_rows=64, **FAST))

    def busy() -> list[int]:
        found = [int(path.name.split(".")[0]) for path in tmp_path.iterdir()]
        return [number for number in found if number in ours]  # one row was read by this process

    while len(busy()) < 8:
        time.sleep(0.01)
    killed = busy()[0]

    assert future.status == "pending"
    os.kill(killed, signal.SIGKILL)
    np.testing.assert_array_equal(future.result(), ps.match(LEFT, RIGHT, **FAST).disparity)
    assert killed not in client.run(os.getpid).values()


# How it goes about it


class Watched:
    """An image that records which of its rows are read."""

    def __init__(self, image: NDArray[Any]) -> None:
        self.image, self.shape, self.dtype, self.ndim = image, image.shape, image.dtype, image.ndim
        self.read: list[tuple[int, int]] = []

    def __getitem__(self, where: Any) -> NDArray[Any]:
        rows = where[0]
        if rows.start != rows.stop:  # Dask asks for nothing, to see of what type it is
            self.read.append((rows.start, rows.stop))
        rows_read: NDArray[Any] = self.image[where]
        return rows_read


def test_all_is_read_once_at_the_call_if_nothing_need_be_known() -> None:
    left = Watched(LEFT)
    plain = FAST | {"adaptive_p2": 0}
    found = lazily.match(da.from_array(left, chunks=(10, -1, -1)), lazy(RIGHT), **plain)
    # For black borders, and for overlays.
    parts = [rows for rows in left.read if rows != (0, 1)]
    assert set(parts) == {(top, min(top + 10, HEIGHT)) for top in range(0, HEIGHT, 10)}
    assert len(parts) <= 2 * (HEIGHT // 10 + 1)
    assert (found.shape, found.dtype) == ((HEIGHT, WIDTH), np.float32)
    assert isinstance(found._meta, np.ndarray)


def test_a_part_of_the_result_reads_no_more_than_the_bands_around() -> None:
    left = Watched(LEFT)
    array = da.from_array(left, chunks=(10, -1, -1))
    found = lazily.match(array, lazy(RIGHT), band_rows=64, **FAST)
    left.read.clear()
    rows = found[100:120].compute(scheduler="sync")
    np.testing.assert_array_equal(rows, ps.match(LEFT, RIGHT, **FAST).disparity[100:120])
    assert 0 < max(last for _, last in left.read) < 200


def test_a_task_gets_the_rows_that_it_needs_and_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    reach = halo(ps.PRESETS["fast"])
    checked = []

    def look(read: Any, statistics: Any, first: int, last: int, **options: Any) -> ps.Result:
        ends = max(0, first - reach), min(HEIGHT, last + reach)
        left, right, *masks = read(*ends)
        np.testing.assert_array_equal(left, LEFT[slice(*ends)])
        np.testing.assert_array_equal(right, RIGHT[slice(*ends)])
        assert masks == [None, None]
        for wrong in ((ends[0] - 1, ends[1]), (ends[0], ends[1] + 1)):
            with pytest.raises(IndexError):
                read(*wrong)
        checked.append((first, last))
        return match_rows(read, statistics, first, last, **options)

    monkeypatch.setattr(lazily, "match_rows", look)

    rows = max(100, reach)
    lazily.match(lazy(LEFT), lazy(RIGHT), band_rows=rows, **FAST).compute(scheduler="sync")

    assert min(checked) == (0, rows if HEIGHT - rows >= reach else HEIGHT)
    assert max(checked)[1] == HEIGHT


def test_all_maps_come_from_the_same_tasks(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def count(*arguments: Any, **options: Any) -> ps.Result:
        calls.append(arguments[2:4])
        return match_rows(*arguments, **options)

    monkeypatch.setattr(lazily, "match_rows", count)
    found = lazily.maps(
        lazy(LEFT), lazy(RIGHT), preset="paper", num_disparities=COUNT, band_rows=110
    )
    dask.compute(*found, scheduler="sync")
    assert len(calls) == len(found.disparity.chunks[0])


def test_a_graph_is_small_and_named_after_what_it_is_made_of() -> None:
    tall = da.zeros((30000, 300), dtype=np.uint8, chunks=(1000, 300))
    found = lazily.match(tall, tall + 1, band_rows=1024, **FAST)
    assert len(found.chunks[0]) == 30
    assert len(found.dask.layers) < 20
    assert len(pickle.dumps(found)) < 100_000
    assert found.name == lazily.match(tall, tall + 1, band_rows=1024, **FAST).name
    assert found.name != lazily.match(tall, tall + 1, band_rows=1024, **FAST, window=5).name


def test_a_pair_is_measured_by_windows_at_the_call() -> None:
    left, right = Watched(LEFT), Watched(RIGHT)
    pair = [da.from_array(each, chunks=(50, -1, -1)) for each in (left, right)]
    lazily.match(*pair, **ROBUST)
    assert left.read
    assert right.read
    assert max(last - first for first, last in left.read) <= 50


def test_statistics_that_is_given_is_not_made_again() -> None:
    known = pair_statistics(read, (HEIGHT, WIDTH), **ROBUST)

    left = Watched(LEFT)
    found = lazily.maps(da.from_array(left, chunks=50), lazy(RIGHT), statistics=known, **ROBUST)
    assert left.read == []

    assert_same(found, ps.match(LEFT, RIGHT, **ROBUST))


# Several paths


# Refusals


NOTHING = {"left": lazy(LEFT)[:0], "right": lazy(RIGHT)[:0]}


@pytest.mark.parametrize(
    ("error", "message", "changes"),
    [
        (TypeError, r"^left: got ndarray; accepts a Dask array", {"left": LEFT}),
        (TypeError, r"^right: got NoneType; accepts a Dask array", {"right": None}),
        (TypeError, r"^left: got dtype int64; accepts", {"left": lazy(LEFT.astype(int))}),
        (TypeError, r"^right: got dtype uint16; accepts", {"right": lazy(RIGHT.astype("u2"))}),
        (ValueError, r"^right: got \(9, 97\) pixels; accepts the", {"right": lazy(RIGHT[:9])}),
        (ValueError, r"^right: got \(331, 9\) pixels; accepts", {"right": lazy(RIGHT[:, :9])}),
        (ValueError, r"^left: got shape \(331, 97, 2\)", {"left": lazy(LEFT[:, :, :2])}),
        (ValueError, r"^left: got shape \(331,\)", {"left": lazy(LEFT)[:, 0, 0]}),
        (ValueError, r"^left: got shape .*at least one pixel", NOTHING),
        (
            ValueError,
            r"^left: got chunks of unknown",
            {"left": lazy(LEFT)[lazy(LEFT)[:, 0, 0] > 9]},
        ),
        (ValueError, r"^preset: got 'x'", {"preset": "x"}),
        (TypeError, r"^windo: no such setting", {"windo": 5}),
        (ValueError, r"^threads: got 0; accepts 1 or more", {"threads": 0}),
        (TypeError, r"^threads: got NoneType; accepts an integer", {"threads": None}),
        (ValueError, r"^band_rows: got 0; accepts 1 or more", {"band_rows": 0}),
        (TypeError, r"^overlap: no such setting", {"overlap": 9}),
        (TypeError, r"^left_mask: got dtype uint8; accepts bool", {"left_mask": LEFT[:, :, 0]}),
        (ValueError, r"^right_mask: got shape \(3,\)", {"right_mask": np.ones(3, bool)}),
        (ValueError, r"^num_disparities: got 98; accepts", {"num_disparities": 98}),
        (TypeError, r"^num_disparities: got ", {"num_disparities": "8"}),
    ],
)
def test_wrong_arguments(error: type[Exception], message: str, changes: dict[str, Any]) -> None:
    proper: dict[str, Any] = {"left": lazy(LEFT), "right": lazy(RIGHT), **FAST}
    with pytest.raises(error, match=message):
        lazily.maps(**(proper | changes))


def test_statistics_of_something_else() -> None:
    known = pair_statistics(read, (HEIGHT, WIDTH), **FAST)
    with pytest.raises(
        ValueError, match=r"^statistics: got that of 24 disparities from 0; accepts tha"
    ):
        lazily.match(lazy(LEFT), lazy(RIGHT), statistics=known, num_disparities=9, preset="fast")
    with pytest.raises(
        ValueError, match=r"^statistics: got that of \(331, 97\) pixels; accepts that of"
    ):
        lazily.match(lazy(LEFT[:9]), lazy(RIGHT[:9]), statistics=known, **FAST)


@pytest.mark.parametrize("first", [FAST, ROBUST], ids=["plain", "evened"])
def test_statistics_with_other_settings(first: dict[str, Any]) -> None:
    known = pair_statistics(read, (HEIGHT, WIDTH), **first)

    images = lazy(LEFT), lazy(RIGHT)
    with pytest.raises(
        ValueError, match=r"^statistics: got that with another window; accepts that with"
    ):
        lazily.match(*images, statistics=known, **(first | {"window": 7}))
    with pytest.raises(TypeError, match=r"^statistics: got that of uint8; accepts that of float32"):
        lazily.match(*(each.astype(np.float32) for each in images), statistics=known, **first)


def test_what_a_task_finds_wrong_comes_out() -> None:
    left, right = views(np.float32)
    left[200, 3] = np.inf
    given = pair_statistics(
        lambda first, last: (right[first:last], right[first:last], None, None),
        (HEIGHT, WIDTH),
        **FAST,
    )

    with pytest.raises(ValueError, match=r"^left: got inf.* at row "):
        lazily.match(lazy(left), lazy(right), statistics=given, **FAST).compute()

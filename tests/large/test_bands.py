"""Bands of rows of a pair, each by itself and in any order: as in a match of the whole."""

from __future__ import annotations

import json
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings as hypothesis_settings, strategies as st
from PIL import Image, ImageDraw
from scipy import ndimage
from test_pair_statistics import ERRORS, WRONG_ROWS, Reading, gathered, scene

import phasestereo as ps
from phasestereo import _core
from phasestereo_large.bands import halo, load, match_rows, pair_statistics
from support.processes import return_memory_at_once, run, run_forking

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

SIZE = (300, 110)
AREAS = (360, 110)
# Name of a case, its options, type of its pixels, whether some are masked, which rows are soft.
CASES: dict[str, tuple[dict[str, Any], str, bool, slice | None]] = {
    "robust": ({}, "uint8", False, None),
    "robust areas": ({}, "uint16", False, slice(150, None)),
    "robust soft masked floats": ({}, "float32", True, slice(0, None)),
    "robust, noise given": (
        {"known": ps.Known(noise=(0.5, 1.0)), "min_disparity": -3}, "float64", True, None
    ),
    "paper": ({"preset": "paper"}, "uint8", False, None),
    "paper masked": ({"preset": "paper"}, "uint16", True, None),
    "paper floats": ({"preset": "paper", "min_confidence": 0.3}, "float32", True, None),
    "fast": ({"preset": "fast"}, "uint8", False, None),
    "fast masked": ({"preset": "fast"}, "float64", True, None),
    "fast areas": ({"preset": "fast", "compensate_blur": True}, "uint8", False, slice(150, None)),
    "sad": ({"preset": "fast", "cost": "sad", "subpixel": True}, "float32", True, None),
    "nsad": ({"preset": "paper", "cost": "nsad", "shiftable": False}, "uint8", True, None),
    "robust so": ({"optimizer": "so"}, "uint8", False, None),
    "robust wta": ({"optimizer": "wta", "compensate_blur": False}, "uint8", True, None),
    "robust dp": ({"optimizer": "dp", "adaptive_p2": 0}, "uint8", False, None),
    "robust exact": ({"precision": "full", "p1": 9, "p2": 900}, "uint16", False, None),
    "paper sgm": ({"preset": "paper", "optimizer": "sgm"}, "uint8", True, None),
    "paper so": ({"preset": "paper", "optimizer": "so", "adaptive_p2": 0.5}, "uint8", False, None),
    "paper wta": ({"preset": "paper", "optimizer": "wta"}, "uint8", False, None),
    "fast sgm": ({"preset": "fast", "optimizer": "sgm"}, "uint8", False, slice(150, None)),
    "fast dp": ({"preset": "fast", "optimizer": "dp"}, "uint8", True, None),
    "sad sgm": ({"preset": "fast", "cost": "sad", "optimizer": "sgm"}, "float32", False, None),
    "alone": (
        {"cost": "sad", "window": 1, "noise_threshold": 0, "compensate_blur": False, "despike":
         False, "denoise": False, "confidence": False, "guided_median": False, "adaptive_p2": 0,
         "speckle_size": 0, "lr_check": None, "subpixel": False, "scales": False},
        "uint8", False, None,
    ),
    "refined": (
        {"preset": "fast", "guided_median": True, "median": 3, "subpixel": True, "lr_check": 1,
         "uniqueness": 5, "speckle_size": 9, "confidence": True, "fill": False},
        "uint8", True, None,
    ),
}  # fmt: skip


class BandCase:
    """A pair, what is known of it, and how it is matched as a whole."""

    def __init__(self, name: str) -> None:
        options, dtype, masked, soft = CASES[name]
        self.read = scene(AREAS if soft else SIZE, dtype, masked=masked, soft=soft)
        self.statistics = gathered(self.read, **options)
        self.whole = self.read.matched(**{"num_disparities": 16} | options)

    def check(self, first: int, last: int, read: Any = None, **options: Any) -> None:
        """Match some rows, and check that they are those of the whole."""
        found = match_rows(read or self.read, self.statistics, first, last, **options)
        assert_rows(found, self.whole, first, last)


def assert_rows(found: ps.Result, whole: ps.Result, first: int, last: int) -> None:
    """Check that a result is that of some rows of another one, to the bit."""
    for name in ("disparity", "flags", "confidence", "uncertainty"):
        ours, theirs = getattr(found, name), getattr(whole, name)
        assert (ours is None) == (theirs is None)
        if ours is not None:
            assert ours.dtype == theirs.dtype
            np.testing.assert_array_equal(ours, theirs[first:last])

    assert found.settings == whole.settings
    assert found.pair is None


_known: dict[str, BandCase] = {}


def case(name: str) -> BandCase:
    """Return a case, made once."""
    if name not in _known:
        _known[name] = BandCase(name)
    return _known[name]


def bands_of(height: int, rows: int) -> Iterable[tuple[int, int]]:
    """Cut a height into bands."""
    for first in range(0, height, rows):
        yield first, min(first + rows, height)


@pytest.mark.parametrize("name", CASES)
@given(ends=st.tuples(st.floats(0, 1), st.floats(0, 1)), threads=st.sampled_from([1, 2, 5, None]))
@hypothesis_settings(max_examples=6)
def test_rows_by_themselves_are_those_of_the_whole(
    name: str, ends: tuple[float, float], threads: int | None
) -> None:
    known = case(name)
    height = known.read.size[0]
    first, last = sorted(round(end * (height - 1)) for end in ends)
    known.check(first, last + 1, threads=threads)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("rows", [63, 64, 65, 128])
def test_bands_from_below_are_those_of_the_whole(name: str, rows: int) -> None:
    known = case(name)
    for first, last in reversed(list(bands_of(known.read.size[0], rows))):
        known.check(first, last)


def test_masks_of_some_rows_alone_may_be_left_out() -> None:
    for name in ("robust soft masked floats", "paper masked", "fast masked", "nsad"):
        known = case(name)

        def read(first: int, last: int) -> Any:
            left, right, *masks = known.read(first, last)  # noqa: B023 - called in this turn
            return left, right, *(None if mask.all() else mask for mask in masks)

        for first, last in bands_of(known.read.size[0], 40):
            known.check(first, last, read)


# What is read


def test_black_borders_of_parts_are_those_of_the_whole(tmp_path: Path) -> None:
    read = scene(SIZE, "uint16", masked=False, soft=None)
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    # Bent inward, as by a lens: runs come from above, from below and from the sides.
    v, u = 2 * y / SIZE[0] - 1, 2 * x / SIZE[1] - 1
    inside = (abs(u) < 0.85 + 0.15 * v**2) & (abs(v) < 0.8 + 0.2 * u**2)
    pair = [np.where(inside, np.maximum(image, 1), 0).astype(np.uint16) for image in read.images]
    whole = ps.match(*pair, num_disparities=16, scales=False)
    assert (whole.flags == ps.Flag.MASKED).mean() > 0.1

    def rows(first: int, last: int) -> Any:
        return pair[0][first:last], pair[1][first:last], None, None

    statistics = pair_statistics(rows, SIZE, num_disparities=16)
    assert [one for one in statistics.findings if one.topic == "border"] == [
        one for one in whole.findings if one.topic == "border"
    ]
    statistics.save(tmp_path / "pair.npz")
    for first, last in bands_of(SIZE[0], 64):
        found = match_rows(rows, load(tmp_path / "pair.npz"), first, last)
        assert_rows(found, whole, first, last)


def test_overlays_are_masked_in_parts_as_in_the_whole(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    layers = [ndimage.gaussian_filter(rng.normal(size=(200, 320)), sigma) for sigma in (1, 3, 8)]
    texture = 110 + 12 * sum(layer / layer.std() for layer in layers)
    pair = []
    for view in (texture[:, :300], texture[:, 12:312]):
        image = Image.fromarray(
            np.clip(view + rng.normal(0, 1, view.shape), 0, 255).astype(np.uint8)
        )
        ImageDraw.Draw(image).text((30, 90), "12:00:01 REC 47", fill=255, font_size=24)
        pair.append(np.asarray(image))
    whole = ps.match(*pair, num_disparities=24, scales=False)
    masked = whole.flags == ps.Flag.MASKED
    assert 0.01 < masked.mean() < 0.2

    def rows(first: int, last: int) -> Any:
        return pair[0][first:last], pair[1][first:last], None, None

    statistics = pair_statistics(rows, masked.shape, num_disparities=24)
    [(top, bottom, left, right)] = statistics.overlays
    assert masked[top:bottom, left:right].all()
    assert masked.sum() == (bottom - top) * (right - left)
    assert [one for one in statistics.findings if one.topic == "border"] == [
        one for one in whole.findings if one.topic == "border"
    ]
    statistics.save(tmp_path / "pair.npz")
    for first, last in bands_of(200, 64):
        found = match_rows(rows, load(tmp_path / "pair.npz"), first, last)
        assert_rows(found, whole, first, last)


@pytest.mark.parametrize(
    "name", ["robust", "robust areas", "paper", "fast", "fast areas", "sad", "refined", "nsad"]
)
def test_no_more_rows_are_read_than_the_halo(name: str) -> None:
    known = case(name)

    around = halo(known.statistics.settings, known.statistics.blur_compensation)
    height = known.read.size[0]

    for first, last in [(0, 1), (120, 121), (140, 200), (height - 1, height)]:
        known.read.asked.clear()
        match_rows(known.read, known.statistics, first, last)

        expected = max(0, first - around), min(height, last + around)
        assert known.read.asked[0] == expected
        assert len(known.read.asked) <= 1 + (known.read.masks[0] is not None)

        for top, bottom in known.read.asked[1:]:
            assert (top, bottom) == (max(0, expected[0] - 95), min(height, expected[1] + 95))


def test_the_halo_is_what_the_stages_reach() -> None:
    paper = ps.Settings.preset("paper")
    plain = replace(paper, optimizer="wta", shiftable=False, window=1, confidence=False)
    assert halo(plain) == 3

    reaches: list[tuple[dict[str, Any], int]] = [
        ({"window": 9}, 4),
        ({"window": 9, "shiftable": True}, 8),
        ({"neighborhood": 9}, 1),
        ({"optimizer": "dp"}, 0),
        ({"optimizer": "so"}, 0),
        ({"optimizer": "sgm"}, 79),
        ({"median": 3}, 1),
        ({"subpixel": True}, 3),
        ({"confidence": True}, 4),
        ({"min_confidence": 0.5}, 4),
        ({"guided_median": True}, 5),
        ({"lr_check": 1}, 32),
        ({"uniqueness": 1}, 32),
        ({"speckle_size": 50}, 82),
    ]

    for options, more in reaches:
        assert halo(replace(plain, **options)) == 3 + more, options

    kernel = np.full((9, 3), 1 / 27)
    versions = ps.BlurCompensation(noise=(0, 0), kernels=[(None, kernel), (kernel.T, None)])
    assert halo(plain, versions) == 3 + 4

    assert halo(replace(paper, cost="sad", window=1, optimizer="wta", confidence=False)) == 1


# What it takes


MEASURED = """
import json
from pathlib import Path
import numpy as np
import phasestereo as ps
from phasestereo import _core
from phasestereo_large.bands import match_rows, pair_statistics, working_memory

def memory(name):
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(name))

rows, cols, count, dtype, preset, level = json.loads(ORDER)
options = {"preset": preset, "known": ps.Known(noise=level)}
noise = np.random.default_rng(0).integers(0, 256, (64, cols + 4), np.uint8).astype(dtype)
def read(first, last):
    some = noise[np.arange(first, last) % 64]
    return some[:, 4:], some[:, :-4], None, None
statistics = pair_statistics(read, (3 * rows, cols), num_disparities=count, threads=1, **options)
workers = _core.Workers(2)
match_rows(read, statistics, 0, 1, threads=1)
Path("/proc/self/clear_refs").write_text("5")
before = memory("VmRSS")
match_rows(read, statistics, rows, 2 * rows, threads=workers)
expected = working_memory(statistics, rows, threads=2, itemsize=noise.itemsize)
print(json.dumps([memory("VmHWM") - before, expected]))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the system does not report it")
@pytest.mark.parametrize(
    "order",
    [
        (600, 1500, 32, "uint8", "robust", 1.0),
        (64, 1000, 800, "float32", "robust", 1.0),
        (300, 1000, 64, "float64", "fast", None),
        (100, 1000, 128, "uint16", "paper", None),
    ],
    ids=str,
)
def test_no_more_memory_is_taken_than_is_said(
    monkeypatch: pytest.MonkeyPatch, order: tuple[Any, ...]
) -> None:
    return_memory_at_once(monkeypatch)
    finished = run(MEASURED.replace("ORDER", repr(json.dumps(order))))
    assert finished.returncode == 0, finished.stderr
    taken, expected = json.loads(finished.stdout)
    assert 0.2 * expected < taken < expected


# Errors


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize("name", ["robust areas", "fast masked"])
def test_errors_of_the_reader_come_out_as_they_are(name: str, error: BaseException) -> None:
    known = case(name)
    left, right = known.read.images
    read = Reading(left, right, known.read.masks)
    read.error = error
    read.failing = lambda *_: True

    with pytest.raises(type(error)) as raised:
        match_rows(read, known.statistics, 20, 90)
    assert raised.value is error

    read.failing = lambda *_: False
    known.check(20, 90, read)


def test_what_progress_raises_comes_out() -> None:
    known, workers = case("robust"), _core.Workers(2)

    def stop(*_: int) -> None:
        raise InterruptedError("enough")

    with pytest.raises(InterruptedError, match="enough"):
        match_rows(known.read, known.statistics, 40, 200, threads=workers, progress=stop)

    calls: list[tuple[int, int]] = []
    known.check(40, 200, threads=workers, progress=lambda *rows: calls.append(rows))

    assert calls
    assert calls[-1][0] == calls[-1][1]


@pytest.mark.parametrize("name", ["robust", "fast"])
@pytest.mark.parametrize(("change", "error", "message"), WRONG_ROWS)
def test_wrong_rows_are_refused(
    name: str, change: Callable[[Any], Any], error: type[Exception], message: str
) -> None:
    known = case(name)
    with pytest.raises(error, match=message):
        match_rows(lambda *rows: change(known.read(*rows)), known.statistics, 3, 4)


def test_rows_of_another_type_than_measured_are_refused() -> None:
    known, other = case("fast"), scene(SIZE, "uint16")
    with pytest.raises(TypeError, match="^read: got uint16 for the rows .*, uint8"):
        match_rows(other, known.statistics, 20, 30)


def test_pixels_that_are_no_numbers_are_refused_where_they_are() -> None:
    read = scene(SIZE, "float32")
    statistics = gathered(read, preset="fast")
    whole = read.matched(num_disparities=16, preset="fast")
    read.images[0][200, 7] = np.inf
    assert_rows(match_rows(read, statistics, 0, 100), whole, 0, 100)
    with pytest.raises(ValueError, match="^left: got inf"):
        match_rows(read, statistics, 100, 250)


@pytest.mark.parametrize("name", ["robust", "fast"])
@pytest.mark.parametrize(
    ("ends", "error"),
    [
        ((-1, 5), ValueError), ((5, 5), ValueError), ((6, 5), ValueError), ((0, 301), ValueError),
        ((300, 301), ValueError), ((0, 1.5), TypeError), ((0.0, 5), TypeError),
        (("a", 5), TypeError), ((0, None), TypeError),
    ],
)  # fmt: skip
def test_rows_that_there_are_not_are_refused(name: str, ends: Any, error: type[Exception]) -> None:
    known = case(name)
    known.read.asked.clear()
    with pytest.raises(error, match="^(first|last): got"):
        match_rows(known.read, known.statistics, *ends)
    assert known.read.asked == []


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"statistics": "robust"}, TypeError, "^statistics: got str"),
        ({"statistics": None}, TypeError, "^statistics: got NoneType"),
        ({"read": 3}, TypeError, "^read: got int"),
        ({"threads": 0}, ValueError, "^threads: got 0"),
        ({"threads": 1.0}, TypeError, "^threads: got float"),
        ({"progress": 3}, TypeError, "^progress: got int"),
        ({"overlap": 3}, TypeError, "overlap"),
    ],
    ids=str,
)
def test_wrong_arguments_are_refused(
    options: dict[str, Any], error: type[Exception], message: str
) -> None:
    for name in ("robust", "fast"):
        known = case(name)
        arguments: dict[str, Any] = {"read": known.read, "statistics": known.statistics} | options
        with pytest.raises(error, match=message):
            match_rows(**arguments, first=0, last=9)


def test_a_halo_is_of_settings() -> None:
    with pytest.raises(TypeError, match="^settings: got str"):
        halo("robust")  # type: ignore[arg-type] # that is the point
    with pytest.raises(TypeError, match="^blur_compensation: got int"):
        halo(ps.Settings(), 3)  # type: ignore[arg-type] # that is the point


# Threads and processes


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_statistics_and_bands_are_made_in_a_forked_child() -> None:
    finished = run_forking("""
import phasestereo_large as large
pair = np.random.default_rng(0).integers(0, 256, (2, 200, 90), np.uint8)
read = lambda first, last: (pair[0][first:last], pair[1][first:last], None, None)
statistics = large.pair_statistics(read, (200, 90), num_disparities=8)
expected = ps.match(*pair, num_disparities=8).disparity[60:]
workers = ps._core.Workers(3)
large.match_rows(read, statistics, 0, 60, threads=workers)
def same():
    statistics = large.pair_statistics(read, (200, 90), num_disparities=8)
    found = large.match_rows(read, statistics, 60, 200, threads=workers).disparity
    return np.array_equal(found, expected, equal_nan=True)
""")
    assert finished.returncode == 0, finished.stderr


def test_parts_of_tall_pairs_share_what_some_rows_say() -> None:
    # Only three bands of the rows are asked; the others, without texture, would say otherwise.
    rng = np.random.default_rng(8)
    left = rng.integers(0, 256, (1200, 48), np.uint8)
    for third in range(3):
        left[400 * third : 400 * third + 140] = 90
    pair = left, np.roll(left, -3, axis=1)
    settings = replace(ps.PRESETS["paper"], lr_check=1, speckle_size=9)
    whole = ps.match(*pair, num_disparities=8, settings=settings)

    def read(first: int, last: int) -> tuple[Any, Any, None, None]:
        return pair[0][first:last], pair[1][first:last], None, None

    statistics = pair_statistics(read, (1200, 48), num_disparities=8, settings=settings)
    assert statistics.tally is not None
    assert statistics.tally[-1] == 3 * 96 * 48
    for first, last in ((0, 90), (600, 700), (1150, 1200)):
        found = match_rows(read, statistics, first, last)
        assert_rows(found, whole, first, last)

    bare = replace(statistics, tally=None)
    with pytest.raises(ValueError, match=r"^tally: got None; accepts the tally of the whole pair"):
        match_rows(read, bare, 0, 90)


def test_several_threads_may_match_bands_at_the_same_time() -> None:
    known = [case(name) for name in CASES]
    with ThreadPoolExecutor(2 * len(known)) as threads:
        checks = [threads.submit(one.check, 90, 150, threads=1 + n % 2)
                  for n, one in enumerate([*known, *known])]  # fmt: skip
    assert [check.exception() for check in checks] == [None] * len(checks)

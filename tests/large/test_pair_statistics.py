"""What is known of a whole pair that is read by rows: found out as by a match, kept, handed on."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
import phasestereo_large as large
from support.processes import run

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

RNG = np.random.default_rng(7)
SIZE = (150, 130)
DTYPES = ("uint8", "uint16", "float32", "float64")
PRESETS = list(ps.PRESETS)


class Reading:
    """A pair in memory that is read by rows, and what was asked for."""

    def __init__(
        self,
        left: NDArray[Any],
        right: NDArray[Any],
        masks: tuple[NDArray[np.bool_] | None, NDArray[np.bool_] | None] = (None, None),
    ) -> None:
        self.images, self.masks = (left, right), masks
        self.size = left.shape[:2]
        self.asked: list[tuple[int, int]] = []
        self.failing: Callable[[int, int], bool] = lambda _first, _last: False
        self.error: BaseException = LookupError("torn")

    def __call__(self, first: int, last: int) -> tuple[Any, Any, Any, Any]:
        assert 0 <= first < last <= self.size[0]
        self.asked.append((first, last))

        if self.failing(first, last):
            raise self.error

        left, right = (image[first:last] for image in self.images)
        masks = (None if mask is None else mask[first:last] for mask in self.masks)
        left_mask, right_mask = masks
        return left, right, left_mask, right_mask

    def matched(self, **options: Any) -> ps.Result:
        """Match the whole of it in memory."""
        left_mask, right_mask = self.masks
        options = {"scales": False} | options  # parts are matched at one scale
        return ps.match(*self.images, left_mask=left_mask, right_mask=right_mask, **options)


def textured(size: tuple[int, int], seed: int = 1) -> NDArray[np.float64]:
    """Return squares of several sizes."""
    rng = np.random.default_rng(seed)

    y, x = np.mgrid[: size[0], : size[1]]
    shades = [(side, rng.uniform(0, 255, (size[0] // side + 1, size[1] // side + 1))) for side in
              (13, 7, 4, 2, 1)]  # fmt: skip

    parts = [weight * shade[y // side, x // side] for (side, shade), weight in
             zip(shades, (0.3, 0.25, 0.2, 0.15, 0.1), strict=True)]  # fmt: skip

    total: NDArray[np.float64] = np.sum(parts, axis=0)
    return total


def scene(
    size: tuple[int, int] = SIZE,
    dtype: str = "uint8",
    *,
    shift: int = 5,
    soft: slice | None = None,
    masked: bool = False,
) -> Reading:
    """Return a pair of one disparity, the left image soft in some rows."""
    wide = textured((size[0], size[1] + shift))
    left, right = wide[:, :-shift].copy(), wide[:, shift:].copy()

    if soft is not None:
        padded = np.pad(left, 3, mode="symmetric")
        windows = np.lib.stride_tricks.sliding_window_view(padded, (7, 7))
        left[soft] = windows.mean((2, 3))[soft]

    unit = {"uint8": 1, "uint16": 200, "float32": 1e-3, "float64": 1e6}[dtype]
    pair = [(unit * image.round()).astype(dtype) for image in (left, right)]

    if not masked:
        return Reading(pair[0], pair[1])

    left_mask, right_mask = (np.random.default_rng(seed).random(size) > 0.01 for seed in (2, 3))
    left_mask[size[0] // 3 : size[0] // 3 + 20] = False
    right_mask[-30:-5] = False
    return Reading(pair[0], pair[1], (left_mask, right_mask))


def gathered(read: Reading, **options: Any) -> large.PairStatistics:
    """Return the statistics of a pair, with 16 disparities unless others are given."""
    return large.pair_statistics(read, read.size, **{"num_disparities": 16} | options)


def assert_same(ours: Any, theirs: Any) -> None:
    """Check that two records have the same fields, arrays to the bit, NaN like NaN."""
    assert type(ours) is type(theirs)
    if isinstance(ours, np.ndarray):
        assert ours.dtype == theirs.dtype
        np.testing.assert_array_equal(ours, theirs)
    elif isinstance(ours, tuple | list):
        assert len(ours) == len(theirs)
        for one, other in zip(ours, theirs, strict=True):
            assert_same(one, other)
    elif hasattr(ours, "__dataclass_fields__"):
        for field in fields(ours):
            assert_same(getattr(ours, field.name), getattr(theirs, field.name))
    else:
        assert ours == theirs or (np.isnan(ours) and np.isnan(theirs))


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("dtype", DTYPES)
def test_statistics_knows_what_a_match_finds_out(dtype: str, masked: bool) -> None:  # noqa: FBT001 - a parameter
    read = scene((200, 150), dtype, soft=slice(0, None), masked=masked)
    message, result = gathered(read), read.matched(num_disparities=16)
    assert result.blur is not None
    assert result.blur.blur.side == "left"

    assert_same(message.blur, result.blur)
    assert message.settings == result.settings
    assert (message.size, message.dtype) == ((200, 150), dtype)
    assert (message.min_disparity, message.num_disparities) == (0, 16)
    assert message.blur_compensation is not None
    # All types have the values of bytes here.
    assert message.ranges is None
    assert message.packing[1] == 8


def test_areas_of_blur_are_found() -> None:
    read = scene((420, 130), soft=slice(180, None))

    statistics = gathered(read)
    assert statistics.blur is not None
    assert len(statistics.blur.blurs) == 2
    assert statistics.blur_compensation is not None
    assert_same(statistics.blur_compensation.labels, statistics.blur.labels)

    whole = read.matched(num_disparities=16).blur
    assert whole is not None
    assert_same(statistics.blur, whole)


def test_what_is_given_is_not_looked_for() -> None:
    read = scene()
    versions = ps.BlurCompensation(noise=(1.0, 2.0))

    assert gathered(read, known=ps.Known(blur_compensation=versions)).blur_compensation is versions
    known = ps.Known(noise=(1.0, 3.0))
    statistics = gathered(read, known=known, compensate_blur=False).blur_compensation
    assert statistics is not None
    assert statistics.noise == (1.0, 3.0)

    read.asked.clear()
    assert gathered(read, known=ps.Known(noise=1.0), preset="fast", adaptive_p2=0).blur is None
    # For black borders, and for overlays.
    assert read.asked == [(0, 1)] + 2 * [(0, SIZE[0])]


PLAIN = {"preset": "fast", "adaptive_p2": 0}
"""What asks for nothing to be known of the whole pair."""


@pytest.mark.parametrize(
    ("options", "dtype", "passes"),
    [
        (PLAIN, "uint8", 0),
        (PLAIN, "uint16", 1),
        (PLAIN, "float32", 1),
        (PLAIN | {"cost": "sad"}, "float32", 1),
        (PLAIN | {"cost": "sad", "intensity_range": (0.0, 1.0)}, "float32", 1),
        (PLAIN | {"adaptive_p2": 1.0}, "uint8", 1),
        (PLAIN | {"guided_median": True}, "uint8", 1),
        (PLAIN | {"min_confidence": 0.5}, "uint8", 2),
        ({"preset": "paper"}, "uint8", 2),
        ({"preset": "paper", "confidence": False}, "uint8", 0),
        ({"preset": "paper"}, "float64", 3),
    ],
    ids=str,
)
def test_no_more_is_read_than_needed(options: dict[str, Any], dtype: str, passes: int) -> None:
    read = scene(dtype=dtype)
    gathered(read, **options)
    # Black borders and overlays are looked for in any case.
    assert read.asked == [(0, 1)] + (2 + passes) * [(0, SIZE[0])]


def test_large_pairs_are_read_some_rows_at_a_time() -> None:
    image = RNG.integers(0, 12, (130, 70_000), np.uint8)
    read = Reading(image, image)
    statistics = gathered(read, preset="paper", confidence=False, adaptive_p2=1.0)
    # Black borders, overlays, and what the setting needs.
    assert read.asked == [(0, 1)] + 3 * [(0, 59), (59, 118), (118, 130)]
    jumps = np.abs(np.diff(image.astype(int), axis=1))
    assert statistics.roughness == (jumps.sum(), jumps.size)


def test_ranges_are_those_of_all_but_outliers() -> None:
    image = RNG.random((150, 130)).astype(np.float32)
    statistics = gathered(Reading(image, image * 2), preset="fast")
    assert statistics.ranges is not None
    inner = np.sort(image.astype(np.float64).ravel())[[19, -20]]
    np.testing.assert_allclose(statistics.ranges[0], 1000 * inner, rtol=1e-12)
    np.testing.assert_allclose(statistics.ranges[1], 2000 * inner, rtol=1e-12)


# Refusals


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"num_disparities": 0}, ValueError, "^num_disparities: got 0"),
        ({"num_disparities": 131}, ValueError, "^num_disparities: got 131"),
        ({"num_disparities": 1.5}, TypeError, "^num_disparities: got float"),
        ({"min_disparity": 130}, ValueError, "^min_disparity: got 130"),
        ({"min_disparity": "0"}, TypeError, "^min_disparity: got str"),
        ({"threads": 0}, ValueError, "^threads: got 0"),
        ({"threads": "all"}, TypeError, "^threads: got str"),
        ({"window": 4}, ValueError, "^window: got 4"),
        ({"widow": 5}, TypeError, "^widow: no such setting"),
        ({"settings": 3}, TypeError, "^settings: got int"),
        ({"known": 3}, TypeError, "^known: got int"),
        ({"size": 5}, TypeError, "^size: got 5"),
        ({"size": (150,)}, TypeError, "^size: got"),
        ({"size": (150, 130, 1)}, TypeError, "^size: got"),
        ({"size": (150.0, 130)}, TypeError, "^size: got"),
        ({"size": (0, 130)}, ValueError, "^size: got"),
        ({"size": (150, -130)}, ValueError, "^size: got"),
        ({"size": (150, 129)}, ValueError, "^read: got"),
        ({"read": None}, TypeError, "^read: got NoneType"),
        ({"read": "file.tif"}, TypeError, "^read: got str"),
    ],
    ids=str,
)
def test_statistics_refuses_what_a_match_refuses(
    preset: str, options: dict[str, Any], error: type[Exception], message: str
) -> None:
    defaults: dict[str, Any] = {
        "read": scene(), "size": SIZE, "num_disparities": 16, "preset": preset
    }  # fmt: skip
    with pytest.raises(error, match=message):
        large.pair_statistics(**defaults | options)


def test_a_preset_that_there_is_not_is_refused() -> None:
    with pytest.raises(ValueError, match="^preset: got 'slow'"):
        gathered(scene(), preset="slow")


def changed(index: int, value: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return a function that changes one of four things, in all rows but the first."""

    def change(found: tuple[Any, ...]) -> tuple[Any, ...]:
        return (*found[:index], value(found[index]), *found[index + 1 :])

    return change


WRONG_ROWS: list[tuple[Callable[[Any], Any], type[Exception], str]] = [
    (lambda _: None, TypeError, "^read: got NoneType; accepts a tuple of four"),
    (lambda found: found[:3], TypeError, "^read: got tuple of 3; accepts a tuple of four"),
    (lambda found: found[0], TypeError, "^read: got ndarray; accepts a tuple of four"),
    (changed(0, lambda left: np.vstack([left, left])), ValueError, "^right: got"),
    (lambda found: (found[0][1:], found[1][1:], *found[2:]), ValueError, "^(read|left): got"),
    (
        lambda found: (*np.hstack(found[:2] * 2)[None].repeat(2, 0), None, None),
        ValueError,
        "^read: got",
    ),
    (lambda found: (found[0][:, 1:], found[1][:, 1:], *found[2:]), ValueError, "^read: got"),
    (changed(0, lambda left: left.astype(np.int32)), TypeError, "^left: got dtype int32"),
    (changed(1, lambda right: right.astype(np.uint16)), TypeError, "^right: got dtype uint16"),
    (changed(1, lambda _: "right"), TypeError, "^right: got"),
    (changed(0, lambda left: left[0]), ValueError, "^left: got shape"),
    (changed(2, lambda _: np.ones(3, bool)), ValueError, "^left_mask: got shape"),
    (changed(3, lambda _: np.ones((9, 9), np.uint8)), TypeError, "^right_mask: got dtype uint8"),
]


@pytest.mark.parametrize("is_late", [False, True])
@pytest.mark.parametrize(("change", "error", "message"), WRONG_ROWS)
def test_wrong_rows_are_refused(
    change: Callable[[Any], Any],
    error: type[Exception],
    message: str,
    is_late: bool,  # noqa: FBT001 - a parameter
) -> None:
    read = scene()

    def wrong(first: int, last: int) -> Any:
        is_first = last == 1
        return read(first, last) if is_late and is_first else change(read(first, last))

    with pytest.raises(error, match=message):
        large.pair_statistics(wrong, SIZE, num_disparities=16)


def test_rows_of_another_type_than_the_first_are_refused() -> None:
    read = scene()

    def wrong(first: int, last: int) -> Any:
        left, right, *masks = read(first, last)
        kind = np.uint8 if last == 1 else np.uint16
        return left.astype(kind), right.astype(kind), *masks

    message = "^read: got uint16 for the rows 0 to 150; accepts that of others, uint8"
    with pytest.raises(TypeError, match=message):
        large.pair_statistics(wrong, SIZE, num_disparities=16)


@pytest.mark.parametrize("row", [0, 149])
def test_pixels_that_are_no_numbers_are_refused_unless_masked(row: int) -> None:
    read = scene(dtype="float32")
    read.images[0][row, 3] = np.inf
    with pytest.raises(ValueError, match="^left: got inf"):
        gathered(read)
    read.masks = (~np.isinf(read.images[0]), None)
    masked = gathered(read)
    read.images[0][row, 3] = np.nan  # is "no data"
    read.masks = (None, None)
    found = gathered(read)
    for name in ("packing", "ranges", "roughness", "tally", "search"):
        assert getattr(found, name) == getattr(masked, name)


ERRORS = [LookupError("torn"), OSError(5, "unreadable"), KeyboardInterrupt(), SystemExit(3)]


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize("dtype", ["uint8", "float32"])
def test_what_a_reader_raises_comes_out_as_it_is(error: BaseException, dtype: str) -> None:
    whole = scene((200, 150), dtype)
    gathered(whole)
    assert len(whole.asked) > 2

    for number in range(len(whole.asked)):
        read = scene((200, 150), dtype)
        read.error = error
        read.failing = lambda *_: len(read.asked) == number + 1  # noqa: B023 - called in this turn

        with pytest.raises(type(error)) as raised:
            gathered(read)
        assert raised.value is error
        assert len(read.asked) == number + 1

    gathered(whole)


def test_statistics_can_be_interrupted_while_it_reads() -> None:
    finished = run("""
import _thread, threading, time
import numpy as np, phasestereo_large as large
image = np.random.default_rng(0).integers(0, 256, (1, 70000), np.uint8)
def read(first, last):
    if last > 1:
        threading.Timer(0.1, _thread.interrupt_main).start()
        time.sleep(0.2)
    return (image.repeat(last - first, 0),) * 2 + (None, None)
try:
    large.pair_statistics(read, (100000, 70000), num_disparities=4, preset="paper")
except KeyboardInterrupt:
    print("stopped")
""")
    assert (finished.returncode, finished.stdout.strip()) == (0, "stopped"), finished.stderr


def test_a_reader_may_match() -> None:
    finished = run("""
import os
os.environ["RAYON_NUM_THREADS"] = "1"
import numpy as np, phasestereo as ps, phasestereo_large as large
pair = np.random.default_rng(0).integers(0, 256, (2, 100, 90), np.uint8)
def read(first, last):
    ps.match(*pair, num_disparities=4)
    return pair[0][first:last], pair[1][first:last], None, None
statistics = large.pair_statistics(read, (100, 90), num_disparities=8)
large.match_rows(read, statistics, 0, 100)
""")
    assert finished.returncode == 0, finished.stderr


def test_statistics_at_the_same_time_do_not_disturb_one_another() -> None:
    expected = [gathered(scene((160, 100), dtype)) for dtype in DTYPES]
    torn = scene()
    torn.failing = lambda _first, last: last > 1

    with ThreadPoolExecutor(16) as threads:
        found = [
            threads.submit(gathered, scene((160, 100), DTYPES[turn % 4]), threads=1 + turn % 3)
            for turn in range(12)
        ]
        failed = [threads.submit(gathered, torn) for _ in range(4)]

    for turn, one in enumerate(found):
        assert_same(one.result(), expected[turn % 4])
    assert [str(one.exception()) for one in failed] == 4 * ["torn"]

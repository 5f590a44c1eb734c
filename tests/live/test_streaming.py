"""Streams: every frame that can be matched is, as `match` does it, and the others are reported."""

from __future__ import annotations

import logging
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
import phasestereo_live as live
from phasestereo import io
from phasestereo_bench.degradation import Degradation, disk_psf
from support.footage import (
    COLS,
    COUNT,
    INTRA,
    LOSSLESS,
    ROWS,
    damage,
    film,
    pair,
    shift,
    side_by_side,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from phasestereo_live.video.streaming import Failure

FAST: dict[str, Any] = {"num_disparities": COUNT, "preset": "fast"}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder, which holds a video of ten frames."""
    monkeypatch.chdir(tmp_path)
    film(Path("video.mkv"), side_by_side(10), **LOSSLESS)
    return tmp_path


def disparities(frames: Any) -> dict[int, float]:
    """Return the disparity that most of each frame has, by the frame's number."""
    return {frame.index: float(np.median(frame.result.disparity)) for frame in frames}


def expected(indices: Any) -> dict[int, float]:
    return {index: float(shift(index)) for index in indices}


# Sources


def test_frames_of_a_video_are_matched_as_pairs_are() -> None:
    alone: dict[str, Any] = {"reestimate": 1, "temporal_filter": False}
    frames = list(live.stream("video.mkv", num_disparities=COUNT, threads=1, **alone))

    assert [frame.index for frame in frames] == list(range(10))
    assert [frame.time for frame in frames] == pytest.approx([index / 20 for index in range(10)])

    for frame in frames:
        left, right = pair(frame.index)
        np.testing.assert_array_equal(frame.left, left)
        np.testing.assert_array_equal(frame.right, right)
        result = ps.match(left, right, num_disparities=COUNT)
        np.testing.assert_array_equal(frame.result.disparity, result.disparity)
        np.testing.assert_array_equal(frame.result.flags, result.flags)
        assert abs(np.median(result.disparity[:, COUNT:]) - shift(frame.index)) < 0.25


@pytest.mark.parametrize(
    ("source", "right", "layout"),
    [
        ("above.mkv", None, "top-bottom"),
        ("l.mkv", Path("r.mkv"), None),
        ("lossy.mp4", None, None),
        ("left", "right", None),
        (".", None, None),
        ([pair(index) for index in range(3)], None, None),
        (side_by_side(3), None, "side-by-side"),
    ],
)
def test_every_kind_of_source_is_matched(source: Any, right: Any, layout: Any) -> None:
    pairs = [pair(index) for index in range(3)]
    film(Path("above.mkv"), [np.concatenate(views) for views in pairs], **LOSSLESS)
    lossy: dict[str, Any] = {"codec": "libx264", "pixels": "yuv420p", "options": {"crf": "12"}}
    film(Path("lossy.mp4"), side_by_side(3), **lossy)
    for side, name in enumerate(("left", "right")):
        film(Path(f"{name[0]}.mkv"), [views[side] for views in pairs], **LOSSLESS)
        Path(name).mkdir()
        for index in range(3):
            io.write_image(f"{name}/{index}.png", pair(index, color=index > 0)[side])

    assert disparities(live.stream(source, right, layout=layout, **FAST)) == expected(range(3))


def test_frames_are_taken_from_images_at_hand_only_when_asked_for() -> None:
    given: list[int] = []

    def pairs() -> Iterator[Any]:
        for index in range(5):
            given.append(index)
            assert threading.current_thread() is threading.main_thread()
            yield pair(index)

    frames = live.stream(pairs(), **FAST)
    assert frames.length is None
    assert given == []
    next(frames)
    assert given == [0]


@pytest.mark.parametrize(
    ("options", "indices"),
    [
        ({"start": 3}, range(3, 10)),
        ({"stop": 4}, range(4)),
        ({"start": 1, "stop": 8, "every": 3}, range(1, 8, 3)),
        ({"start": 20}, ()),
        ({"stop": 0}, ()),
    ],
)
def test_some_of_the_frames(options: dict[str, Any], indices: Any) -> None:
    assert disparities(live.stream("video.mkv", **options, **FAST)) == expected(indices)
    known = live.stream([pair(index) for index in range(10)], **options, **FAST)
    assert known.length == len(indices)


# Failures


def test_damaged_frames_are_reported_and_skipped() -> None:
    damage(film(Path("a.mkv"), side_by_side(8), **INTRA), Path("b.mkv"), {0, 4, 5})
    failures: list[Failure] = []
    frames = live.stream("b.mkv", on_error=failures.append, **FAST)

    assert disparities(frames) == expected([1, 2, 3, 6, 7])
    assert [failure.index for failure in failures] == [0, 4, 5]
    assert [failure.time for failure in failures] == pytest.approx([0, 0.2, 0.25])
    assert str(failures[1]).startswith("frame 4: damaged")
    assert frames.failed == 3


def test_failures_become_warnings_of_the_logger(caplog: pytest.LogCaptureFixture) -> None:
    damage(film(Path("a.mkv"), side_by_side(3), **INTRA), Path("b.mkv"), {1})
    with caplog.at_level(logging.WARNING, "phasestereo"):
        assert disparities(live.stream("b.mkv", **FAST)) == expected([0, 2])
    assert [record.getMessage()[:17] for record in caplog.records] == ["frame 1: damaged "]


def test_broken_images_and_images_of_other_sizes_are_skipped() -> None:
    for index in range(5):
        for view, image in zip(("left", "right"), pair(index), strict=True):
            Path(view).mkdir(exist_ok=True)
            io.write_image(f"{view}/{index}.png", image)

    data = Path("left/1.png").read_bytes()
    Path("left/1.png").write_bytes(data[: len(data) // 2])
    io.write_image("right/3.png", pair(3)[1][:, :-1])
    Path("right/4.png").unlink()

    failures: list[Failure] = []
    assert disparities(live.stream(".", on_error=failures.append, **FAST)) == expected([0, 2])

    errors = {failure.index: str(failure.error) for failure in failures}
    assert set(errors) == {1, 3, 4}
    assert "left/1.png" in errors[1]
    assert errors[3].startswith("right: got (64, 95) pixels")
    assert "right/4" in errors[4]


@pytest.mark.parametrize(
    "item",
    [
        None,
        (1, 2, 3),
        (pair(0)[0], pair(0)[1].astype(np.float32)),
        (np.full((ROWS, COLS), np.inf), np.zeros((ROWS, COLS))),
        (np.zeros((4, 4), np.uint8), np.zeros((4, 4), np.uint8)),  # too narrow
        ("left", "right"),
    ],
)
def test_what_is_no_pair_is_skipped(item: Any) -> None:
    failures: list[Failure] = []
    frames = live.stream([pair(0), item, pair(2)], on_error=failures.append, **FAST)
    assert disparities(frames) == expected([0, 2])
    assert [failure.index for failure in failures] == [1]


def test_what_on_error_raises_ends_the_stream() -> None:
    def stop(failure: Failure) -> None:
        raise failure.error

    pairs: list[Any] = [pair(0), (1, 2), pair(2)]
    frames = live.stream(pairs, on_error=stop, **FAST)
    next(frames)

    with pytest.raises(TypeError, match="^left"):
        next(frames)
    with pytest.raises(StopIteration):
        next(frames)


def test_what_an_iterable_raises_passes() -> None:
    def pairs() -> Iterator[Any]:
        yield pair(0)
        raise ZeroDivisionError

    frames = live.stream(pairs(), **FAST)
    next(frames)
    with pytest.raises(ZeroDivisionError):
        next(frames)


# What is wrong from the start


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"num_disparities": COLS + 1}, ValueError, f"num_disparities: got {COLS + 1}"),
        ({"num_disparities": 0}, ValueError, "num_disparities: got 0"),
        ({"num_disparities": 8.0}, TypeError, "num_disparities: got float"),
        ({"min_disparity": "0"}, TypeError, "min_disparity: got str"),
        ({"preset": "slow"}, ValueError, "preset: got 'slow'"),
        ({"widow": 3}, TypeError, "widow: no such setting"),
        ({"start": -1}, ValueError, "start: got -1"),
        ({"stop": 1.5}, TypeError, "stop: got float"),
        ({"every": 0}, ValueError, "every: got 0"),
        ({"on_error": 1}, TypeError, "on_error: got int"),
        ({"layout": "both"}, ValueError, "layout: got 'both'"),
        ({"left_mask": np.ones((3, 3), bool)}, ValueError, "left_mask: got shape"),
        ({"known": 1.0}, TypeError, "known: got float"),
        ({"num_disparities": 16385}, ValueError, "num_disparities"),
        ({"num_disparities": True}, TypeError, "num_disparities"),
        ({"reestimate": 0}, ValueError, "reestimate: got"),
        ({"reestimate": 1.5}, TypeError, "reestimate: got"),
        ({"second": "net.txt"}, ValueError, "second: got 'net.txt'"),
        ({"second": np.ones((ROWS, COLS))}, TypeError, "second: got ndarray"),
        ({"timeout": 1}, ValueError, "timeout: got one without"),
        ({"second": np.add, "timeout": 0}, ValueError, "timeout: got 0"),
    ],
)
def test_wrong_arguments_are_refused_at_once(
    options: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=f"^{message}"):
        live.stream("video.mkv", **{**FAST, **options})


def test_more_disparities_than_columns_are_refused_with_the_first_image() -> None:
    frames = live.stream(iter([pair(0)]), num_disparities=COLS + 1, preset="fast")
    with pytest.raises(ValueError, match="^num_disparities: got 97"):
        next(frames)


# A second matcher


def truth(left: NDArray[np.uint8], _right: object) -> NDArray[np.float32]:
    """Return the true map of a frame: all of it is shifted by the same."""
    count = [np.array_equal(left, pair(index)[0]) for index in range(4)].index(True)
    return np.full(left.shape[:2], shift(count), np.float32)


def test_every_frame_has_a_second_map() -> None:
    alone: dict[str, Any] = {"reestimate": 1, "temporal_filter": False, "num_disparities": COUNT}
    pairs = [pair(index) for index in range(4)]
    for frame, images in zip(live.stream(iter(pairs), second=truth, **alone), pairs, strict=True):
        single = ps.match(*images, num_disparities=COUNT, second=truth)
        assert np.array_equal(frame.result.disparity, single.disparity)
        assert frame.result.timings["second"] > 0


def test_a_second_matcher_that_hangs_costs_one_timeout() -> None:
    end, calls = threading.Event(), []

    def hangs(left: NDArray[np.uint8], _right: object) -> NDArray[np.float32]:
        calls.append(left)
        end.wait()
        return np.zeros(left.shape[:2], np.float32)

    pairs = [pair(index) for index in range(3)]
    try:
        frames = list(live.stream(iter(pairs), second=hangs, timeout=0.2, **FAST))
    finally:
        end.set()
    assert len(calls) == 1
    said = [one.sentence for f in frames for one in f.result.findings if one.topic == "map"]
    assert len(said) == 3
    assert "no answer within 0.2 s" in said[0]
    assert all("still at work on an earlier pair" in one for one in said[1:])
    assert disparities(frames) == expected(range(3))


# Masks and settings


def test_masks_and_settings_hold_for_every_frame() -> None:
    mask = np.ones((ROWS, COLS), bool)
    mask[10:20, 30:50] = False
    options: dict[str, Any] = {"min_disparity": 2, "window": 5, "fill": False, "left_mask": mask}

    frames = list(live.stream("video.mkv", temporal_filter=False, **options, **FAST))
    assert len(frames) == 10
    for frame in frames:
        result = ps.match(frame.left, frame.right, **options, **FAST)
        np.testing.assert_array_equal(frame.result.disparity, result.disparity)
        assert np.isnan(frame.result.disparity[15, 40])


def test_cameras_of_two_sizes_and_types_are_matched_as_pairs_are() -> None:
    mask = np.ones((ROWS // 2, COLS // 2), bool)
    mask[4:8, 20:30] = False
    pairs = [(left, right[::2, ::2].astype(np.uint16) * 257) for left, right in map(pair, range(3))]
    failures: list[Failure] = []
    options: dict[str, Any] = {"right_mask": mask, "fill": False, "preset": "fast"}
    options |= {"num_disparities": 16}
    pairs[1] = pairs[1][0][:, 1:], pairs[1][1]  # the mask is of the whole image
    stream = live.stream(
        pairs, temporal_filter=False, on_error=failures.append, reestimate=1, **options
    )
    frames = list(stream)
    assert [frame.index for frame in frames] == [0, 1, 2]
    for frame in frames:
        result = ps.match(frame.left, frame.right, **options)
        np.testing.assert_array_equal(frame.result.disparity, result.disparity)
    assert not failures

    with pytest.raises(ValueError, match=r"^right_mask: got shape \(32, 48\)"):
        next(live.stream([pair(0)], right_mask=mask, **FAST))


# What is kept and freed


def test_one_rig_matches_all() -> None:
    frames = live.stream("video.mkv", **FAST)
    assert frames.rig.settings == ps.PRESETS["fast"]
    assert [frames.rig.frames for _ in frames] == list(range(1, 11))


def ahead() -> list[str]:
    return [one.name for one in threading.enumerate() if one.name.startswith("phasestereo-ahead")]


def test_files_are_freed_when_a_stream_is_closed() -> None:
    with live.stream("video.mkv", **FAST) as frames:
        next(frames)
        assert ahead()
    assert not ahead()
    assert list(frames) == []
    frames.close()

    frames = live.stream("video.mkv", **FAST)
    next(frames)
    del frames  # which closes it
    assert not ahead()

    frames = live.stream("video.mkv", **FAST)
    frames.close()  # before it began
    assert list(frames) == []


def test_several_streams_at_a_time() -> None:
    streams = [live.stream("video.mkv", **FAST) for _ in range(3)]
    for one, two, three in zip(*streams, strict=True):
        np.testing.assert_array_equal(one.result.disparity, two.result.disparity)
        assert three.index == one.index


# Blur


def soft(index: int, *, blurred: bool) -> Any:
    """Return one pair of the same scene with new noise, its left image blurred or not."""
    recipes = [Degradation(disk_psf(3.0) if blurred else None, noise=1, seed=index), Degradation()]
    return tuple(recipe(view) for recipe, view in zip(recipes, pair(0), strict=True))


def reused(results: Any) -> list[bool]:
    return [result.blur.reused for result in results]


def results(shots: Any, **options: Any) -> list[Any]:
    return [frame.result for frame in live.stream(shots, num_disparities=COUNT, **options)]


def test_blur_is_estimated_anew_when_it_changes() -> None:
    shots = [soft(index, blurred=index >= 3) for index in range(6)]
    found = results(shots)
    assert reused(found) == [False, True, True, False, True, True]
    assert [result.blur.blur.side for result in found] == 3 * ["none"] + 3 * ["left"]
    for index in (0, 3):
        result = ps.match(*shots[index], num_disparities=COUNT)
        np.testing.assert_array_equal(found[index].disparity, result.disparity)


@pytest.mark.parametrize(
    ("count", "expected"), [(1, [False] * 5), (2, [False, True] * 2 + [False])]
)
def test_blur_is_estimated_anew_after_so_many_frames(count: int, expected: list[bool]) -> None:
    shots = [soft(index, blurred=False) for index in range(5)]
    assert reused(results(shots, reestimate=count)) == expected

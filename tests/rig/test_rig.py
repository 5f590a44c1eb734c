"""A rig learns from frame to frame what its cameras are, and notices what changes."""

from __future__ import annotations

import os
import pickle
import re
import subprocess
import sys
from dataclasses import replace
from functools import cache
from itertools import cycle, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo.matching import match_silently
from phasestereo_bench.degradation import Degradation, disk_psf
from phasestereo_bench.rendering import render_pair
from phasestereo_bench.rigs.geometry import Misaligned
from support.saved_rigs import sealed

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    Image = NDArray[np.uint8]

EDGE = 40  # pixels of the rendered scene on either side of a frame
SIZE = 240, 320
COUNT = 32


@cache
def scene() -> Any:
    return render_pair(3, height=SIZE[0] + EDGE, width=SIZE[1] + 2 * EDGE, num_disparities=COUNT)


def cut(image: Image, rows: int = 0, columns: int = 0) -> Image:
    top, left = EDGE // 2 + rows, EDGE + columns
    return image[top : top + SIZE[0], left : left + SIZE[1]]


def noisy(image: NDArray[Any], seed: int) -> Image:
    noise = np.random.default_rng(seed).normal(0, 2, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def frame(index: int, *, rows: int = 0, columns: int = 0, gain: float = 1.0) -> Any:
    """Return one frame with fresh noise, its right image moved, both exposed longer."""
    images = cut(scene().left), cut(scene().right, rows, columns)
    return tuple(noisy(image * gain, 2 * index + side) for side, image in enumerate(images))


def wrong(result: ps.Result, nearer: int = 0) -> float:
    """Return the share of the pixels that is off by more than a pixel."""
    return float(np.mean(~(np.abs(result.disparity - cut(scene().truth) - nearer) <= 1)))


def test_rows_are_known_better_with_every_frame_and_a_straight_pair_stays_as_it_is() -> None:
    rig = ps.Rig(preset="fast")
    for index in range(12):
        rig.match(*frame(index))
    assert rig.field is not None
    assert rig.field.rms < 0.06
    assert rig.field.error < 0.1
    assert not rig.field.applied
    assert rig.events == ()


def test_rows_that_move_are_right_in_that_frame() -> None:
    rig, steady = ps.Rig(preset="fast"), ps.TemporalFilter()
    before = [rig.match(*frame(index), temporal_filter=steady) for index in range(4)]
    after = rig.match(*frame(4, rows=-2), temporal_filter=steady)

    assert wrong(after) < wrong(before[-1]) + 0.03
    assert after.temporal_support is not None
    assert after.temporal_support.max() == 1
    assert after.alignment is not None
    assert after.alignment.applied
    assert after.alignment.coefficients[0] == pytest.approx(2, abs=0.1)
    assert [(event.subject, event.frame) for event in rig.events] == [("rows", 4)]


def test_rows_that_are_off_from_the_start_are_not_taken_for_drift() -> None:
    rig = ps.Rig(preset="fast")
    for index in range(20):
        rig.match(*frame(index, rows=-1))
    assert rig.field is not None
    assert rig.field.applied
    assert rig.field.coefficients[0] == pytest.approx(1, abs=0.06)
    assert rig.field.coefficients[1] == pytest.approx(0, abs=0.06)


def test_rows_that_begin_to_sway_are_found_in_each_frame_until_they_come_to_rest() -> None:
    rig, heights = ps.Rig(preset="fast"), [0.0] * 3 + [1.5, -1.0, 2.0] + [0.0] * 22
    results = []
    for index, height in enumerate(heights):
        left, right = frame(index)
        shaken = Misaligned(wobble=height)(
            replace(scene(), left=left, right=right, truth=None), "right"
        )
        results.append(rig.match(left, shaken.right))

    swaying = [bool(one.alignment and one.alignment.sway) for one in results]
    assert swaying == [height != 0 for height in heights]
    assert max(map(wrong, results)) < wrong(results[0]) + 0.03
    events = [(event.frame, event.sentence[:14]) for event in rig.events]
    assert events == [(3, "rows sway from"), (25, "rows sway no m")]
    assert rig.field is not None
    assert rig.field.rms < 0.12


def test_the_range_keeps_up_with_things_that_come_nearer() -> None:
    rig, steady = ps.Rig(preset="fast"), ps.TemporalFilter()
    for index in range(16):
        result = rig.match(*frame(index, columns=index), temporal_filter=steady)
        assert result.search is not None
        most = result.search.min_disparity + result.search.num_disparities - 1
        assert most >= np.nanpercentile(cut(scene().truth), 99.9) + index
        assert wrong(result, nearer=index) < 0.25
    assert [event.subject for event in rig.events] == ["range"]


@pytest.mark.parametrize(
    ("disparity", "size"), [(COUNT + 24, (60, 48)), (COUNT + 60, (10, 150)), (-12, (60, 48))]
)
def test_what_enters_beyond_all_else_is_found_in_its_frame(
    disparity: int, size: tuple[int, int]
) -> None:
    rows, columns = size
    rig, texture = ps.Rig(preset="fast"), np.random.default_rng(7).integers(0, 256, (*size, 3))
    for index in range(6):
        left, right = frame(index)
        if index >= 3:
            left[99 : 99 + rows, 150 : 150 + columns] = noisy(texture, 100 + index)
            first = 150 - disparity
            right[99 : 99 + rows, first : first + columns] = noisy(texture, 200 + index)
        result = rig.match(left, right)
        if index >= 3:
            seen = result.disparity[102 : 96 + rows, 154 : 146 + columns]
            assert np.mean(np.abs(seen - disparity) <= 2) > 0.9
    (event,) = (one for one in rig.events if one.subject == "range")
    assert event.frame == 3
    assert event.sentence.startswith("things entered")


@pytest.mark.parametrize("late", [-1, 0, 1, 2])
def test_a_camera_that_is_late_is_an_event_once_both_have_moved(late: int) -> None:
    rig = ps.Rig(preset="fast")
    path = [0, 0, 0, 0, 3, 7, 9, 8, 5]
    for index in range(len(path)):
        delays = max(-late, 0), max(late, 0)
        moved = [path[max(index - delay, 0)] for delay in delays]
        both = zip((scene().left, scene().right), moved, strict=True)
        rig.match(*(noisy(cut(one, columns=by), 2 * index + by) for one, by in both))
    said = [(one.frame, one.sentence) for one in rig.events if "late" in one.sentence]
    if not late:
        assert said == []
        return
    ((when, sentence),) = said
    assert when <= 4 + abs(late) + 1
    side, s = ("right" if late > 0 else "left"), "s" if abs(late) > 1 else ""
    assert sentence.startswith(f"the {side} camera is late by {abs(late)} frame{s}:")


@pytest.mark.parametrize("side", [0, 1])
def test_a_camera_that_stops_is_an_event_in_that_frame(side: int) -> None:
    rig = ps.Rig(preset="fast")
    for index in range(8):
        images = list(frame(index))
        images[side] = frame(min(index, 4))[side]
        rig.match(*images)
    (event,) = (one for one in rig.events if one.subject == "cameras")
    assert event.frame == 5
    assert event.sentence.startswith(f"the {('left', 'right')[side]} camera has stopped")


def test_an_exposure_that_pumps_moves_nothing() -> None:
    rig, steady = ps.Rig(preset="fast"), ps.TemporalFilter()
    gains = 1 + 0.5 * np.sin(np.arange(14))
    maps = [
        rig.match(*frame(index, gain=gain), temporal_filter=steady)
        for index, gain in enumerate(gains)
    ]
    pairs = pairwise(maps[6:])
    jumps = [np.mean(np.abs(two.disparity - one.disparity) > 1) for one, two in pairs]
    assert np.mean(jumps) < 0.02
    assert not any(one.alignment.applied for one in maps if one.alignment)


def test_an_image_that_becomes_soft_is_an_event() -> None:
    rig = ps.Rig()
    soft = Degradation(disk_psf(3.0))
    for index in range(8):
        left, right = frame(index)
        rig.match(soft(left) if index >= 3 else left, right)
    events = [(event.subject, event.frame, event.sentence) for event in rig.events]
    assert events == [("blur", 3, "the left image is the softer one")]


def test_a_saved_rig_goes_on_to_the_bit(tmp_path: Path) -> None:
    rig = ps.Rig(preset="fast")
    for index in range(3):
        rig.match(*frame(index))
    rig.save(tmp_path / "rig.txt")

    loaded = ps.Rig.load(tmp_path / "rig.txt", preset="fast")
    copied = pickle.loads(pickle.dumps(rig))  # noqa: S301 -- our own
    results = [one.match(*frame(3, rows=1)) for one in (rig, loaded, copied)]
    assert all(result.search is not None for result in results)
    assert {result.search.origin for result in results if result.search} == {"found"}
    for result in results[1:]:
        np.testing.assert_array_equal(result.disparity, results[0].disparity)
    for one in (loaded, copied):
        one.save(tmp_path / "again.txt")
        rig.save(tmp_path / "rig.txt")
        assert (tmp_path / "again.txt").read_text() == (tmp_path / "rig.txt").read_text()


def test_a_saved_rig_has_what_its_sensors_are(tmp_path: Path) -> None:
    rig, soft = ps.Rig(), Degradation(disk_psf(2.0))
    rig.match(soft(frame(0)[0]), frame(0)[1])
    for name in ("rig.txt", "again.txt"):
        rig.save(tmp_path / name)
        rig = ps.Rig.load(tmp_path / name)
    assert (tmp_path / "again.txt").read_text() == (tmp_path / "rig.txt").read_text()
    assert checks(rig)["blur"][0] == pytest.approx(1, abs=0.3)  # of a disk half its radius


@pytest.mark.parametrize("change", [("rig 2", "rig 1"), ("240", "241"), ("rows moved", "no event")])
def test_a_damaged_file_is_refused(tmp_path: Path, change: tuple[str, str]) -> None:
    path = tmp_path / "rig.txt"
    rig = ps.Rig(preset="fast")
    for index in range(5):
        rig.match(*frame(index, rows=-2 if index == 4 else 0))
    rig.save(path)
    path.write_text(path.read_text().replace(*change))
    with pytest.raises(ValueError, match=r"rig\.txt: rig: got"):
        ps.Rig.load(path)


FORKED = """
import os, signal, sys, threading, time, warnings
warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 advises against it
import numpy as np, phasestereo as ps
rig, steady, begun = ps.Rig(threads=1), ps.TemporalFilter(), threading.Event()
large, small = (np.random.default_rng(0).integers(0, 256, (2, n, n), np.uint8) for n in (900, 80))
rig.match(*small)

def match():
    begun.set()
    rig.match(*large, temporal_filter=steady)

thread = threading.Thread(target=match)
thread.start()
begun.wait()
time.sleep(0.3)
child = os.fork()
if child == 0:
    signal.alarm(120)
    assert rig.frames == 1
    rig.match(*small, temporal_filter=steady)
    assert rig.frames == 2
    os._exit(0)
_, status = os.waitpid(child, 0)
assert os.waitstatus_to_exitcode(status) == 0, status
thread.join()
assert rig.frames == 2
"""


def test_a_child_that_is_forked_during_a_match_has_the_rig_for_itself() -> None:
    run = subprocess.run(  # noqa: S603 -- our own interpreter on our own code
        [sys.executable, "-c", FORKED], capture_output=True, check=False, text=True
    )
    assert run.returncode == 0, run.stderr


def test_numbers_that_cannot_be_are_refused_or_harmless(tmp_path: Path) -> None:
    # Their checksum is right: no number may hang or crash what reads it.
    rig = ps.Rig(preset="fast", threads=1)
    rig.match(*frame(0))
    rig.save(path := tmp_path / "rig.txt")
    body = path.read_text("utf-8").split("\n")[1]
    places = [found.span() for found in re.finditer(r"-?\d+(\.\d+)?(e-?\d+)?", body)]
    values = "-1", "0", "1e308", "-1e308", str(2**64 - 1), str(2**63), "null", "9" * 30, "2.5"
    rng = np.random.default_rng(0)
    refused = 0
    for (start, end), value in zip(rng.permutation(places)[:36], cycle(values), strict=False):
        path.write_text(sealed(body[:start] + value + body[end:]), "utf-8")
        try:
            found = ps.Rig.load(path, preset="fast", threads=1)
            found.match(*frame(0))
            found.test()
        except (ValueError, TypeError):
            refused += 1
    assert 12 < refused < 36


def test_images_of_another_size_and_failures() -> None:
    rig = ps.Rig(preset="fast")
    rig.match(*frame(0))
    known = rig.disparities
    with pytest.raises(ValueError, match="^right: got"):
        rig.match(frame(1)[0], frame(1)[1][:20])
    assert (rig.frames, rig.disparities) == (1, known)

    left, right = frame(1)
    rig.match(left[:, :200], right[:, :200])
    assert rig.frames == 2
    assert "200 x 240" in rig.events[-1].sentence
    with pytest.raises(ValueError, match="^rig: its images needed no rectification"):
        rig.export("rig.yml")


def test_a_right_camera_of_half_the_resolution_is_followed() -> None:
    rig = ps.Rig(preset="fast")
    for index in range(3):
        left, right = frame(index)
        right = right.reshape(SIZE[0] // 2, 2, SIZE[1] // 2, 2, -1).mean(axis=(1, 3))
        last, alone = rig.match(left, right), ps.match(left, right, preset="fast")
    assert wrong(last) < wrong(alone) + 0.02
    assert [one.topic for one in last.findings] == [one.topic for one in alone.findings]
    assert rig.events == ()


def test_an_anchor_says_what_no_pair_shows() -> None:
    assert ps.Rig().offset is None
    assert ps.Rig(anchor=(1.5, 0)).offset == (-1.5, 0.1)
    plane = np.full(400, 20.0) + np.random.default_rng(0).normal(0, 4, 400)
    offset = ps.Rig(anchor=(plane, np.full(400, 21.0))).offset
    assert offset is not None
    assert offset[0] == pytest.approx(1, abs=0.5)
    assert offset[1] == pytest.approx(0.2, abs=0.03)
    for anchor in ((np.nan, 1.0), 3.0, ("a", 1.0)):
        with pytest.raises((TypeError, ValueError), match="^anchor: got"):
            ps.Rig(anchor=anchor)  # type: ignore[arg-type]  # the point


def test_numbers_without_end_and_settings_that_are_none_are_refused() -> None:
    rig, huge = ps.Rig(preset="fast"), 10**400
    with pytest.raises(ValueError, match="^anchor: got a huge number"):
        ps.Rig(anchor=(1, huge))
    with pytest.raises(ValueError, match="^rows: got a huge number"):
        rig.test({"rows": huge})
    with pytest.raises(TypeError, match="^settings: got NoneType; accepts Settings$"):
        rig.change(None, 16)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="^num_disparities: got 0; accepts 1 or more$"):
        rig.change(rig.settings, 0)
    assert rig.match(*frame(0)).disparity.shape == SIZE


def test_a_rig_is_read_while_it_matches_and_matches_in_a_child() -> None:
    """Readers get what was known after the last frame, and keep no match out."""
    rig = ps.Rig(preset="fast", threads=1)
    rig.match(*frame(0))
    known, seen = _read(rig), []

    def look(_done: int, _total: int) -> None:
        with pytest.raises(ValueError, match="^rig: got one that is in use"):
            rig.match(*frame(1))
        seen.append(_read(rig) == known)
        if len(seen) == 1 and hasattr(os, "fork"):
            child = os.fork()
            if not child:
                os._exit(
                    0 if _read(rig) == known and rig.match(*frame(1)) and rig.frames == 2 else 1
                )
            seen.append(os.waitpid(child, 0)[1] == 0)

    options: dict[str, Any] = {
        "settings": rig.settings,
        "threads": 1,
        "rig": rig._core,
        "reestimate": 30,
    }
    match_silently(frame(1), (None, None), (0, None), progress=look, **options)
    assert len(seen) >= 1 + hasattr(os, "fork")
    assert all(seen)
    assert rig.frames == 2


def _read(rig: ps.Rig) -> str:
    return repr((rig.frames, rig.health, rig.events, rig, rig.test(), pickle.dumps(rig)))


def checks(
    rig: ps.Rig, focal: float | None = None, **limits: float
) -> dict[str, tuple[float, bool | None]]:
    return {one.name: (one.value, one.passed) for one in rig.test(limits, focal=focal)}


def test_limits_tell_a_good_rig_from_one_that_is_off() -> None:
    rig, turned = ps.Rig(), ps.Rig()
    off = Misaligned(down=1.5, turn=0.3)
    for index in range(3):
        left, right = frame(index)
        rig.match(left, right)
        moved = off(replace(scene(), left=left, right=right, truth=None), "right")
        turned.match(left, moved.right)

    good = checks(rig, focal=300)
    assert all(passed is not False for _, passed in good.values())
    assert good["drift"][1] is None
    assert good["exposure"][0] == pytest.approx(1, abs=0.03)
    assert good["noise"][0] == pytest.approx(2 / 255, abs=0.003)
    assert checks(rig)["rotation"][1] is None

    value, passed = checks(turned, focal=300)["rotation"]
    assert value == pytest.approx(np.hypot(0.3, np.degrees(1.5 / 300)), abs=0.03)
    assert not passed
    assert not checks(turned)["rows"][1]
    assert checks(turned, rows=5, focal=300, rotation=1)["rows"][1]

    # What was asked for and cannot be told fails.
    assert checks(rig, drift=1)["drift"][1] is False
    assert checks(ps.Rig())["wrong"][1] is False
    for options in ({"rosw": 1.0}, {"rows": -1.0}, {"focal": 0.0}):
        with pytest.raises(ValueError, match="^(limits|rows|focal): got"):
            checks(rig, **options)


def test_a_range_that_is_given_is_tested_for_its_reserve() -> None:
    rig = ps.Rig(preset="fast", num_disparities=COUNT + 8)
    rig.match(*frame(0))
    rig.match(*frame(1))
    assert rig.disparities == (0, COUNT + 8)
    most = int(np.rint(np.percentile(cut(scene().truth), 99.8)))
    value, passed = checks(rig)["reserve"]
    assert value == pytest.approx(COUNT + 7 - most, abs=1)
    assert passed
    assert not checks(rig, reserve=value + 1)["reserve"][1]


def test_raw_frames_of_a_real_rig_are_followed(data: Path) -> None:
    rig = ps.Rig()
    errors = []
    for left in sorted((data / "rigs" / "euroc" / "cam0").glob("*.png"))[:3]:
        rig.match(left, left.parents[1] / "cam1" / left.name)
        assert rig.field is not None
        errors.append(rig.field.error)
    assert errors[-1] < errors[0]
    assert rig.field is not None
    assert rig.field.applied
    assert len(rig.events) <= 1

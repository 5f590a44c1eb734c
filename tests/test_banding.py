"""Bands of rows of a pair, by themselves or one after another: as in a match of the whole."""

from __future__ import annotations

import os
import pickle
import threading
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

import phasestereo as ps
from phasestereo import _core, banding
from phasestereo.banding import Sweep, halo, match_rows, working_memory
from test_process import run, run_forking
from test_surveying import ERRORS, WRONG_ROWS, Reading, scene, surveyed

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
    "robust told": ({"noise": (0.5, 1.0), "min_disparity": -3}, "float64", True, None),
    "paper": ({"preset": "paper"}, "uint8", False, None),
    "paper masked": ({"preset": "paper"}, "uint16", True, None),
    "paper floats": ({"preset": "paper", "min_confidence": 0.3}, "float32", True, None),
    "fast": ({"preset": "fast"}, "uint8", False, None),
    "fast masked": ({"preset": "fast"}, "float64", True, None),
    "fast areas": ({"preset": "fast", "equalise": True}, "uint8", False, slice(150, None)),
    "sad": ({"preset": "fast", "cost": "sad", "subpixel": True}, "float32", True, None),
    "nsad": ({"preset": "paper", "cost": "nsad", "shiftable": False}, "uint8", True, None),
    "refined": (
        {"preset": "fast", "guided": True, "median": 3, "subpixel": True, "consistency": 1,
         "uniqueness": 5, "speckle_size": 9, "confidence": True, "fill": False},
        "uint8", True, None,
    ),
}  # fmt: skip


class Case:
    """A pair, what is known of it, and how it is matched as a whole."""

    def __init__(self, name: str) -> None:
        options, dtype, masked, soft = CASES[name]
        self.read = scene(AREAS if soft else SIZE, dtype, masked=masked, soft=soft)
        self.survey = surveyed(self.read, **options)
        self.whole = self.read.matched(**{"num_disparities": 16} | options)
        self.is_sgm = self.survey.settings.optimizer == "sgm"

    def check(self, found: ps.Result, first: int, last: int) -> None:
        """Check that a result is that of some rows."""
        assert_rows(found, self.whole, first, last)


def assert_rows(found: ps.Result, whole: ps.Result, first: int, last: int) -> None:
    """Check that a result is that of some rows of another one, to the bit."""
    for name in ("disparity", "flags", "confidence"):
        ours, theirs = getattr(found, name), getattr(whole, name)
        assert (ours is None) == (theirs is None)
        if ours is not None:
            assert ours.dtype == theirs.dtype
            np.testing.assert_array_equal(ours, theirs[first:last])
    assert found.settings == whole.settings
    assert found.pair is None


_known: dict[str, Case] = {}


def case(name: str) -> Case:
    """Return a case, made once."""
    if name not in _known:
        _known[name] = Case(name)
    return _known[name]


def cuts_of(height: int, places: Iterable[float]) -> list[int]:
    """Return the first row, those at some shares of the height, and the last one."""
    return sorted({0, height, *(round(place * height) for place in places)})


def swept(sweep: Sweep, cuts: Iterable[int], whole: ps.Result) -> None:
    """Sweep on, and check each band."""
    for last in cuts:
        first = sweep.done
        assert_rows(sweep.advance(last), whole, first, last)
        assert sweep.done == last


PLACES = st.lists(st.floats(0.01, 0.99), max_size=4)


@pytest.mark.parametrize("name", CASES)
@given(places=PLACES, threads=st.sampled_from([1, 2, 5, None]))
@hypothesis_settings(max_examples=8)
def test_a_sweep_gives_what_a_match_of_the_whole_gives(
    name: str, places: list[float], threads: int | None
) -> None:
    known = case(name)
    sweep = Sweep(known.read, known.survey, threads=threads)
    assert sweep.done == 0
    swept(sweep, cuts_of(known.read.size[0], places)[1:], known.whole)


@pytest.mark.parametrize("name", [name for name in CASES if "robust" not in name])
@given(ends=st.tuples(st.floats(0, 1), st.floats(0, 1)))
@hypothesis_settings(max_examples=8)
def test_rows_by_themselves_are_those_of_the_whole(name: str, ends: tuple[float, float]) -> None:
    known = case(name)
    height = known.read.size[0]
    first, last = sorted(round(end * (height - 1)) for end in ends)
    known.check(match_rows(known.read, known.survey, first, last + 1), first, last + 1)


@pytest.mark.parametrize("name", [name for name in CASES if "robust" not in name])
def test_a_row_at_a_time(name: str) -> None:
    known = case(name)
    for first in (0, 1, 99, 100, 119, 120, known.read.size[0] - 1):
        known.check(match_rows(known.read, known.survey, first, first + 1), first, first + 1)


@pytest.mark.parametrize("name", ["robust", "fast", "refined"])
def test_a_sweep_of_few_rows_at_a_time(name: str) -> None:
    known = case(name)
    sweep = Sweep(known.read, known.survey, threads=1)
    swept(sweep, [1, 2, 31, 32, 33, 64, 65, 200, 201, known.read.size[0]], known.whole)


@pytest.mark.parametrize("name", ["robust", "robust areas", "robust soft masked floats"])
def test_paths_that_begin_at_the_first_row_are_exact(name: str) -> None:
    known = case(name)
    for first, last in [(0, 40), (64, 100), (170, 300)]:
        found = match_rows(known.read, known.survey, first, last, overlap=first + 200)
        known.check(found, first, last)


def test_paths_that_begin_below_are_nearly_exact() -> None:
    known = case("robust")
    for overlap in (0, 40):
        found = match_rows(known.read, known.survey, 250, 300, overlap=overlap)
        theirs = known.whole.disparity[250:300]
        assert np.mean(np.isclose(found.disparity, theirs, atol=1, equal_nan=True)) > 0.9
        known.read.asked.clear()
        match_rows(known.read, known.survey, 250, 300, overlap=overlap)
        assert min(first for first, _ in known.read.asked) > 0


def test_overlap_makes_no_difference_to_others() -> None:
    known = case("fast")
    for overlap in (None, 0, 1, 1000):
        known.check(match_rows(known.read, known.survey, 100, 130, overlap=overlap), 100, 130)


@pytest.mark.parametrize("name", ["robust", "robust areas", "fast masked", "refined"])
@pytest.mark.parametrize("done", [1, 32, 100, 290])
def test_a_sweep_goes_on_from_its_state(name: str, done: int) -> None:
    known = case(name)
    before = Sweep(known.read, known.survey)
    swept(before, [done], known.whole)
    state = before.state()
    after = Sweep(known.read, known.survey, state=state)
    assert after.done == done
    swept(after, [done + 1, known.read.size[0]], known.whole)
    swept(Sweep(known.read, known.survey, state=state), [known.read.size[0]], known.whole)
    swept(before, [known.read.size[0]], known.whole)


def test_a_sweep_that_has_not_begun_or_is_done_has_a_state() -> None:
    known = case("robust")
    sweep = Sweep(known.read, known.survey)
    again = Sweep(known.read, known.survey, state=sweep.state())
    swept(again, [300], known.whole)
    over = Sweep(known.read, known.survey, state=again.state())
    assert over.done == 300
    with pytest.raises(ValueError, match="^first, last: got 300, 301"):
        over.advance(301)


@pytest.mark.parametrize("name", ["robust areas", "fast"])
def test_a_sweep_goes_on_in_another_process(name: str, tmp_path: Path) -> None:
    known = case(name)
    known.survey.save(tmp_path / "survey")
    left, right = known.read.images
    np.savez(tmp_path / "pair.npz", left=left, right=right)
    sweep = Sweep(known.read, known.survey)
    sweep.advance(77)
    np.savez(tmp_path / "state.npz", **sweep.state())  # type: ignore[arg-type] # arrays by name
    finished = run(f"""
import numpy as np, phasestereo as ps
from phasestereo import surveying
folder = {str(tmp_path)!r} + "/"
pair, told = np.load(folder + "pair.npz"), surveying.load(folder + "survey")
left, right = pair["left"], pair["right"]
read = lambda first, last: (left[first:last], right[first:last], None, None)
with np.load(folder + "state.npz", allow_pickle=False) as state:
    sweep = ps.Sweep(read, told, state=state)
assert sweep.done == 77
result = sweep.advance(200)
np.savez(folder + "found.npz", disparity=result.disparity, flags=result.flags)
np.savez(folder + "state.npz", **sweep.state())
""")
    assert finished.returncode == 0, finished.stderr
    with np.load(tmp_path / "found.npz") as found:
        np.testing.assert_array_equal(found["disparity"], known.whole.disparity[77:200])
        np.testing.assert_array_equal(found["flags"], known.whole.flags[77:200])
    with np.load(tmp_path / "state.npz") as state:
        swept(Sweep(known.read, known.survey, state=state), [known.read.size[0]], known.whole)


def test_bands_match_with_a_survey_that_was_pickled() -> None:
    known = case("fast areas")
    told = pickle.loads(pickle.dumps(known.survey))  # noqa: S301 - our own bytes
    known.check(match_rows(known.read, told, 140, 190), 140, 190)


def test_masks_of_some_rows_alone_may_be_left_out() -> None:
    for name in ("robust soft masked floats", "paper masked", "fast masked", "nsad"):
        known = case(name)

        def read(first: int, last: int) -> Any:
            left, right, *masks = known.read(first, last)  # noqa: B023 - called in this turn
            return left, right, *(None if mask.all() else mask for mask in masks)

        swept(Sweep(read, known.survey), [40, 100, 130, known.read.size[0]], known.whole)


def test_colours_and_strides_of_any_kind_match() -> None:
    plain = scene(SIZE)
    colour = np.stack([plain.images[0], plain.images[0] // 2, plain.images[0]], -1)
    read = Reading(colour, plain.images[1][..., None])
    told = surveyed(read, preset="paper")
    whole = read.matched(num_disparities=16, preset="paper")
    doubled = [np.repeat(image, 2, axis=1) for image in read.images]

    def strided(first: int, last: int) -> Any:
        left, right = (image[first:last, ::2] for image in doubled)
        return [left, right.astype(right.dtype.newbyteorder()), None, None]

    swept(Sweep(strided, told), [50, 300], whole)
    assert_rows(match_rows(read, told, 20, 33), whole, 20, 33)


# What is read


@pytest.mark.parametrize("name", ["paper", "fast", "fast areas", "sad", "refined", "nsad"])
def test_no_more_rows_are_read_than_the_halo(name: str) -> None:
    known = case(name)
    around = halo(known.survey.settings, known.survey.equalisation)
    assert around is not None
    height = known.read.size[0]
    for first, last in [(0, 1), (120, 121), (140, 200), (height - 1, height)]:
        known.read.asked.clear()
        match_rows(known.read, known.survey, first, last)
        expected = max(0, first - around), min(height, last + around)
        assert known.read.asked[0] == expected
        assert len(known.read.asked) <= 1 + (known.read.masks[0] is not None)
        for top, bottom in known.read.asked[1:]:
            assert (top, bottom) == (max(0, expected[0] - 95), min(height, expected[1] + 95))


@pytest.mark.parametrize("name", ["robust", "robust areas", "paper", "fast"])
def test_a_sweep_reads_each_row_once_and_those_around_bands_again(name: str) -> None:
    known = case(name)
    settings, versions = known.survey.settings, known.survey.equalisation
    images, drafted, _ = _core.reach(settings, versions)
    known.read.asked.clear()
    sweep, height = Sweep(known.read, known.survey), known.read.size[0]
    chosen = 0
    for last in (50, 51, 150, height):
        known.read.asked.clear()
        sweep.advance(last)
        end = min(height, -(-(last + drafted) // 32) * 32)
        if end <= chosen:
            assert known.read.asked == []
            continue
        top = max(0, chosen - images)
        if known.is_sgm:
            top = top // 32 * 32
        assert known.read.asked == [(top, min(height, end + images))]
        chosen = end


def test_the_halo_is_what_the_stages_reach() -> None:
    plain = ps.Settings(optimizer="wta", shiftable=False, window=1, confidence=False)
    assert halo(plain) == 3
    assert halo(ps.PRESETS["robust"]) is None
    reaches: list[tuple[dict[str, Any], int]] = [
        ({"window": 9}, 4),
        ({"window": 9, "shiftable": True}, 8),
        ({"neighborhood": 9}, 1),
        ({"median": 3}, 1),
        ({"subpixel": True}, 3),
        ({"confidence": True}, 4),
        ({"min_confidence": 0.5}, 4),
        ({"guided": True}, 5),
        ({"consistency": 1}, 32),
        ({"uniqueness": 1}, 32),
        ({"speckle_size": 50}, 82),
    ]
    for options, more in reaches:
        assert halo(replace(plain, **options)) == 3 + more, options
    kernel = np.full((9, 3), 1 / 27)
    versions = ps.Equalisation(noise=(0, 0), kernels=[(None, kernel), (kernel.T, None)])
    assert halo(plain, versions) == 3 + 4
    assert halo(ps.Settings(cost="sad", window=1, optimizer="wta", confidence=False)) == 1


def test_working_memory_grows_with_what_it_should() -> None:
    for name in ("robust", "fast areas", "paper"):
        told = case(name).survey
        base = working_memory(told, 100, threads=1, itemsize=1)
        assert base > 0
        assert working_memory(told, 200, threads=1, itemsize=1) > base
        assert working_memory(told, 100, threads=2, itemsize=1) > base
        assert working_memory(told, 100, threads=1, itemsize=240) > base


# Errors


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize("name", ["robust areas", "fast masked"])
def test_a_sweep_goes_on_after_an_error_as_if_nothing_had_been(
    name: str, error: BaseException
) -> None:
    known = case(name)
    left, right = known.read.images
    read = Reading(left, right, known.read.masks)
    read.error = error
    sweep = Sweep(read, known.survey)
    for last in (60, 200, read.size[0]):
        done, state = sweep.done, sweep.state()
        read.failing = lambda *_: True
        with pytest.raises(type(error)) as raised:
            sweep.advance(last)
        assert raised.value is error
        with pytest.raises(type(error)):
            match_rows(read, known.survey, 20, 30, overlap=0)
        assert sweep.done == done
        assert sweep.state().keys() == state.keys()
        read.failing = lambda *_: False
        swept(sweep, [last], known.whole)


def test_a_second_read_may_fail_too() -> None:
    known = case("fast masked")
    left, right = known.read.images
    read = Reading(left, right, known.read.masks)
    sweep = Sweep(read, known.survey)
    read.failing = lambda *_: len(read.asked) == 2
    with pytest.raises(LookupError, match="torn"):
        sweep.advance(300)
    assert len(read.asked) == 2
    swept(sweep, [300], known.whole)


def test_what_progress_raises_leaves_nothing_behind() -> None:
    known = case("robust")
    sweep = Sweep(known.read, known.survey)
    swept(sweep, [40], known.whole)

    def stop(*_: int) -> None:
        raise InterruptedError("enough")

    with pytest.raises(InterruptedError, match="enough"):
        sweep.advance(200, progress=stop)
    calls: list[tuple[int, int]] = []
    done = sweep.done
    found = sweep.advance(200, progress=lambda *rows: calls.append(rows))
    known.check(found, done, 200)
    assert calls
    assert calls[-1][0] == calls[-1][1]


@pytest.mark.parametrize("name", ["robust", "fast"])
@pytest.mark.parametrize(("change", "error", "message"), WRONG_ROWS)
def test_wrong_rows_are_refused(
    name: str, change: Callable[[Any], Any], error: type[Exception], message: str
) -> None:
    known = case(name)
    is_wrong = True

    def read(first: int, last: int) -> Any:
        found = known.read(first, last)
        return change(found) if is_wrong else found

    sweep = Sweep(read, known.survey)
    with pytest.raises(error, match=message):
        sweep.advance(100)
    with pytest.raises(error, match=message):
        match_rows(read, known.survey, 3, 4, overlap=0)
    is_wrong = False
    swept(sweep, [100], known.whole)


def test_rows_of_another_type_than_surveyed_are_refused() -> None:
    known, other = case("fast"), scene(SIZE, "uint16")
    message = "^read: got uint16 for the rows .*, uint8"
    with pytest.raises(TypeError, match=message):
        match_rows(other, known.survey, 20, 30)
    with pytest.raises(TypeError, match=message):
        Sweep(other, known.survey).advance(30)


def test_pixels_that_are_no_numbers_are_refused_where_they_are() -> None:
    read = scene(SIZE, "float32")
    told = surveyed(read, preset="fast")
    whole = read.matched(num_disparities=16, preset="fast")
    read.images[0][200, 7] = np.nan
    sweep = Sweep(read, told)
    swept(sweep, [100], whole)
    with pytest.raises(ValueError, match="^left: got NaN"):
        sweep.advance(250)
    assert sweep.done == 100


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
    with pytest.raises(error, match="^first, last: got"):
        match_rows(known.read, known.survey, *ends, overlap=0)
    sweep = Sweep(known.read, known.survey)
    if ends[0] == 0 and isinstance(ends[0], int):
        with pytest.raises(error, match="^first, last: got"):
            sweep.advance(ends[1])
    assert known.read.asked == []
    sweep.advance(9)
    for last in (0, 9, -3):
        with pytest.raises(ValueError, match="^first, last: got 9"):
            sweep.advance(last)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"survey": "robust"}, TypeError, "^survey: got str"),
        ({"survey": None}, TypeError, "^survey: got NoneType"),
        ({"read": 3}, TypeError, "^read: got int"),
        ({"threads": 0}, ValueError, "^threads: got 0"),
        ({"threads": 1.0}, TypeError, "^threads: got float"),
    ],
    ids=str,
)
def test_wrong_arguments_are_refused(
    options: dict[str, Any], error: type[Exception], message: str
) -> None:
    for name in ("robust", "fast"):
        known = case(name)
        arguments: dict[str, Any] = {"read": known.read, "survey": known.survey} | options
        with pytest.raises(error, match=message):
            match_rows(**arguments, first=0, last=9, overlap=0)
        with pytest.raises(error, match=message):
            Sweep(**arguments)


def test_semi_global_rows_need_an_overlap() -> None:
    known = case("robust")
    with pytest.raises(ValueError, match="^overlap: got None with optimizer='sgm'.*Sweep"):
        match_rows(known.read, known.survey, 0, 9)


@pytest.mark.parametrize("name", ["robust", "fast"])
@pytest.mark.parametrize(
    ("overlap", "error"),
    [(-1, ValueError), (-90, ValueError), (1.5, TypeError), ("all", TypeError)],
)
def test_overlaps_that_are_none_are_refused(
    name: str, overlap: Any, error: type[Exception]
) -> None:
    known = case(name)
    with pytest.raises(error, match="^overlap: got"):
        match_rows(known.read, known.survey, 100, 120, overlap=overlap)


def test_a_progress_that_cannot_be_called_is_refused() -> None:
    known = case("fast")
    known.read.asked.clear()
    with pytest.raises(TypeError, match="^progress: got int"):
        Sweep(known.read, known.survey).advance(9, progress=3)  # type: ignore[arg-type] # the point
    assert known.read.asked == []


def test_a_halo_is_of_settings() -> None:
    with pytest.raises(TypeError, match="^settings: got str"):
        halo("robust")  # type: ignore[arg-type] # that is the point
    with pytest.raises(TypeError, match="^equalisation: got int"):
        halo(ps.Settings(), 3)  # type: ignore[arg-type] # that is the point


def begun(name: str, done: int = 50) -> dict[str, Any]:
    """Return the state of a sweep."""
    sweep = Sweep(case(name).read, case(name).survey)
    sweep.advance(done)
    return sweep.state()


def without(state: dict[str, Any], name: str) -> dict[str, Any]:
    """Return a state that lacks something."""
    return {key: value for key, value in state.items() if key != name}


@pytest.mark.parametrize("name", ["robust", "fast"])
def test_states_that_none_can_be_are_refused(name: str) -> None:
    known, state = case(name), begun(name)
    done, top, chosen = (int(state[key]) for key in ("done", "top", "chosen"))
    rows = {key: plane for key, plane in state.items() if np.ndim(plane) == 2}
    wrong: list[dict[str, Any]] = [
        {}, {"done": 3}, {"other": np.zeros(3)}, state | {"done": np.array("many")},
        state | {"done": np.arange(3)}, state | {"done": done + 40}, state | {"done": -1},
        state | {"done": 301}, state | {"top": top + 1}, state | {"top": -1},
        state | {"chosen": chosen + 1}, state | {"chosen": chosen + 32}, state | {"chosen": 0},
        state | {"chosen": top}, state | {"chosen": 10**9}, state | {"top": 10**30},
        *(without(state, key) for key in state),
        *(state | {key: plane[1:]} for key, plane in rows.items()),
        *(state | {key: plane[:, 1:]} for key, plane in rows.items()),
        *(state | {key: plane[..., None]} for key, plane in rows.items()),
        *(state | {key: plane.astype(np.float64)} for key, plane in rows.items()),
        *(state | {key: plane.astype(plane.dtype.newbyteorder())} for key, plane in rows.items()),
        *(state | {key: None} for key in rows), *(state | {key: "no array"} for key in rows),
    ]  # fmt: skip
    if name == "robust":
        paths = state["paths"]
        wrong += [state | {"paths": paths.astype(np.uint16)}, state | {"paths": paths[None]}]
    else:
        wrong += [state | {"paths": np.zeros(9, np.uint8)}]
    for bad in wrong:
        with pytest.raises(ValueError, match="^state: got"):
            Sweep(known.read, known.survey, state=bad)
    kinds: list[Any] = [3, "state.npz", [1, 2]]
    for kind in kinds:
        with pytest.raises(TypeError, match="^state: got"):
            Sweep(known.read, known.survey, state=kind)


def test_states_of_other_surveys_are_refused() -> None:
    names = ["robust", "paper", "fast", "sad"]
    for name in names:
        for other in names:
            if name != other:
                with pytest.raises(ValueError, match="^state: got"):
                    Sweep(case(other).read, case(other).survey, state=begun(name))
    read = scene((300, 120))
    with pytest.raises(ValueError, match="^state: got"):
        Sweep(read, surveyed(read, preset="fast"), state=begun("fast"))


def test_paths_of_other_disparities_are_refused() -> None:
    known, state = case("robust"), begun("robust")
    fewer = surveyed(known.read, num_disparities=15)
    paths = state["paths"]
    for survey, bad in [
        (fewer, paths), (known.survey, paths[:-1]), (known.survey, paths[:0]),
        (known.survey, np.append(paths, paths[:1])),
        (known.survey, np.append(np.uint8(0), paths[1:])),
        (known.survey, np.append(np.uint8(9), paths[1:])),
    ]:  # fmt: skip
        sweep = Sweep(known.read, survey, state=state | {"paths": bad})
        with pytest.raises(ValueError, match="^paths: got"):
            sweep.advance(300)
        assert sweep.done == 50


@given(seed=st.integers(0, 2**32), share=st.floats(0, 1))
@hypothesis_settings(max_examples=20)
def test_paths_of_any_bytes_do_no_harm(seed: int, share: float) -> None:
    known, state = case("robust"), begun("robust")
    rng = np.random.default_rng(seed)
    noise = rng.integers(0, 256, state["paths"].shape, np.uint8)
    chosen = rng.random(noise.shape) < share
    chosen[0] = False
    paths = np.where(chosen, noise, state["paths"])
    sweep = Sweep(known.read, known.survey, state=state | {"paths": paths})
    assert sweep.advance(300).disparity.shape == (250, SIZE[1])


# Threads and processes


def test_several_threads_may_match_bands_at_the_same_time() -> None:
    wrong: list[BaseException] = []

    def work(turn: int) -> None:
        try:
            name = list(CASES)[turn % len(CASES)]
            known = case(name)
            sweep = Sweep(known.read, known.survey, threads=1 + turn % 2)
            swept(sweep, [100, known.read.size[0]], known.whole)
            if not known.is_sgm:
                known.check(match_rows(known.read, known.survey, 90, 150), 90, 150)
        except BaseException as error:  # noqa: BLE001 - it is looked at
            wrong.append(error)

    for name in CASES:
        case(name)
    threads = [threading.Thread(target=work, args=[turn]) for turn in range(2 * len(CASES))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_a_sweep_goes_on_in_a_forked_child() -> None:
    finished = run_forking("""
pair = np.random.default_rng(0).integers(0, 256, (2, 200, 90), np.uint8)
read = lambda first, last: (pair[0][first:last], pair[1][first:last], None, None)
told = ps.survey(read, (200, 90), num_disparities=8)
expected = ps.match(*pair, num_disparities=8).disparity[60:]
sweep = ps.Sweep(read, told, threads=3)
sweep.advance(60)
def same():
    return np.array_equal(sweep.advance(200).disparity, expected, equal_nan=True)
""")
    assert finished.returncode == 0, finished.stderr


def test_bands_come_from_one_set_of_workers() -> None:
    known = case("fast")
    workers = _core.Workers(2)
    for first in (0, 100, 200):
        found = match_rows(known.read, known.survey, first, first + 50, threads=workers)
        known.check(found, first, first + 50)


def test_the_module_tells_what_the_package_does() -> None:
    assert (ps.Sweep, ps.match_rows, ps.halo) == (banding.Sweep, banding.match_rows, banding.halo)

"""Methods by name: what a name means, what is refused, and how a user adds one."""

import sys
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import phasestereo as ps
from phasestereo.matchers import opencv
from phasestereo_bench import available, method
from phasestereo_bench.demo import SGBM
from phasestereo_bench.methods import BASELINES
from phasestereo_bench.rendering import render_pair

RNG = np.random.default_rng(0)
SHIFT, COUNT = 5, 16
TEXTURE = RNG.integers(0, 256, (40, 80 + SHIFT, 3), dtype=np.uint8)
LEFT, RIGHT = TEXTURE[:, :-SHIFT].copy(), TEXTURE[:, SHIFT:].copy()
OPENCV = ("opencv:bm", "opencv:sgbm", "opencv:sgbm-3x3", "opencv:sgbm-3way")


def own(left: NDArray[np.uint8], right: NDArray[np.uint8], num_disparities: int) -> Any:
    """Match nothing: be a method of a user's."""
    return np.full(np.broadcast(left, right).shape[:2], num_disparities / 2, np.float32)


def found(spec: str, left: Any = LEFT, right: Any = RIGHT) -> NDArray[Any]:
    """Return the disparities that a method finds."""
    answer = method(spec).match(left, right, COUNT)
    return answer[0] if isinstance(answer, tuple) else answer


NOT_CALLABLE = 3


class Matcher:
    def __call__(self, left: Any, right: Any, num_disparities: int) -> Any:
        return own(left, right, num_disparities)


# Ours


@pytest.mark.parametrize(
    ("spec", "fields"),
    [
        ("paper", {}),
        ("paper:neighborhood=11,window=9", {"neighborhood": 11, "window": 9}),
        ("paper:frequencies=1,1,bits=1", {"frequencies": (1, 1), "bits": 1}),
        ("paper: shiftable = False , taper=hann", {"shiftable": False, "taper": "hann"}),
        ("paper:p1=0.5", {"p1": 0.5}),
        ("paper:p1=0.5,p2=4,optimizer=dp", {"p1": 0.5, "p2": 4}),
        ("paper:intensity_range=none", {"intensity_range": None}),
        ("sad", {"cost": "sad", "p1": BASELINES["sad"].p1, "p2": BASELINES["sad"].p2}),
        ("nsad:window=5,p1=1,p2=1", {"cost": "nsad", "window": 5, "p1": 1, "p2": 1}),
    ],
)
def test_settings_by_name(spec: str, fields: dict[str, Any]) -> None:
    expected = replace(ps.Settings.preset("paper"), **fields)
    chosen = method(spec)
    assert (chosen.name, chosen.true_blur, str(chosen)) == (spec, False, spec)
    assert chosen.settings == asdict(expected)
    direct = ps.match(LEFT, RIGHT, num_disparities=COUNT, settings=expected).disparity
    np.testing.assert_array_equal(found(spec), direct)


@pytest.mark.parametrize(
    ("spec", "error", "message"),
    [
        ("prepared:", ValueError, "got 'prepared:'; accepts prepared:METHOD"),
        ("fused:", ValueError, "got 'fused:'; accepts fused:METHOD"),
        ("prepared:papre", ValueError, "got 'papre'; accepts"),
        ("papre", ValueError, "got 'papre'; accepts robust, paper, fast, sad, nsad"),
        ("opencv:bgm", ValueError, "got 'opencv:bgm'; accepts"),
        ("+true-blur", ValueError, "got ''"),
        ("paper:windows=3", TypeError, "got 'paper:windows=3': windows: no such setting"),
        ("paper:window=4", ValueError, "got 'paper:window=4': window: got 4"),
        ("paper:11", ValueError, "got 'paper:11'"),
        ("paper:window=wide", TypeError, "got 'paper:window=wide': window: "),
        ("nowhere:match", ValueError, "got 'nowhere:match', which cannot be imported"),
        ("test_bench_methods:nothing", ValueError, "which cannot be imported"),
        ("test_bench_methods:NOT_CALLABLE", TypeError, "is not a function but int"),
        (3, TypeError, "got int; accepts a name, a function or a Method"),
        (partial(own), TypeError, "got partial, which has no name"),
        (Matcher(), TypeError, "got Matcher, which has no name"),
    ],
)
def test_refusals(spec: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match="^method: ") as raised:
        method(spec)
    assert message in str(raised.value)


# OpenCV's


@pytest.mark.parametrize("name", OPENCV)
@pytest.mark.parametrize("channels", [1, 3])
def test_opencv_matches_every_pixel_it_can(name: str, channels: int) -> None:
    pytest.importorskip("cv2")
    pair = (LEFT, RIGHT) if channels == 3 else (LEFT[:, :, 0].copy(), RIGHT[:, :, 0].copy())
    disparity = found(name, *pair)
    assert disparity.dtype == np.float32
    assert disparity.shape == LEFT.shape[:2]
    assert np.abs(disparity[:, SHIFT:-8] - SHIFT).max() <= 0.5, "edges on three sides included"
    assert method(name).settings


def test_opencv_searches_at_least_so_many_disparities() -> None:
    pytest.importorskip("cv2")
    wide = RNG.integers(0, 256, (40, 120, 3), dtype=np.uint8)
    for match in (opencv.match_bm, opencv.match_sgbm, partial(opencv.match_sgbm, mode="SGBM")):
        disparity = match(wide[:, :-19].copy(), wide[:, 19:].copy(), 20)
        assert np.nanmedian(disparity[:, 20:]) == pytest.approx(19, abs=0.5)


def test_a_method_gets_a_prepared_pair_and_its_map_comes_back() -> None:
    pytest.importorskip("cv2")
    rendered = render_pair(3, height=160, width=240, num_disparities=64)
    entrant, raw, fused = map(method, ("prepared:sgbm", "opencv:sgbm", "fused:sgbm"))
    assert (entrant.name, entrant.settings, entrant.told) == (
        "prepared:opencv:sgbm",
        raw.settings,
        False,
    )
    truth: Any = rendered.truth
    pair: tuple[Any, ...] = rendered.left, 255 - rendered.right, 64
    found: list[Any] = [each.match(*pair) for each in (raw, entrant)]
    mask = rendered.masks["nonocc"]
    wrong = [ps.metrics.bad_pixels(disparity, truth, 1.0, mask) for disparity in found]
    assert wrong[0] > 90
    assert wrong[1] < 20

    ours = ps.match(*pair[:2], threads=1).disparity
    both, confidence = fused.match(*pair)
    assert (fused.name, confidence.shape) == ("fused:opencv:sgbm", both.shape)
    assert not np.array_equal(both, ours)
    assert ps.metrics.bad_pixels(both, truth, 1.0, mask) < 20


def test_the_demo_has_the_same_sgbm() -> None:
    pytest.importorskip("cv2")
    ours = method("opencv:sgbm").match(LEFT, RIGHT, COUNT)
    np.testing.assert_array_equal(SGBM.match(LEFT, RIGHT, COUNT), ours)


def test_missing_opencv_is_named_with_its_cure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    monkeypatch.setattr("phasestereo._extras.import_module", _without_opencv)
    assert not set(OPENCV) & set(available())
    with pytest.raises(ImportError, match=r"pip install 'phasestereo\[opencv\]'"):
        method("opencv:sgbm")


def _without_opencv(name: str) -> Any:
    if name == "cv2":
        raise ModuleNotFoundError(name="cv2")
    return __import__(name)


# A user's


def test_a_function_is_a_method() -> None:
    chosen = method(own)
    assert (chosen.name, chosen.match) == ("test_bench_methods:own", own)
    assert method("test_bench_methods:own") == chosen

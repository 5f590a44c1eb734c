"""What a caller knows of a pair: checked in one place, and of use wherever a pair is matched."""

from __future__ import annotations

import pickle
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo_bench.degradation import Degradation, disk_psf
from phasestereo_bench.rendering import render_pair
from phasestereo_large import pair_statistics

if TYPE_CHECKING:
    from numpy.typing import NDArray

COMPENSATION = ps.BlurCompensation(noise=(1.0, 2.0))
BOTH = {"noise": 1.0, "blur_compensation": COMPENSATION}
GRAY = np.zeros((8, 9), np.uint8)


@cache
def soft(seed: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return a pair whose left image is out of focus, with noise of this seed."""
    pair = render_pair(0, height=240, width=320, num_disparities=32)
    return Degradation(disk_psf(3.0), noise=1, seed=seed)(pair.left), pair.right


@pytest.fixture(scope="module")
def first() -> ps.Result:
    return ps.match(*soft(0))


@pytest.mark.parametrize(
    ("error", "message", "fields"),
    [
        (TypeError, "known.noise: got str; accepts a number", {"noise": "1"}),
        (TypeError, "known.noise: got tuple; accepts", {"noise": (1.0, 2.0, 3.0)}),
        (ValueError, "known.noise: got -1; accepts", {"noise": -1}),
        (ValueError, "known.noise: got NaN; accepts", {"noise": (1.0, float("nan"))}),
        (TypeError, "known.blur_compensation: got dict; accepts", {"blur_compensation": {}}),
        (TypeError, "known.before: got int; accepts Result or None", {"before": 3}),
        (ValueError, "known.noise: got 1.0 beside known.blur_compensation", BOTH),
    ],
)
def test_what_cannot_be_known_is_refused_by_name(
    error: type[Exception], message: str, fields: dict[str, Any]
) -> None:
    with pytest.raises(error, match=f"^{message}"):
        ps.Known(**fields)


def test_calls_refuse_what_is_of_no_use_to_them(first: ps.Result) -> None:
    with pytest.raises(TypeError, match="^known: got float; accepts Known or None"):
        ps.match(GRAY, GRAY, num_disparities=2, known=2.0)  # type: ignore[arg-type]  # the point

    known = ps.Known(before=first)
    for call in (
        lambda: ps.verify(GRAY, GRAY, GRAY, known=known),
        lambda: ps.cost_volume(GRAY, GRAY, num_disparities=2, known=known),
        lambda: pair_statistics(lambda *_: (GRAY, GRAY, None, None), GRAY.shape, known=known),
    ):
        with pytest.raises(ValueError, match="^known.before: got .*; accepts None here"):
            call()


def test_an_earlier_result_is_taken_over_after_a_pickle(first: ps.Result) -> None:
    known = pickle.loads(pickle.dumps(ps.Known(before=first)))  # noqa: S301 -- our own

    second = ps.match(*soft(1), known=known)
    assert second.blur is not None
    assert first.blur is not None
    assert second.blur.reused
    assert second.blur.blurs[0].size == first.blur.blurs[0].size
    assert second.search == first.search
    assert "estimation" not in second.timings

    narrow = ps.match(*soft(1), num_disparities=50, known=known)
    assert narrow.blur is not None
    assert narrow.blur.reused
    assert narrow.search is not None
    assert (narrow.search.origin, narrow.search.num_disparities) == ("given", 50)


def test_of_another_size_or_other_settings_nothing_is_taken_over(first: ps.Result) -> None:
    left, right = soft(0)
    for columns, preset in ((slice(200), "robust"), (slice(None), "fast")):
        images = left[:, columns], right[:, columns]
        found = ps.match(*images, preset=preset, known=ps.Known(before=first))
        alone = ps.match(*images, preset=preset)
        np.testing.assert_array_equal(found.disparity, alone.disparity)
        assert found.blur is None or not found.blur.reused


def test_verification_goes_by_what_is_known() -> None:
    known = ps.Known(blur_compensation=COMPENSATION)
    judged = ps.verify(*soft(0), np.full((240, 320), 20), known=known)
    assert judged.result.blur is None
    assert judged.result.blur_compensation is COMPENSATION

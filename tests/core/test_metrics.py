"""Metrics: against numbers worked out by hand, and against a loop over pixels."""

import json
import math
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as npst

from phasestereo import metrics
from phasestereo_bench.datasets import Pair

Disparities = npt.NDArray[np.float32]
Measure = Callable[..., Any]

NAN, INF = math.nan, math.inf


def row(*values: float) -> Disparities:
    return np.array([values], dtype=np.float32)


def where(*values: int) -> npt.NDArray[np.bool_]:
    return np.array([values], dtype=bool)


TRUTH = row(10, 10, 10, 10, 10, 10, 10, 10, NAN, INF)
ESTIMATE = row(10, 10.25, 11, 9, 12, 15, NAN, INF, 50, 50)
# errors of the eight known: 0, 0.25, 1, 1, 2, 5, missing, missing


@pytest.mark.parametrize(
    ("threshold", "bad"), [(0, 7), (0.25, 6), (0.5, 6), (1, 4), (1.99, 4), (2, 3), (5, 2), (99, 2)]
)
def test_bad_pixels_are_those_off_by_more_than_the_threshold_or_missing(
    threshold: float, bad: int
) -> None:
    assert metrics.bad_pixels(ESTIMATE, TRUTH, threshold) == 100 * bad / 8


def test_middlebury_v2_scores_each_region_there_is() -> None:
    masks = {"nonocc": where(1, 1, 1, 1, 1, 1, 0, 0, 0, 0), "disc": where(*[0] * 4, *[1] * 6)}
    record = metrics.middlebury_v2(ESTIMATE, (TRUTH, masks))
    assert record.nonocc == pytest.approx(200 / 6)
    assert asdict(record) == {"nonocc": record.nonocc, "all": None, "disc": 100, "threshold": 1}
    wider = metrics.middlebury_v2(ESTIMATE, (TRUTH, {"all": masks["nonocc"]}), threshold=2)
    assert wider.all == pytest.approx(100 / 6)
    assert (wider.nonocc, wider.disc, wider.threshold) == (None, None, 2.0)


def test_scores_by_hand() -> None:
    record = metrics.score(ESTIMATE, TRUTH, num_disparities=16)

    errors = [0, 0.25, 1, 1, 2, 5]
    assert record.pixels == 8
    assert (record.bad_0_5, record.bad_1, record.bad_2, record.bad_4) == (75.0, 50.0, 37.5, 37.5)

    assert record.invalid == 25.0
    assert record.avgerr == pytest.approx(9.25 / 6)
    assert record.rms == pytest.approx(math.sqrt((0.0625 + 1 + 1 + 4 + 25) / 6))

    assert record.a50 == pytest.approx(1.0)
    assert record.a90 == pytest.approx(2 + 0.5 * 3)  # halfway between the fifth and the sixth
    assert record.a95 == pytest.approx(np.percentile(errors, 95))
    assert record.a99 == pytest.approx(5 - 0.05 * 3)


@pytest.mark.parametrize(
    ("estimate", "truth", "error"),
    [(90, 15, 1), (90, 16, 0), (-7, 1, 1), (16, 14, 2), (16.5, 16, 0)],
)
def test_estimates_are_clipped_to_the_range_of_disparities(
    estimate: float, truth: float, error: float
) -> None:
    both = metrics.score(row(estimate), row(truth), num_disparities=16)
    assert (both.avgerr, both.epe) == (error, abs(estimate - truth))


@pytest.mark.parametrize(
    ("truth", "estimate", "outlier"),
    [
        (10, 13, False),  # 30 %, but not more than 3 px
        (10, 13.25, True),
        (80, 84, False),  # not more than 5 %
        (80, 84.25, True),
        (80, 75.75, True),
        (0, 3, False),
        (0, 3.25, True),
        (80, NAN, True),
    ],
)
def test_an_outlier_of_kitti_is_off_by_3_px_and_5_percent(
    truth: float, estimate: float, *, outlier: bool
) -> None:
    estimates, truths = row(estimate, 20), row(truth, 20)
    assert metrics.score(estimates, truths).d1 == 50.0 * outlier


def test_without_a_single_estimate_all_is_bad_and_no_error_is_made_up() -> None:
    score = metrics.score(row(NAN, NAN), row(1, 2), num_disparities=4)
    assert (score.bad_4, score.invalid, score.d1) == (100.0, 100.0, 100.0)
    assert all(math.isnan(e) for e in (score.avgerr, score.rms, score.a50, score.a99, score.epe))


def test_a_score_is_printed_by_the_names_of_the_field() -> None:
    numbers = metrics.score(ESTIMATE, TRUTH).as_dict()
    assert list(numbers) == (
        [
            "pixels",
            "bad-0.5",
            "bad-1.0",
            "bad-2.0",
            "bad-4.0",
            "invalid",
            "avgerr",
            "rms",
            "A50",
            "A90",
            "A95",
            "A99",
            "D1",
            "EPE",
        ]
    )
    assert json.loads(json.dumps(numbers)) == numbers


def test_sums_do_not_lose_small_errors_in_large_maps() -> None:
    truth = np.full((1500, 1500), 64, np.float32)
    estimate = truth + np.float32(0.125)
    estimate[0, 0] = 3e7
    expected = (0.125 * (truth.size - 1) + (3e7 - 64)) / truth.size
    assert metrics.end_point_error(estimate, truth) == pytest.approx(expected, rel=1e-12)


def test_subpixel_is_about_the_estimates_that_are_right() -> None:
    record = metrics.subpixel(ESTIMATE, TRUTH)  # errors 0, 0.25, 1, -1 of eight
    assert record.inliers == 50.0
    assert record.rms == pytest.approx(math.sqrt((0.0625 + 1 + 1) / 4))
    assert record.bias == pytest.approx(0.25 / 4)
    assert record.inlier == 1.0

    wide = metrics.subpixel(ESTIMATE, TRUTH, where(*[0] * 4, *[1] * 6), inlier=5)
    assert (wide.inliers, wide.bias, wide.rms) == (50.0, 3.5, math.sqrt((4 + 25) / 2))


@pytest.mark.parametrize(
    ("estimates", "locking"),
    [
        ((5.0, 5.25, 5.5, 5.75), 0.0),
        ((5.1, 5.26, 5.5, 5.99), 0.0),  # within their bins
        ((5.0, 5.25, 5.5, 6.0), 100.0),  # two are whole, where one should be
        ((5.0, 5.0, 6.0, 6.0), 300.0),
        ((5.3, 5.3, 5.3, 5.8), 200.0),
        ((-1e-9, 0.25, 0.5, 0.75), 100.0),
    ],
)
def test_locking_is_what_a_bin_of_fractions_holds_too_much(
    estimates: tuple[float, ...], locking: float
) -> None:
    truth = np.array([[5.0, 5.25, 5.5, 5.75]]) - 5 * (estimates[0] < 1)
    estimate = np.array([estimates])
    assert metrics.subpixel(estimate, truth, bins=4).locking == pytest.approx(locking)


def test_locking_is_counted_against_the_fractions_of_the_truth() -> None:
    truth = row(3, 3, 3, 3.5)
    assert metrics.subpixel(truth, truth).locking == 0.0
    assert metrics.subpixel(truth + np.float32(0.5), truth, bins=2).locking == 100.0
    assert metrics.subpixel(row(3, 3, 3, 40), truth).locking == 0.0, "only inliers count"


@pytest.mark.parametrize("value", [-1e-20, -0.0, 1 - 1e-16, 4.0])
def test_fractions_that_rounding_makes_whole_have_a_bin(value: float) -> None:
    estimate = np.array([[value]])
    assert metrics.subpixel(estimate, estimate, bins=7).locking == 0.0


def test_where_nothing_is_right_nothing_is_said_about_it() -> None:
    record = metrics.subpixel(row(9, NAN), row(1, 2))
    assert record.inliers == 0.0
    assert all(math.isnan(number) for number in (record.rms, record.bias, record.locking))


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"inlier": -1}, ValueError, "^inlier: got -1; accepts a finite number, 0 or more"),
        ({"inlier": "1"}, TypeError, "^inlier: got str; accepts a number"),
        ({"bins": 1}, ValueError, "bins: got 1; accepts 2 or more"),
        ({"bins": 10.0}, TypeError, "bins: got float; accepts an integer"),
    ],
)
def test_subpixel_refuses_what_makes_no_sense(
    options: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        metrics.subpixel(FLAT, FLAT, **options)


maps = npst.arrays(
    np.float32,
    (4, 5),
    elements=st.one_of(st.integers(0, 24).map(lambda n: n / 4), st.sampled_from([NAN, INF])),
)


@given(
    estimate=maps, truth=maps, mask=npst.arrays(np.bool_, (4, 5)), num_disparities=st.integers(1, 6)
)
def test_a_loop_over_pixels_counts_the_same(
    estimate: Disparities, truth: Disparities, mask: npt.NDArray[np.bool_], num_disparities: int
) -> None:
    errors, missing = [], 0
    for d, gt, scored in zip(estimate.flat, truth.flat, mask.flat, strict=True):
        if scored and math.isfinite(gt):
            missing += not math.isfinite(d)
            if math.isfinite(d):
                errors.append(abs(min(max(float(d), 0.0), num_disparities) - float(gt)))

    total = len(errors) + missing
    if not total:
        with pytest.raises(ValueError, match="nothing is left to score"):
            metrics.score(estimate, truth, mask=mask)
        return

    score = metrics.score(estimate, truth, mask=mask, num_disparities=num_disparities)
    assert score.pixels == total
    assert score.bad_1 == pytest.approx(100 * (sum(e > 1 for e in errors) + missing) / total)
    assert score.invalid == pytest.approx(100 * missing / total)

    expected = math.fsum(errors) / len(errors) if errors else NAN
    assert score.avgerr == pytest.approx(expected, nan_ok=True)


ALL: list[tuple[str, Measure]] = [
    ("bad_pixels", lambda d, gt, m: metrics.bad_pixels(d, gt, 1, m)),
    ("middlebury_v2", lambda d, gt, m: metrics.middlebury_v2(d, (gt, {"all": m}))),
    ("end_point_error", metrics.end_point_error),
    ("score", lambda d, gt, m: metrics.score(d, gt, mask=m)),
    ("subpixel", metrics.subpixel),
]
FLAT = np.ones((2, 3), np.float32)
IN = np.ones((2, 3), np.bool_)


@pytest.mark.parametrize("measure", [call for _, call in ALL], ids=[name for name, _ in ALL])
@pytest.mark.parametrize(
    ("inputs", "error", "message"),
    [
        ((FLAT.astype(np.int16), FLAT, IN), TypeError, "estimate: got dtype int16; accepts floats"),
        ((FLAT, FLAT.astype(np.uint8), IN), TypeError, "truth: got dtype uint8; accepts floats"),
        ((None, FLAT, IN), TypeError, "estimate: got NoneType; accepts an array"),
        ((FLAT, FLAT, IN.astype(np.uint8) * 255), TypeError, "mask: got dtype uint8; accepts bool"),
        ((FLAT[0], FLAT[0], IN[0]), ValueError, r"estimate: got shape \(3,\); accepts \(H, W\)"),
        ((FLAT, FLAT.T, IN), ValueError, r"truth: got shape \(3, 2\); accepts \(2, 3\)"),
        ((FLAT, FLAT[:1], IN), ValueError, r"truth: got shape \(1, 3\); accepts \(2, 3\)"),
        ((FLAT, FLAT, IN[:, :1]), ValueError, r"mask: got shape \(2, 1\); accepts \(2, 3\)"),
        ((FLAT, FLAT, ~IN), ValueError, "nothing is left to score"),
        ((FLAT, FLAT * NAN, IN), ValueError, "nothing is left to score"),
        ((FLAT[:0], FLAT[:0], IN[:0]), ValueError, "estimate: got shape"),
    ],
)
def test_what_cannot_be_scored_is_refused(
    measure: Measure, inputs: tuple[Any, Any, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        measure(*inputs)


@pytest.mark.parametrize(
    ("threshold", "error"),
    [(-1, ValueError), (NAN, ValueError), (INF, ValueError), ("1", TypeError), (True, TypeError)],
)
def test_a_threshold_is_a_number_of_pixels(threshold: Any, error: type[Exception]) -> None:
    with pytest.raises(error, match="^threshold: got"):
        metrics.bad_pixels(FLAT, FLAT, threshold)


@pytest.mark.parametrize(
    ("count", "error"), [(0, ValueError), (-16, ValueError), (16.0, TypeError), (True, TypeError)]
)
def test_num_disparities_is_a_positive_integer(count: Any, error: type[Exception]) -> None:
    with pytest.raises(error, match="^num_disparities: got"):
        metrics.score(FLAT, FLAT, num_disparities=count)


def test_middlebury_v2_needs_a_truth_and_a_known_region() -> None:
    with pytest.raises(ValueError, match="masks must hold nonocc, all or disc, got none"):
        metrics.middlebury_v2(FLAT, (FLAT, {}))
    with pytest.raises(ValueError, match=r"masks must hold .* got \['occ'\]"):
        metrics.middlebury_v2(FLAT, (FLAT, {"occ": IN}))

    image = np.zeros((2, 3), np.uint8)
    pair = Pair("no truth", image, image, None, None, {}, 16, None)
    with pytest.raises(ValueError, match="pair has no truth"):
        metrics.middlebury_v2(FLAT, pair)

"""ROC areas: against counts of all pairs of pixels, and against small cases worked out by hand."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra import numpy as npst
from test_metrics import row

from phasestereo import metrics
from phasestereo.metrics import roc_area, sparsification

Map = npt.NDArray[np.float32]

NAN, INF = math.nan, math.inf


TRUTH = row(10, 10, 10, 10, 10, 10)
ESTIMATE = row(10, 11, 12, 10, NAN, INF)  # right, right, wrong, right, missing, missing


@pytest.mark.parametrize(
    ("confidence", "area"),
    [
        ((6, 5, 1, 4, 2, 3), 1.0),
        ((1, 2, 6, 3, 5, 4), 0.0),
        ((1, 1, 1, 1, 1, 1), 0.5),
        ((3, 3, 3, 1, 1, 1), (2 * (0.5 + 1 + 1) + 0 + 0.5 + 0.5) / 9),
        ((INF, 5, -INF, 4, 4, 0), 8.5 / 9),
    ],
)
def test_the_area_is_the_share_of_pairs_in_the_right_order(
    confidence: tuple[float, ...], area: float
) -> None:
    assert roc_area(row(*confidence), ESTIMATE, TRUTH) == pytest.approx(area, rel=1e-15)


def test_the_threshold_says_what_is_wrong() -> None:
    confidence = row(3, 1, 2, 3, 0, 0)
    assert roc_area(confidence, ESTIMATE, TRUTH, threshold=0.5) == 1.0
    assert roc_area(confidence, ESTIMATE, TRUTH) == 8 / 9
    assert roc_area(confidence, ESTIMATE, TRUTH, threshold=2) == 1.0


@pytest.mark.parametrize("estimate", [TRUTH, TRUTH + 9])
def test_without_a_right_and_a_wrong_pixel_there_is_nothing_to_tell_apart(estimate: Map) -> None:
    assert math.isnan(roc_area(TRUTH, estimate, TRUTH))
    curve = sparsification(TRUTH, estimate, TRUTH)
    share = metrics.bad_pixels(estimate, TRUTH, 1)
    assert (curve.area, curve.least) == (share, share)


def test_sparsification_by_hand() -> None:
    curve = sparsification(row(9, 8, 8, 7, 7, 7), ESTIMATE, TRUTH)
    np.testing.assert_allclose(curve.density, [1 / 6, 3 / 6, 1])
    np.testing.assert_allclose(curve.bad, [0, 100 / 3, 50])
    wrong = [0, 0.5, 1, 1 + 2 / 3, 1 + 4 / 3, 3]
    assert curve.area == pytest.approx(100 * np.mean([w / n for n, w in enumerate(wrong, 1)]))
    assert curve.least == pytest.approx(100 * (1 / 4 + 2 / 5 + 3 / 6) / 6)


confidences = npst.arrays(np.float32, (4, 5), elements=st.integers(0, 6).map(float))
flags = npst.arrays(np.bool_, (4, 5))


@given(confidence=confidences, wrong=flags, mask=flags)
def test_a_count_of_all_pairs_is_the_same(
    confidence: Map, wrong: npt.NDArray[np.bool_], mask: npt.NDArray[np.bool_]
) -> None:
    truth = np.full((4, 5), 8, np.float32)
    estimate = np.where(wrong, np.float32(3), truth)

    if not mask.any():
        with pytest.raises(ValueError, match="nothing is left to score"):
            roc_area(confidence, estimate, truth, mask=mask)
        return

    rights, wrongs = confidence[mask & ~wrong], confidence[mask & wrong]
    ordered = sum(float(r > w) + 0.5 * float(r == w) for r in rights for w in wrongs)
    pairs = len(rights) * len(wrongs)
    expected = ordered / pairs if pairs else NAN

    area = roc_area(confidence, estimate, truth, mask=mask)
    assert area == pytest.approx(expected, rel=1e-15, nan_ok=True)


@given(confidence=confidences, wrong=flags)
def test_a_better_order_has_the_smaller_area_of_sparsification(
    confidence: Map, wrong: npt.NDArray[np.bool_]
) -> None:
    truth = np.full((4, 5), 8, np.float32)
    estimate = np.where(wrong, np.float32(3), truth)

    curve = sparsification(confidence, estimate, truth)
    assert curve.bad[-1] == pytest.approx(metrics.bad_pixels(estimate, truth, 1))
    assert curve.density[-1] == 1.0
    assert np.all(np.diff(curve.density) > 0)
    assert curve.least <= curve.area + 1e-9

    best = sparsification((~wrong).astype(np.float32), estimate, truth)
    assert best.area == pytest.approx(best.least)


FLAT = np.ones((2, 3), np.float32)
IN = np.ones((2, 3), np.bool_)


@pytest.mark.parametrize("measure", [roc_area, sparsification])
@pytest.mark.parametrize(
    ("inputs", "options", "error", "message"),
    [
        ((FLAT > 0, FLAT, FLAT), {}, TypeError, "confidence: got dtype bool"),
        ((None, FLAT, FLAT), {}, TypeError, "confidence: got NoneType"),
        ((FLAT, FLAT.astype(np.int16), FLAT), {}, TypeError, "estimate: got dtype int16"),
        ((FLAT[:, :1], FLAT, FLAT), {}, ValueError, r"confidence: got shape \(2, 1\)"),
        ((FLAT, FLAT, FLAT[:1]), {}, ValueError, r"truth: got shape \(1, 3\)"),
        ((FLAT * NAN, FLAT, FLAT), {}, ValueError, "confidence must be known .* NaN at 6"),
        ((FLAT, FLAT, FLAT), {"mask": ~IN}, ValueError, "nothing is left to score"),
        ((FLAT, FLAT, FLAT), {"mask": FLAT}, TypeError, "mask: got dtype float32"),
        ((FLAT, FLAT, FLAT), {"threshold": -1}, ValueError, "^threshold: got"),
        ((FLAT, FLAT, FLAT), {"threshold": "1"}, TypeError, "^threshold: got"),
    ],
)
def test_what_cannot_be_judged_is_refused(
    measure: Callable[..., Any],
    inputs: tuple[Any, Any, Any],
    options: dict[str, Any],
    error: type[Exception],
    message: str,
) -> None:
    with pytest.raises(error, match=message):
        measure(*inputs, **options)

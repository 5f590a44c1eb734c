"""What a caller knows of a pair: checked in one place, and of use wherever a pair is matched."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import phasestereo as ps
from phasestereo_bench.rendering import render_pair

COMPENSATION = ps.BlurCompensation(noise=(1.0, 2.0))
BOTH = {"noise": 1.0, "blur_compensation": COMPENSATION}
GRAY = np.zeros((8, 9), np.uint8)


@pytest.mark.parametrize(
    ("error", "message", "fields"),
    [
        (TypeError, "known.noise: got str; accepts a number", {"noise": "1"}),
        (TypeError, "known.noise: got tuple; accepts", {"noise": (1.0, 2.0, 3.0)}),
        (ValueError, "known.noise: got -1; accepts", {"noise": -1}),
        (ValueError, "known.noise: got NaN; accepts", {"noise": (1.0, float("nan"))}),
        (TypeError, "known.blur_compensation: got dict; accepts", {"blur_compensation": {}}),
        (ValueError, "known.noise: got 1.0 beside known.blur_compensation", BOTH),
    ],
)
def test_what_cannot_be_known_is_refused_by_name(
    error: type[Exception], message: str, fields: dict[str, Any]
) -> None:
    with pytest.raises(error, match=f"^{message}"):
        ps.Known(**fields)


def test_another_type_is_refused() -> None:
    with pytest.raises(TypeError, match="^known: got float; accepts Known or None"):
        ps.match(GRAY, GRAY, num_disparities=2, known=2.0)  # type: ignore[arg-type]  # the point


def test_verification_goes_by_what_is_known() -> None:
    known = ps.Known(blur_compensation=COMPENSATION)
    pair = render_pair(0, height=240, width=320, num_disparities=32)
    judged = ps.verify(pair.left, pair.right, np.full((240, 320), 20), known=known)
    assert judged.result.blur is None
    assert judged.result.blur_compensation is COMPENSATION

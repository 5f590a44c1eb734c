"""Metrics: the error of a disparity map against the truth, as the field's benchmarks count it.

This package computes numbers from an estimate, a truth and a mask of the pixels to score; it has no
files and no pictures. Percentages run from 0 to 100, errors are in pixels, sums in float64.

All functions follow the same conventions. `estimate` and `truth` are 2-D arrays of floats, in
pixels of the left view. A pixel is *scored* where the mask is True (everywhere without one) and the
truth is finite; where a scored pixel has no finite estimate, the estimate is *missing* and counts
as bad. Integers are refused: they cannot mark missing values, and are mostly the fixed point of a
file or of OpenCV (disparity times 16 or 256), which would be scored silently.
"""

from phasestereo.metrics.roc import Sparsification, roc_area, sparsification
from phasestereo.metrics.scores import (
    MiddleburyV2,
    Score,
    Scored,
    SubPixel,
    bad_pixels,
    end_point_error,
    middlebury_v2,
    score,
    subpixel,
    temporal_deviation,
)

__all__ = [
    "MiddleburyV2",
    "Score",
    "Scored",
    "Sparsification",
    "SubPixel",
    "bad_pixels",
    "end_point_error",
    "middlebury_v2",
    "roc_area",
    "score",
    "sparsification",
    "subpixel",
    "temporal_deviation",
]

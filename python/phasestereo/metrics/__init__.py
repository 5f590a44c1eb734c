"""Metrics: how far a disparity map is from the truth, as the field's benchmarks count it.

Here belong numbers computed from an estimate, a truth and a mask of the pixels to score, nothing
else: no files, no pictures. Percentages run from 0 to 100, errors are in pixels, sums in float64.

Every function follows the same conventions. `estimate` and `truth` are 2-D arrays of floats, in
pixels of the left view. A pixel is *scored* where the mask is True (everywhere without one) and the
truth is finite; where a scored pixel has no finite estimate, the estimate is *missing* and counts
as bad. Integers are refused: they cannot say "missing", and are most often a file's or OpenCV's
fixed point (disparity times 16 or 256), which would be scored without a complaint.
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

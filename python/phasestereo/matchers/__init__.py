"""Other matchers: networks in ONNX files, OpenCV's matchers, and any function.

    from phasestereo.matchers import load_matcher

    network = load_matcher("onnx:net.onnx")
    disparity = network(left, right)  # float32 (H, W), pixels, NaN elsewhere

`loading` makes a matcher from a specification, a function or an object; `onnx` and `opencv` run
theirs.
"""

from __future__ import annotations

from phasestereo.matchers.loading import OtherMatcher, load_matcher

__all__ = ["OtherMatcher", "load_matcher"]

"""Dense stereo matching on quantised local phase: fast, and robust to blur and contrast.

    import phasestereo as ps

    result = ps.match(left, right, num_disparities=64)
    result.disparity  # float32 (H, W), pixels

The left image is the reference: its pixel (x, y) corresponds to (x - d, y) in the right image.
"""

import warnings
from importlib import import_module
from typing import TYPE_CHECKING, Any

from phasestereo import _core
from phasestereo.aggregation import aggregate
from phasestereo.blur import Blur, BlurEstimate
from phasestereo.check import Diagnosis, check
from phasestereo.cost import cost_volume
from phasestereo.descriptor import descriptor
from phasestereo.equalisation import Equalisation
from phasestereo.estimation import estimate_blur
from phasestereo.findings import Finding
from phasestereo.matcher import Matcher, match
from phasestereo.result import Flag, Result
from phasestereo.scanline import optimize
from phasestereo.settings import PRESETS, Settings

if TYPE_CHECKING:
    from phasestereo.streaming import Failure, Frame, Stream, stream

__all__ = [
    "PRESETS",
    "Blur",
    "BlurEstimate",
    "Diagnosis",
    "Equalisation",
    "Failure",
    "Finding",
    "Flag",
    "Frame",
    "Matcher",
    "Result",
    "Settings",
    "Stream",
    "aggregate",
    "check",
    "cost_volume",
    "descriptor",
    "estimate_blur",
    "match",
    "optimize",
    "stream",
]
_LATER = dict.fromkeys(("Failure", "Frame", "Stream", "stream"), "phasestereo.streaming")
"""What is imported when it is first asked for, to keep the import of the package short."""

__version__ = _core.__version__

if _core.DEBUG_BUILD:
    warnings.warn(
        "phasestereo was built without optimisation and is many times slower than it should be; "
        "build it with `maturin develop --release`",
        RuntimeWarning,
        stacklevel=2,
    )


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_LATER[name]), name)

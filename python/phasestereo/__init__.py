"""Dense stereo matching on quantized local phase: fast, and robust to blur and contrast.

    import phasestereo as ps

    result = ps.match(left, right)
    result.disparity  # float32 (H, W), pixels

The left image is the reference: its pixel (x, y) corresponds to (x - d, y) in the right image.
"""

import warnings
from importlib import import_module
from typing import TYPE_CHECKING

from phasestereo import _core
from phasestereo.matching import Matcher, match
from phasestereo.result import Flag, Result, Summary
from phasestereo.rig.alignment import Alignment
from phasestereo.rig.blur import Blur, BlurEstimate
from phasestereo.rig.compensation import BlurCompensation
from phasestereo.rig.findings import Finding, MatchWarning
from phasestereo.rig.search_range import LeftOut, SearchRange
from phasestereo.settings import PRESETS, Settings
from phasestereo.temporal import TemporalFilter

__all__ = [
    "PRESETS",
    "Alignment",
    "Blur",
    "BlurCompensation",
    "BlurEstimate",
    "DepthInterval",
    "Diagnosis",
    "Failure",
    "Finding",
    "Flag",
    "Frame",
    "LeftOut",
    "MatchWarning",
    "Matcher",
    "Mesh",
    "PairStatistics",
    "PointCloud",
    "Rectification",
    "Result",
    "SearchRange",
    "Settings",
    "Stream",
    "Summary",
    "TemporalFilter",
    "Verdict",
    "Verification",
    "aggregate",
    "check",
    "cost_volume",
    "depth_interval",
    "descriptor",
    "estimate_blur",
    "halo",
    "match",
    "match_rows",
    "optimize",
    "pair_statistics",
    "point_cloud",
    "rectify",
    "stream",
    "surface_mesh",
    "verify",
]
__version__ = _core.__version__

if TYPE_CHECKING:
    from phasestereo import batch as batch
    from phasestereo import integrations as integrations
    from phasestereo import io as io
    from phasestereo import metrics as metrics
    from phasestereo import outofcore as outofcore
    from phasestereo import rectification as rectification
    from phasestereo import views as views
    from phasestereo.bands import PairStatistics, halo, match_rows, pair_statistics
    from phasestereo.integrations.video.streaming import Failure, Frame, Stream, stream
    from phasestereo.rectification import Rectification, rectify
    from phasestereo.rig.diagnosis import Diagnosis, check
    from phasestereo.rig.estimation import estimate_blur
    from phasestereo.stages import aggregate, cost_volume, descriptor, optimize
    from phasestereo.verification import Verdict, Verification, verify
    from phasestereo.views.depths import DepthInterval, depth_interval
    from phasestereo.views.meshing import Mesh, surface_mesh
    from phasestereo.views.triangulation import PointCloud, point_cloud
else:
    _ON_DEMAND = {
        "batch", "integrations", "io", "metrics", "outofcore", "rectification", "views",
    }  # fmt: skip
    # What a match does without: it would make up a seventh of the time that an import takes.
    _HOMES = {
        "DepthInterval": "views.depths",
        "Diagnosis": "rig.diagnosis",
        "Failure": "integrations.video.streaming",
        "Frame": "integrations.video.streaming",
        "Mesh": "views.meshing",
        "PointCloud": "views.triangulation",
        "Rectification": "rectification",
        "Stream": "integrations.video.streaming",
        "Verdict": "verification",
        "Verification": "verification",
        "PairStatistics": "bands",
        "aggregate": "stages",
        "check": "rig.diagnosis",
        "cost_volume": "stages",
        "depth_interval": "views.depths",
        "descriptor": "stages",
        "estimate_blur": "rig.estimation",
        "halo": "bands",
        "match_rows": "bands",
        "optimize": "stages",
        "point_cloud": "views.triangulation",
        "rectify": "rectification",
        "stream": "integrations.video.streaming",
        "surface_mesh": "views.meshing",
        "pair_statistics": "bands",
        "verify": "verification",
    }

    def __getattr__(name):
        """Import what is first asked for: modules, such as `ps.io`, and names of other modules."""
        if name in _ON_DEMAND:
            return import_module(f"{__name__}.{name}")

        if name in _HOMES:
            return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__():
        return sorted({*globals(), *_ON_DEMAND, *_HOMES})


if _core.DEBUG_BUILD:
    warnings.warn(
        "phasestereo was built without optimization and is many times slower than it should be; "
        "build it with `maturin develop --release`",
        RuntimeWarning,
        stacklevel=2,
    )

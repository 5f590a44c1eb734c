"""Dense stereo matching on quantized local phase: fast, and robust to blur and contrast.

    import phasestereo as ps

    result = ps.match(left, right)
    result.disparity  # float32 (H, W), pixels

The left image is the reference: its pixel (x, y) corresponds to (x - d, y) in the right image.
"""

import warnings
from typing import TYPE_CHECKING

from phasestereo import _core
from phasestereo.known import Known
from phasestereo.matching import Matcher, match, release_memory
from phasestereo.result import Flag, Result, Summary
from phasestereo.rig.alignment import Alignment
from phasestereo.rig.blur import Blur, BlurEstimate
from phasestereo.rig.compensation import BlurCompensation
from phasestereo.rig.findings import Finding, MatchWarning
from phasestereo.rig.rectified import Rectified
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
    "Event",
    "Finding",
    "Flag",
    "Known",
    "LeftOut",
    "MatchWarning",
    "Matcher",
    "Mesh",
    "PointCloud",
    "Prepared",
    "Rectification",
    "Rectified",
    "Registered",
    "Restoration",
    "Result",
    "Rig",
    "SearchRange",
    "Settings",
    "Summary",
    "TemporalFilter",
    "ThirdCamera",
    "Verdict",
    "Verification",
    "aggregate",
    "check",
    "cost_volume",
    "depth_interval",
    "descriptor",
    "estimate_blur",
    "match",
    "optimize",
    "point_cloud",
    "prepare",
    "rectify",
    "register",
    "release_memory",
    "surface_mesh",
    "verify",
]
__version__ = _core.__version__

if TYPE_CHECKING:
    from phasestereo import (
        io as io,
        matchers as matchers,
        metrics as metrics,
        opencv as opencv,
        rectification as rectification,
        views as views,
    )
    from phasestereo.preparation import Prepared, Restoration, prepare
    from phasestereo.rectification import Rectification, rectify
    from phasestereo.rig.diagnosis import Diagnosis, check
    from phasestereo.rig.estimation import estimate_blur
    from phasestereo.rigs import Event, Rig
    from phasestereo.shapes import Mesh, PointCloud
    from phasestereo.stages import aggregate, cost_volume, descriptor, optimize
    from phasestereo.verification import Verdict, Verification, verify
    from phasestereo.views.depths import DepthInterval, depth_interval
    from phasestereo.views.meshing import surface_mesh
    from phasestereo.views.registering import Registered, ThirdCamera, register
    from phasestereo.views.triangulation import point_cloud
else:
    _ROOMS = "io", "matchers", "metrics", "opencv", "rectification", "views"

    def __getattr__(name):
        """Import each name on first use: importing everything would double the import time."""
        match name:
            case "io":
                import phasestereo.io as home
            case "matchers":
                import phasestereo.matchers as home
            case "metrics":
                import phasestereo.metrics as home
            case "opencv":
                import phasestereo.opencv as home
            case "rectification" | "Rectification" | "rectify":
                import phasestereo.rectification as home
            case "views":
                import phasestereo.views as home
            case "Prepared" | "Restoration" | "prepare":
                from phasestereo import preparation as home
            case "Diagnosis" | "check":
                from phasestereo.rig import diagnosis as home
            case "estimate_blur":
                from phasestereo.rig import estimation as home
            case "Event" | "Rig":
                from phasestereo import rigs as home
            case "Mesh" | "PointCloud":
                from phasestereo import shapes as home
            case "aggregate" | "cost_volume" | "descriptor" | "optimize":
                from phasestereo import stages as home
            case "Verdict" | "Verification" | "verify":
                from phasestereo import verification as home
            case "DepthInterval" | "depth_interval":
                from phasestereo.views import depths as home
            case "Registered" | "ThirdCamera" | "register":
                from phasestereo.views import registering as home
            case "surface_mesh":
                from phasestereo.views import meshing as home
            case "point_cloud":
                from phasestereo.views import triangulation as home
            case "StereoCalibration" | "calibrate" | "stream":
                raise AttributeError(f"phasestereo_live.{name}: pip install 'phasestereo[live]'")
            case _:
                raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return home if name in _ROOMS else getattr(home, name)

    def __dir__():
        return sorted({*globals(), *__all__, *_ROOMS})


def _as_html(result: Result) -> str:
    """Show a result in a notebook: here, since the result's module does not import pictures."""
    from phasestereo.views import notebook

    return notebook.html(result)


Result._repr_html_ = _as_html

if _core.DEBUG_BUILD:
    warnings.warn(
        "phasestereo was built without optimization and is many times slower than it should be; "
        "build it with `maturin develop --release`",
        RuntimeWarning,
        stacklevel=2,
    )

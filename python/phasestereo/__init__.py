"""Dense stereo matching on quantised local phase: fast, and robust to blur and contrast.

    import phasestereo as ps

    result = ps.match(left, right)
    result.disparity  # float32 (H, W), pixels

The left image is the reference: its pixel (x, y) corresponds to (x - d, y) in the right image.
"""

import warnings
from importlib import import_module
from typing import TYPE_CHECKING

from phasestereo import _core
from phasestereo.aggregation import aggregate
from phasestereo.alignment import Alignment
from phasestereo.blur import Blur, BlurEstimate
from phasestereo.cost import cost_volume
from phasestereo.descriptor import descriptor
from phasestereo.equalisation import Equalisation
from phasestereo.findings import Finding, MatchWarning
from phasestereo.matcher import Matcher, match
from phasestereo.result import Flag, Result, Summary
from phasestereo.scanline import optimize
from phasestereo.search_range import SearchRange
from phasestereo.settings import PRESETS, Settings

__all__ = [
    "PRESETS",
    "Alignment",
    "Blur",
    "BlurEstimate",
    "Diagnosis",
    "Equalisation",
    "Failure",
    "Finding",
    "Flag",
    "Frame",
    "MatchWarning",
    "Matcher",
    "Mesh",
    "PointCloud",
    "Rectification",
    "Result",
    "SearchRange",
    "Settings",
    "Stream",
    "Summary",
    "Survey",
    "aggregate",
    "check",
    "cost_volume",
    "descriptor",
    "estimate_blur",
    "halo",
    "match",
    "match_rows",
    "optimize",
    "point_cloud",
    "rectify",
    "stream",
    "surface_mesh",
    "survey",
]
__version__ = _core.__version__

if TYPE_CHECKING:
    from phasestereo import batch as batch
    from phasestereo import dask as dask
    from phasestereo import io as io
    from phasestereo import labelled as labelled
    from phasestereo import metrics as metrics
    from phasestereo import opencv as opencv
    from phasestereo import outofcore as outofcore
    from phasestereo import picture as picture
    from phasestereo import plot as plot
    from phasestereo import rectification as rectification
    from phasestereo import rerun_log as rerun_log
    from phasestereo import roc as roc
    from phasestereo import ros as ros
    from phasestereo import video as video
    from phasestereo.banding import halo, match_rows
    from phasestereo.diagnosis import Diagnosis, check
    from phasestereo.estimation import estimate_blur
    from phasestereo.meshing import Mesh, surface_mesh
    from phasestereo.rectification import Rectification, rectify
    from phasestereo.streaming import Failure, Frame, Stream, stream
    from phasestereo.surveying import Survey, survey
    from phasestereo.triangulation import PointCloud, point_cloud
else:
    _ON_DEMAND = {
        "batch", "dask", "io", "labelled", "metrics", "opencv", "outofcore", "picture", "plot",
        "rectification", "rerun_log", "roc", "ros", "video",
    }  # fmt: skip
    # What a match does without: it would make up a seventh of the time that an import takes.
    _HOMES = {
        "Diagnosis": "diagnosis",
        "Failure": "streaming",
        "Frame": "streaming",
        "Mesh": "meshing",
        "PointCloud": "triangulation",
        "Rectification": "rectification",
        "Stream": "streaming",
        "Survey": "surveying",
        "check": "diagnosis",
        "estimate_blur": "estimation",
        "halo": "banding",
        "match_rows": "banding",
        "point_cloud": "triangulation",
        "rectify": "rectification",
        "stream": "streaming",
        "surface_mesh": "meshing",
        "survey": "surveying",
    }

    def __getattr__(name):
        """Import what is first asked for: modules, as `ps.io`, and what has its home in others."""
        if name in _ON_DEMAND:
            return import_module(f"{__name__}.{name}")
        if name in _HOMES:
            return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__():
        return sorted({*globals(), *_ON_DEMAND, *_HOMES})


if _core.DEBUG_BUILD:
    warnings.warn(
        "phasestereo was built without optimisation and is many times slower than it should be; "
        "build it with `maturin develop --release`",
        RuntimeWarning,
        stacklevel=2,
    )

"""Match pairs larger than memory: read windows, keep finished blocks, resume after a kill.

`run` sets the order of steps, `request` holds the request, `plan` computes how much fits into
memory, `work` matches the bands, `store` keeps the finished ones, and `sinks` writes the output
files.
"""

from __future__ import annotations

from phasestereo_large.outofcore.plan import Plan
from phasestereo_large.outofcore.report import MapReport
from phasestereo_large.outofcore.run import match
from phasestereo_large.outofcore.sizes import as_bytes, format_bytes

__all__ = ["MapReport", "Plan", "as_bytes", "format_bytes", "match"]

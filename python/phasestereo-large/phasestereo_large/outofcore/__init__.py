"""Matching pairs larger than memory: read by windows, kept block by block, resumed after a kill.

`run` holds the order of things, `request` what is asked for, `plan` how much fits into memory,
`work` the bands, `store` what is finished, and `sinks` the files that come out.
"""

from __future__ import annotations

from phasestereo_large.outofcore.plan import Plan
from phasestereo_large.outofcore.report import MapReport
from phasestereo_large.outofcore.run import match
from phasestereo_large.outofcore.sizes import as_bytes, format_bytes

__all__ = ["MapReport", "Plan", "as_bytes", "format_bytes", "match"]

"""The outcome of a run: the known facts about a map that is too large to view."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from phasestereo.result import Flag
from phasestereo_large.outofcore.plan import Plan
from phasestereo_large.statistics import PairStatistics


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapReport:
    """A finished run.

    Parameters
    ----------
    plan
        The plan of the match.
    statistics
        The known facts about the pair: settings, blur, the disparities searched.
    files
        The files written, by their layer: ``"disparity"`` and those of `phasestereo.result.LAYERS`.
    estimated
        Share of the pixels with an estimate, 0 to 1.
    flags
        Number of pixels under each flag.
    seconds
        Wall-clock seconds of all bands, including those of earlier runs.
    peak_memory
        Peak memory of this process since it began, bytes; None: the system does not report it.
    again
        Work that an earlier run had finished, but that was missing or damaged and done again.
    """

    plan: Plan
    statistics: PairStatistics
    files: Mapping[str, Path]
    estimated: float
    flags: Mapping[Flag, int]
    seconds: float
    peak_memory: int | None
    again: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return all fields in JSON form."""
        statistics, plan = self.statistics, self.plan
        return {
            "width": statistics.size[1],
            "height": statistics.size[0],
            "min_disparity": statistics.min_disparity,
            "num_disparities": statistics.num_disparities,
            "settings": asdict(statistics.settings),
            "timings": {"bands": self.seconds},
            "blurs": None if statistics.blur is None else statistics.blur.as_dicts(),
            "estimated": self.estimated,
            "flags": {str(flag.name).lower(): count for flag, count in self.flags.items()},
            "files": {layer: str(path) for layer, path in self.files.items()},
            "again": list(self.again),
            "bands": {"matched": plan.bands, "finished_before": plan.finished, "rows": plan.rows},
            "threads": plan.threads,
            "memory": {"expected": plan.memory, "peak": self.peak_memory},
        }

"""The tables of a speed benchmark in a Markdown document, where it asks for them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from phasestereo_bench.report.documents import small_print
from phasestereo_bench.report.markdown import markdown_table
from phasestereo_bench.report.origin import made_with
from phasestereo_bench.speed.results import explain_speed, memory_table, time_table

if TYPE_CHECKING:
    from phasestereo_bench.speed.results import SpeedResults

MARKER = "speed"


def speed_text(results: SpeedResults) -> str:
    """Return the tables and what stands below them, as Markdown."""
    tables = [markdown_table(table(results)) for table in (time_table, memory_table)]
    below = small_print(f"{explain_speed(results)} {made_with(results.environments.values())}")
    return "\n\n".join([*tables, below])

"""The table of the trials in a Markdown document, where it asks for it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from phasestereo_bench.blur.results import blur_table, explain_blur
from phasestereo_bench.report.documents import small_print
from phasestereo_bench.report.markdown import markdown_table
from phasestereo_bench.report.origin import made_with

if TYPE_CHECKING:
    from phasestereo_bench.blur.results import BlurResults

MARKER = "blur"


def blur_text(results: BlurResults) -> str:
    """Return the table and what stands below it, as Markdown."""
    below = small_print(f"{explain_blur(results)} {made_with(results.environments.values())}")
    return f"{markdown_table(blur_table(results))}\n\n{below}"

"""The report of a benchmark: tables, a plot, and tables in documents.

    from phasestereo_bench.report import fill_document, read_results

    fill_document("README.md", read_results(["results.jsonl"]))

Data flow: stores -> `results` of `cells` -> `tables` and `plots` -> `documents`.
"""

from phasestereo_bench.report.cells import METRICS, Cell, Metric, Place
from phasestereo_bench.report.documents import MARKERS, fill_document
from phasestereo_bench.report.results import Results, read_results

__all__ = [
    "MARKERS",
    "METRICS",
    "Cell",
    "Metric",
    "Place",
    "Results",
    "fill_document",
    "read_results",
]

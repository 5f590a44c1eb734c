"""The report of a benchmark: tables, plots, a page, and tables in documents.

    from phasestereo_bench.report import read_results, write_report

    write_report(read_results(["results.jsonl"]), "report")

Data flow: stores -> `results` of `cells` -> `tables` and `plots` -> `page`, `documents`.
"""

from phasestereo_bench.report.cells import METRICS, Cell, Metric, Place
from phasestereo_bench.report.documents import MARKERS, fill_document
from phasestereo_bench.report.page import write_report
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
    "write_report",
]

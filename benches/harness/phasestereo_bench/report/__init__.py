"""The report of a benchmark: tables, a plot, and tables in documents.

    from phasestereo_bench.report import document_texts, fill_places, read_results

    fill_places("README.md", document_texts(read_results(["results.jsonl"])))

Data flow: stores -> `results` of `cells` -> `tables` and `plots` -> `documents`.
"""

from phasestereo_bench.report.cells import METRICS, Cell, Metric, Place
from phasestereo_bench.report.documents import MARKERS, document_texts, fill_places
from phasestereo_bench.report.results import Results, read_results

__all__ = [
    "MARKERS",
    "METRICS",
    "Cell",
    "Metric",
    "Place",
    "Results",
    "document_texts",
    "fill_places",
    "read_results",
]

"""Reports a benchmark in tables, in a plot, and in the tables of documents.

    from phasestereo_bench.report.documents import document_texts, fill_places
    from phasestereo_bench.report.results import read_results

    fill_places("README.md", document_texts(read_results(["results.jsonl"])))

Data flow: stores -> `results` of `cells` -> `tables` and `plots` -> `documents`.
"""

"""Makes all tables of the documentation from one folder of data, by one command.

`plan` lists the runs, `texts` turns the results into Markdown, and `export` into numbers for
machines.
"""

from phasestereo_bench.tables.export import export
from phasestereo_bench.tables.plan import JobGroup, job_groups
from phasestereo_bench.tables.texts import table_texts

__all__ = ["JobGroup", "export", "job_groups", "table_texts"]

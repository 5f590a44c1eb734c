"""What the experiments leave behind: CSV files, figures, disparity maps, and a page about them."""

from __future__ import annotations

import csv
import io
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from phasestereo.io.files import replacing
from phasestereo.report import render_page
from phasestereo_bench.paper.experiments import BITS_KEY, EXPERIMENTS, PROTOCOLS
from phasestereo_bench.paper.figures import save_bits, save_comparison, save_maps
from phasestereo_bench.paper.maps import make_maps, write_maps
from phasestereo_bench.paper.page import sections
from phasestereo_bench.paper.tables import choices_table, claims_table, prototype_table
from phasestereo_bench.paper.wording import claims
from phasestereo_bench.report.markdown import markdown_table, markdown_text
from phasestereo_bench.store import read_store

if TYPE_CHECKING:
    from pathlib import Path

    from phasestereo_bench.paper.cells import Pairs
    from phasestereo_bench.paper.study import Study
    from phasestereo_bench.report.tables import Table

__all__ = ["write_page", "write_study"]

_MAPS = "figure5_maps"


def write_study(study: Study, pairs: Pairs, store: Path, folder: Path) -> list[Path]:
    """Write CSV files, figures, maps and the page, in place of those of an earlier run.

    Parameters
    ----------
    study
        What was measured.
    pairs
        Of what.
    store
        Where `run_study` kept it, and with what machine and software.
    folder
        Where to; it exists.

    Returns
    -------
    list of Path
        The files, ``paper.html`` last.

    Raises
    ------
    OSError
        If a file cannot be read or written.
    """
    files = _write_tables(study, folder)
    for protocol in PROTOCOLS:
        files += save_comparison(study.readings, protocol, folder / f"figure2_{protocol}")
        files += save_bits(study.readings, protocol, folder / f"figure3_{protocol}")
        rows = make_maps(study, pairs, protocol)
        files += save_maps(rows, folder / f"figure5_{protocol}")
        maps = folder / _MAPS / protocol
        maps.mkdir(parents=True, exist_ok=True)
        files += write_maps(rows, maps)
    return [*files, *write_page(study, store, folder)]


def write_page(study: Study, store: Path, folder: Path) -> list[Path]:
    """Write the page, ``paper.md`` and ``paper.html``, about the figures in a folder.

    Arguments, result and errors as of `write_study`.
    """
    environments = [line for line in read_store(store) if line.get("kind") == "environment"]
    page = {"sections": sections(study, environments), "quick": study.quick, "folder": folder}
    files = [folder / "paper.md", folder / "paper.html"]
    for path in files:
        text = render_page(
            f"{path.name}.j2",
            package="phasestereo_bench",
            **page,
            table=markdown_table,
            plain=markdown_text,
        )
        with replacing(path) as file:
            file.write(text.encode())
    return files


def _write_tables(study: Study, folder: Path) -> list[Path]:
    """Write the readings, a file for each experiment, and what else the page has in tables."""
    rows = [asdict(each) for each in study.readings]
    numbers = {experiment.key: experiment.number for experiment in EXPERIMENTS}
    tables = {
        f"experiment{number}": [row for row in rows if numbers.get(row["experiment"]) == number]
        for number in sorted(set(numbers.values()))
    }
    tables["figure3"] = [row for row in rows if row["experiment"] == BITS_KEY]
    texts = {
        "claims": claims_table(claims(study.readings)),
        "prototype": prototype_table(study),
        "settings": choices_table(study),
    }
    tables |= {name: _records(table) for name, table in texts.items()}
    files = []
    for name, records in tables.items():
        files.append(folder / f"{name}.csv")
        text = io.StringIO(newline="")
        writer = csv.DictWriter(text, list(records[0]))
        writer.writeheader()
        writer.writerows(records)
        with replacing(files[-1]) as file:
            file.write(text.getvalue().encode())
    return files


def _records(table: Table) -> list[dict[str, Any]]:
    return [
        dict(zip(table.header, [entry.text for entry in row], strict=True)) for row in table.rows
    ]

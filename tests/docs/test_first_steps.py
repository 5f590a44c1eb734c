"""The notebook of the documentation: it runs, and prints what is committed with it."""

import asyncio
from pathlib import Path
from typing import Any

from support import ROOT, counterpart

NOTEBOOK = ROOT / "docs/first-steps.ipynb"
MOST = 150_000
"""Bytes: pictures are in the file."""


def printed(cell: Any) -> str:
    return "".join(one.text for one in cell.outputs if one.output_type == "stream")


def shown(cell: Any) -> list[list[str]]:
    return [sorted(one.data) for one in cell.outputs if "data" in one]


def test_the_notebook_gives_the_outputs_that_are_committed(tmp_path: Path) -> None:
    nbformat, nbclient = counterpart("nbformat"), counterpart("nbclient")
    counterpart("ipykernel")
    counterpart("matplotlib")

    committed = nbformat.read(NOTEBOOK, as_version=4)
    found = nbformat.read(NOTEBOOK, as_version=4)
    client = nbclient.NotebookClient(
        found,
        kernel_name="python3",
        timeout=120,
        resources={"metadata": {"path": str(tmp_path)}},
    )
    asyncio.run(client.async_execute())

    cells = [
        pair for pair in zip(committed.cells, found.cells, strict=True) if "outputs" in pair[0]
    ]
    assert len(cells) >= 5
    for kept, made in cells:
        assert printed(made) == printed(kept), kept.source
        assert shown(made) == shown(kept), kept.source
    assert not list(tmp_path.iterdir())


def test_the_notebook_is_small_and_names_no_machine() -> None:
    text = NOTEBOOK.read_text("utf-8")
    assert len(text) < MOST
    assert "ipykernel_" not in text
    assert "/tmp/" not in text  # noqa: S108 -- a name to look for

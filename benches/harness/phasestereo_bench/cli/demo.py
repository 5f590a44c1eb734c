"""``phasestereo demo``: a rendered pair with one image degraded, matched and drawn."""

# No `from __future__ import annotations`: the command line is made of these annotations.

import webbrowser
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators
from rich.console import Console
from rich.table import Table

from phasestereo.cli.errors import refusals
from phasestereo.cli.terminal import printable, progress_bar
from phasestereo_bench.demo import Demo, run_demo, verdict, write_demo


def demo(
    *,
    output: Annotated[Path, Parameter(alias="-o")] = Path("demo"),
    seed: Annotated[int, Parameter(validator=validators.Number(gte=0))] = 0,
    open_page: Annotated[bool, Parameter(name="--open", negative=(), show_default=False)] = False,
) -> None:
    """Show what one image out of focus does to stereo matching.

    What else its help says is in `phasestereo.cli.HARNESS`.

    Parameters
    ----------
    output
        Folder for the maps, the pictures and report.html; made if need be. Files of an earlier
        demo in it are replaced.
    seed
        Which scene.
    open_page
        Open report.html in the web browser.
    """
    with refusals():
        output.mkdir(parents=True, exist_ok=True)
        with progress_bar("Rendering and matching") as progress:
            shown = run_demo(seed, progress=progress)
        page = write_demo(shown, output)[-1]

    console = Console(highlight=False)
    console.print(_table(shown))
    story = printable(f"{verdict(shown)} The whole story: {page}")
    console.print(story, markup=False, soft_wrap=True)

    if open_page:
        webbrowser.open(page.absolute().as_uri())


def _table(shown: Demo) -> Table:
    table = Table("method", title="Wrong by more than 1 pixel, of what both views see")
    for heading in ("both sharp", "left degraded", "seconds"):
        table.add_column(heading, justify="right")

    for outcome in shown.outcomes:
        table.add_row(
            outcome.method.name,
            f"{outcome.sharp.bad:.1f} %",
            f"{outcome.degraded.bad:.1f} %",
            f"{outcome.degraded.seconds:.2f}",
        )
    return table

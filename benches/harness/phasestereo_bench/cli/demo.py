"""``phasestereo demo`` matches and draws a rendered pair with one degraded image."""

import webbrowser
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from phasestereo.cli.errors import refusals
from phasestereo.cli.terminal import progress_bar
from phasestereo_bench.cli.bench_tables import show
from phasestereo_bench.cli.parameters import Natural, Output
from phasestereo_bench.demo import run_demo, verdict, write_demo
from phasestereo_bench.report.tables import Table


def demo(
    *,
    output: Output = Path("demo"),
    seed: Natural = 0,
    open_page: Annotated[bool, Parameter(name="--open", negative=(), show_default=False)] = False,
) -> None:
    """Show what one image out of focus does to stereo matching.

    `phasestereo.cli.HARNESS` has the rest of its help.

    Parameters
    ----------
    output
        Folder for the maps, the pictures and report.html; created if needed. Files of an earlier
        demo in it are replaced.
    seed
        Seed of the scene.
    open_page
        Open report.html in the web browser.
    """
    with refusals():
        output.mkdir(parents=True, exist_ok=True)
        with progress_bar("Rendering and matching") as progress:
            shown = run_demo(seed, progress=progress)
        page = write_demo(shown, output)[-1]

    header = "method", "both sharp", "left degraded", "seconds"
    rows = (
        (
            one.method.name,
            f"{one.sharp.bad:.1f} %",
            f"{one.degraded.bad:.1f} %",
            f"{one.degraded.seconds:.2f}",
        )
        for one in shown.outcomes
    )
    title = "Wrong by more than 1 pixel, of what both views see"
    show({title: Table.of(header, rows)}, f"{verdict(shown)} The whole story: {page}")

    if open_page:
        webbrowser.open(page.absolute().as_uri())

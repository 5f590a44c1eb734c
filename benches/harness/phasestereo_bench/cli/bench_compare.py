"""``phasestereo bench compare``: the pictures and the table of the page that compares."""

# No `from __future__ import annotations`: the command line is made of these annotations.

from pathlib import Path

from phasestereo.cli.errors import refusals
from phasestereo.cli.terminal import say
from phasestereo_bench.cli.parameters import Output
from phasestereo_bench.report.documents import fill_places
from phasestereo_bench.tables.comparison import (
    comparison_text,
    draw_comparison,
    read_numbers,
)


def compare(
    numbers: Path,
    /,
    *,
    output: Output = Path("compare"),
    readme: Path | None = None,
) -> None:
    """Compare ours with others: errors against time, by fault, by kind of pixel.

    For example:

    ```
    phasestereo bench compare docs/results.json -o docs/images --readme docs/compare.md
    ```

    Parameters
    ----------
    numbers
        The file results.json that bench tables writes.
    output
        Folder for the pictures, SVG.
    readme
        Markdown file whose table between the comments ``<!-- bench:compare -->`` and
        ``<!-- /bench:compare -->`` is to be replaced.
    """
    with refusals():
        found = read_numbers(numbers)
        output.mkdir(parents=True, exist_ok=True)
        written = draw_comparison(found, output)
        if readme is not None:
            fill_places(readme, {"compare": comparison_text(found)})
            written.append(readme)

    for path in written:
        say(f"wrote {path}")

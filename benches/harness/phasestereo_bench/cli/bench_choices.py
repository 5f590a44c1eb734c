"""``phasestereo bench choices`` sweeps constants of the core and prints a table."""

from pathlib import Path
from typing import Annotated

from phasestereo.cli.errors import refusals
from phasestereo.cli.terminal import progress_bar
from phasestereo_bench.choices import (
    AS_IT_IS,
    Constant,
    build,
    choose,
    constants_table,
    find_constants,
    score,
    swept_table,
)
from phasestereo_bench.cli.bench_tables import show
from phasestereo_bench.cli.parameters import SEVERAL, Names, Output


def choices(
    *folders: Path,
    constant: Names = (),
    factor: Annotated[tuple[float, ...], SEVERAL] = (0.5, 2.0),
    suite: str = "rigs",
    degradation: Names = (),
    scene: Names = (),
    method: str = "robust",
    source: Path = Path(),
    output: Output = Path("choices"),
) -> None:
    """Sweep constants of the core: build it with other values of each, and score the builds.

    Each variant takes about a minute to compile, and then matches the scenes under the
    degradations. The table shows the shares of wrong pixels of the unchanged core, and below them
    the change that each variant makes. To continue an interrupted run, give the same command again.
    Without ``--constant``, the command lists the constants that you can sweep. For example:

    ```
    phasestereo bench choices
    phasestereo bench choices ~/middlebury --constant LARGE_JUMP scales.rs:MANY --factor 0.5 2
    ```

    Parameters
    ----------
    folders
        Official folder trees: folders that hold scenes2001, MiddEval3 and so on.
    constant
        Constants to sweep, by name; with the file if several constants share a name:
        scales.rs:MANY.
    factor
        Factors for each constant; integers are rounded.
    suite
        Suite of the degradations, as for ``phasestereo bench middlebury``.
    degradation
        Only these degradations of the suite.
    scene
        Only these scenes.
    method
        Method to match with, one of those of ``phasestereo bench middlebury``.
    source
        Checkout of phasestereo, with its Rust source.
    output
        Folder for builds and records.
    """
    with refusals(options={"constant", "factor", "source", "output"}):
        known = find_constants(source)
        if not constant:
            show({"Constants": constants_table(known)})
            return
        variants: dict[str, tuple[Constant, str] | None] = {AS_IT_IS: None}
        for one in choose(known, constant):
            for times in factor:
                value = one.scaled(times)
                variants[f"{one.name} = {value}"] = one, value

        named = {"--degradation": degradation, "--scene": scene}
        options = [part for name, own in named.items() if own for part in (name, *own)]
        arguments = [*map(str, folders), "--suite", suite, "--method", method, *options]
        scores = {}
        with progress_bar("Sweeping") as progress:
            for done, (label, change) in enumerate(variants.items(), start=1):
                scores[label] = score(build(source, output, label, change), arguments, output)
                if progress is not None:
                    progress(done, len(variants))

    show({f"{method}, {suite}: points more or less": swept_table(scores)}, f"Records: {output}")

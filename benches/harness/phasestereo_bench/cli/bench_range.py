"""``phasestereo bench range``: pairs of known disparities -> whether their range is found."""

# No `from __future__ import annotations`: the command line is made of these annotations.

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from phasestereo.cli.errors import refusals
from phasestereo.cli.terminal import progress_bar
from phasestereo_bench.cases import require_known
from phasestereo_bench.cli.bench_scenes import ALL, SceneChoice
from phasestereo_bench.cli.bench_tables import show
from phasestereo_bench.cli.parameters import Flag, Names
from phasestereo_bench.ranges import (
    KINDS,
    Comparison,
    Trial,
    compare,
    compared_table,
    constructions,
    found_table,
    search,
)


def range_(
    *folders: Path,
    choice: Annotated[SceneChoice, Parameter(name="*")] = ALL,
    kind: Names = (),
    held: Flag = False,
    told: Annotated[bool, Parameter(negative=())] = True,
) -> None:
    """Check whether the range is found where none is given.

    Pairs are made of the scenes, always the same: near objects, poles and squares before far
    backgrounds, disparities of either sign in images of many widths, the same image twice, and
    weak texture. Then the scenes are matched without and with their range. For example:

    ```
    phasestereo bench range ~/middlebury
    phasestereo bench range ~/middlebury --kind poles squares --held
    ```

    Parameters
    ----------
    folders
        Official folder trees: folders that hold scenes2001, MiddEval3 and so on.
    kind
        Only these: near, poles, squares, signed, same, parallel, weak.
    held
        Other pairs than those that the search was developed with: other textures, places, sizes
        and faults.
    told
        Match the scenes, too.
    """
    with refusals(options={"scene", "kind"}):
        require_known("kind", kind, KINDS)
        chosen = choice.select(folders, "one-sided-blur", silent=True)
        scenes = [scene.load() for scene in chosen]
        made = list(constructions(scenes, kind or KINDS, held=held))
        work: list[Callable[[], Trial | Comparison]] = [partial(search, one) for one in made]
        work += [partial(compare, pair, repeats=3) for pair in scenes if told]
        found: list[Trial | Comparison] = []
        with progress_bar("Searching") as progress:
            for call in work:
                found.append(call())
                if progress is not None:
                    progress(len(found), len(work))

    trials = [one for one in found if isinstance(one, Trial)]
    compared = [one for one in found if isinstance(one, Comparison)]
    outside = [f"{one.kind}: {one.name}: searched {one.search}" for one in trials if one.outside]
    show({"Outside the range that was found": found_table(trials)}, *outside)
    show({"Without and with the range": compared_table(compared) if compared else None})

"""``phasestereo bench submit``: what the sites of Middlebury, ETH3D and KITTI take."""

# No `from __future__ import annotations`: the command line is made of these annotations.

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from phasestereo.cli.errors import refusals
from phasestereo.cli.terminal import progress_bar, say
from phasestereo_bench.cli.bench_scenes import SceneChoice
from phasestereo_bench.cli.parameters import Output
from phasestereo_bench.submission import submit as submitted

_EACH = SceneChoice(scene=("*",))


def submit(
    *folders: Path,
    choice: Annotated[SceneChoice, Parameter(name="*")] = _EACH,
    method: str = "robust",
    name: str = "phasestereo",
    output: Output = Path("submission"),
) -> None:
    """Write the zip files that the sites of Middlebury, ETH3D and KITTI take.

    Scenes need no truth. Each is matched once, on one thread, one after the other. For example:

    ```
    phasestereo bench submit ~/MiddEval3 --scene "trainingH/*" "testH/*"
    phasestereo bench submit ~/kitti2015/testing --method mine:match --name Mine
    ```

    Parameters
    ----------
    folders
        Folders that hold MiddEval3, two_view_training, two_view_test, kitti2012 or kitti2015.
    method
        What matches, as of `bench middlebury`.
    name
        What the site calls it: letters, digits, - and _.
    output
        Folder for the files, and for a zip of those of each site and size.
    """
    with refusals(options={"scene", "method", "name"}):
        scenes = choice.select(folders, "sharp", silent=True)
        with progress_bar("Matching") as progress:
            archives, said = submitted(scenes, method, name, output, progress=progress)

    for line in (*said, *(f"{path}: {count} scenes" for path, count in archives.items())):
        say(line)

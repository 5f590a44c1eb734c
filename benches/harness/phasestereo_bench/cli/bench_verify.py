"""``phasestereo bench verify``: maps of other matchers -> how well a second opinion judges them."""

# No `from __future__ import annotations`: the command line is made of these annotations.

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from phasestereo.cli.errors import refusals
from phasestereo.cli.terminal import say
from phasestereo_bench.cases import require_known
from phasestereo_bench.cli.bench_middlebury import rivals
from phasestereo_bench.cli.bench_scenes import ALL, SceneChoice
from phasestereo_bench.cli.bench_tables import show
from phasestereo_bench.cli.parameters import SCENES, Folders, Names
from phasestereo_bench.verification import CONDITIONS, opinion_table, opinions

_OPTIONS = {"scene", "condition", "method", "hitnet"}


def verify(
    *folders: Folders,
    choice: Annotated[SceneChoice, Parameter(name="*", group=SCENES)] = ALL,
    condition: Names = tuple(CONDITIONS),
    method: Names = ("opencv:sgbm",),
    hitnet: Path | None = None,
) -> None:
    """Judge the maps of other matchers, and say how often that is right.

    Of each map: the share of the visible pixels that are off by more than 1 px, the shares of these
    and of the right ones that are refuted (beside that, what a confident match that differs by
    more than 1.5 px would refute), how often the better disparity is right, what is supported, and
    what is refuted of the right disparities that the other image does not see. Means over the
    scenes, in %. For example:

    ```
    phasestereo bench verify ~/middlebury --hitnet hitnet_eth3d.onnx
    ```

    Parameters
    ----------
    folders
        Official folder trees: folders that hold scenes2001, MiddEval3 and so on, or one of these,
        or one scene in it.
    condition
        What is done to the pairs: sharp, "disk 6", "gauss 2", "motion 9", "noise 20", "jpeg 70",
        "both disk 3", "rows 1"; all of them without it.
    method
        Whose maps: any that ``phasestereo bench middlebury`` takes.
    hitnet
        HITNet's ONNX file for ETH3D: the network takes part, too, if onnxruntime is installed.
    """
    with refusals(options=_OPTIONS):
        require_known("condition", condition, CONDITIONS)
        scenes = choice.select(folders, "sharp")
        methods = [*rivals(hitnet), *method]
        say(f"matching and judging {len(scenes)} scenes under {len(condition)} conditions")
        table = opinion_table(list(opinions(scenes, methods, condition)))

    show({f"A second opinion, %, means of {len(scenes)} scenes": table})

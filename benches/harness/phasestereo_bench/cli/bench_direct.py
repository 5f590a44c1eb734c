"""These commands keep no records and print a table at once: ranges, second opinions, videos."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

from phasestereo.cli.errors import refusals
from phasestereo.cli.terminal import progress_bar, say
from phasestereo.settings import PRESETS
from phasestereo_bench.cases import require_known
from phasestereo_bench.cli.bench_middlebury import rivals
from phasestereo_bench.cli.bench_scenes import ALL, SceneChoice
from phasestereo_bench.cli.bench_tables import show
from phasestereo_bench.cli.parameters import SCENES, Flag, Folders, Names, Natural
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
from phasestereo_bench.verification import CONDITIONS, opinion_table, opinions
from phasestereo_bench.video import compared, steadiness_table


def range_(
    *folders: Path,
    choice: Annotated[SceneChoice, Parameter(name="*")] = ALL,
    kind: Names = (),
    held: Flag = False,
) -> None:
    """Check whether a match finds the range when none is given.

    The command makes pairs from the scenes, always the same ones: near objects, poles and squares
    before far backgrounds, disparities of either sign in images of many widths, the same image
    twice, and weak texture. Then it matches the scenes without and with their range. For example:

    ```
    phasestereo bench range ~/middlebury
    phasestereo bench range ~/middlebury --kind poles squares --held
    ```

    Parameters
    ----------
    folders
        Official folder trees: folders that hold scenes2001, MiddEval3 and so on.
    kind
        Only these kinds: near, poles, squares, signed, same, parallel, weak.
    held
        Use held-out pairs, on which the search was not developed: other textures, places, sizes and
        faults.
    """
    with refusals(options={"scene", "kind"}):
        require_known("kind", kind, KINDS)
        chosen = choice.select(folders, "one-sided-blur", silent=True)
        scenes = [scene.load() for scene in chosen]
        made = list(constructions(scenes, kind or KINDS, held=held))
        work: list[Callable[[], Trial | Comparison]] = [partial(search, one) for one in made]
        work += [partial(compare, pair, repeats=3) for pair in scenes]
        found: list[Trial | Comparison] = []
        with progress_bar("Searching") as progress:
            for call in work:
                found.append(call())
                if progress is not None:
                    progress(len(found), len(work))

    trials = [one for one in found if isinstance(one, Trial)]
    matched = [one for one in found if isinstance(one, Comparison)]
    outside = [f"{one.kind}: {one.name}: searched {one.search}" for one in trials if one.outside]
    show({"Outside the range that was found": found_table(trials)}, *outside)
    show({"Without and with the range": compared_table(matched)})


def verify(
    *folders: Folders,
    choice: Annotated[SceneChoice, Parameter(name="*", group=SCENES)] = ALL,
    condition: Names = tuple(CONDITIONS),
    method: Names = ("opencv:sgbm",),
    hitnet: Path | None = None,
) -> None:
    """Judge the maps of other matchers, and show how often the judgment is right.

    The table shows for each map the share of the visible pixels that are off by more than 1 px, the
    shares of these and of the right pixels that are refuted (beside them, the shares that a
    confident match that differs by more than 1.5 px would refute), how often the better disparity
    is right, the share that is supported, and the share that is refuted of the right disparities
    that the other image does not see. All are means over the scenes, in %. For example:

    ```
    phasestereo bench verify ~/middlebury --hitnet hitnet_eth3d.onnx
    ```

    Parameters
    ----------
    folders
        Official folder trees: folders that hold scenes2001, MiddEval3 and so on, or one of these,
        or one scene in it.
    condition
        Condition of the pairs: sharp, "disk 6", "gauss 2", "motion 9", "noise 20", "jpeg 70", "both
        disk 3", "rows 1". Without it, all of them.
    method
        Methods whose maps to judge: any that ``phasestereo bench middlebury`` takes.
    hitnet
        HITNet's ONNX file for ETH3D; the network also takes part if onnxruntime is installed.
    """
    with refusals(options={"scene", "condition", "method", "hitnet"}):
        require_known("condition", condition, CONDITIONS)
        scenes = choice.select(folders, "sharp")
        methods = [*rivals(hitnet), *method]
        say(f"matching and judging {len(scenes)} scenes under {len(condition)} conditions")
        table = opinion_table(list(opinions(scenes, methods, condition)))

    show({f"A second opinion, %, means of {len(scenes)} scenes": table})


def video(
    *,
    preset: Names = ("fast", "robust"),
    noise: Annotated[float, Parameter(validator=validators.Number(gte=0))] = 3.0,
    seed: Natural = 0,
) -> None:
    """Score streams on rendered videos, without and with the temporal filter.

    There are three sequences of 12 frames, each frame with fresh noise: a static scene, a moving
    camera, and an object that moves before a static scene. The table gives every number without the
    filter and with it. The command takes half a minute:

    ```
    phasestereo bench video
    ```

    Parameters
    ----------
    preset
        Presets to match with. Without it, fast and robust.
    noise
        Standard deviation of the noise, gray levels.
    seed
        Seed of the scene and the noise.
    """
    with refusals(options={"preset", "noise", "seed"}):
        require_known("preset", preset, PRESETS)
        say("rendering and matching 3 sequences")
        table = steadiness_table(list(compared(preset, noise, seed)))

    show({f"Frame by frame -> temporal filter, noise {noise:g}": table})

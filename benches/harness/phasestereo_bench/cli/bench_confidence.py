"""``phasestereo bench confidence``: spoiled pairs -> weights of probable confidences."""

# No `from __future__ import annotations`: the command line is made of these annotations.

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from phasestereo.cli.errors import refusals
from phasestereo_bench.cli.bench_middlebury import rivals
from phasestereo_bench.cli.bench_runs import AS_USUAL, Records, RunOptions, Suite
from phasestereo_bench.cli.bench_scenes import ALL, SceneChoice
from phasestereo_bench.cli.parameters import RUN, SCENES, Folders, Positive, RecordsFile
from phasestereo_bench.confidence import (
    OFTEN,
    claim_jobs,
    claims_of,
    confidence_jobs,
    held_out,
    judging,
    judging_table,
    learned_weights,
    verdict_table,
    write_weights,
)
from phasestereo_bench.confidence.learning import observed_of
from phasestereo_bench.confidence.observation import PRESETS
from phasestereo_bench.report.tables import Table

_OPTIONS = {"scene", "every", "weights", "hitnet"}
_METHODS = "opencv:sgbm", "prepared:sgbm", "fast"


def confidence(
    *folders: Folders,
    choice: Annotated[SceneChoice, Parameter(name="*", group=SCENES)] = ALL,
    of: Annotated[Literal["matches", "maps"], Parameter(group=SCENES)] = "matches",
    hitnet: Annotated[Path | None, Parameter(group=SCENES)] = None,
    every: Annotated[Positive, Parameter(group=RUN)] = 1,
    output: RecordsFile = Path("confidence.jsonl"),
    weights: Annotated[Path | None, Parameter(group=RUN)] = None,
    running: Annotated[RunOptions, Parameter(name="*", group=RUN)] = AS_USUAL,
) -> None:
    """Learn what raw confidences mean, from pairs that are spoiled in many ways.

    Every scene, and some rendered ones, are matched as they are and under faults of the suites, one
    or two in a row, by each preset: about 1000 matches. Of each remain counts of its errors in a
    file of JSON lines; a run that was interrupted goes on where it stopped when the same command is
    given again. The weights are judged by faults and by scenes that they were not learned from. For
    example:

    ```
    phasestereo bench confidence ~/middlebury -o confidence.jsonl
    phasestereo bench confidence ~/middlebury \
        --weights rust/match/src/refinement/calibration/weights.rs
    phasestereo bench confidence ~/middlebury -o maps.jsonl --of maps --hitnet hitnet_eth3d.onnx \
        --weights rust/core/src/verification/judge/weights.rs
    ```

    Parameters
    ----------
    folders
        Official folder trees: folders that hold scenes2001, MiddEval3 and so on, or one of these,
        or one scene in it.
    of
        What is learned: what raw confidences of matches mean, or how likely maps of other matchers
        are right (`phasestereo.verify`): those of HITNet and of StereoSGBM, on pairs as they are
        and as `phasestereo.prepare` makes them, and of the preset fast. Ten conditions of each
        scene are judged by weights that were learned without the scene, and without the matcher.
    hitnet
        HITNet's ONNX file for ETH3D, for maps.
    every
        Run every N-th match, for a quick look.
    output
        File for the records.
    weights
        File of Rust to write the weights to.
    """
    with refusals(options=_OPTIONS):
        scenes = choice.select(folders, "confidence")
        if of == "maps":
            network = rivals(hitnet)
            prepared = [f"prepared:{name}" for name in network]
            jobs = claim_jobs(scenes, [*network, *prepared, *_METHODS], every=every)
        else:
            jobs = confidence_jobs(scenes, every=every)
        Suite(
            jobs=jobs,
            cells="pairs" if of == "maps" else "matches",
            names=("scene", "faults"),
            tables=partial(_of_maps if of == "maps" else _of_matches, weights=weights),
        ).run(output, running)


def _of_matches(records: Records, weights: Path | None) -> dict[str, Table | None]:
    learned = learned_weights(records)
    verdicts = {
        preset: held_out(observed_of([one for one in records if one["preset"] == preset]))
        for preset in PRESETS
    }
    if weights is not None:
        write_weights(learned, weights)
    return {preset: verdict_table(several) for preset, several in verdicts.items()}


def _of_maps(records: Records, weights: Path | None) -> dict[str, Table | None]:
    claims = claims_of(records)
    if weights is not None:
        judging.write_weights(judging.learn(claims), weights)
    return {"maps": judging_table(claims, OFTEN)}

"""Commands that run many jobs, keep their records, and print tables of these.

Scenes with known blur, pairs degraded in many ways, frames of rigs, surfaces.
"""

# No `from __future__ import annotations`: the command line is made of these annotations.

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from phasestereo.cli.errors import refusals
from phasestereo_bench.blur import blur_jobs, blur_table, explain_blur
from phasestereo_bench.cli.bench_middlebury import rivals
from phasestereo_bench.cli.bench_runs import AS_USUAL, Records, RunOptions, Suite
from phasestereo_bench.cli.bench_scenes import ALL, SceneChoice
from phasestereo_bench.cli.parameters import (
    RUN,
    SCENES,
    SEVERAL,
    Folders,
    Names,
    Natural,
    Output,
    Positive,
    RecordsFile,
)
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
from phasestereo_bench.real import find_recording, recording_jobs
from phasestereo_bench.report.tables import Table
from phasestereo_bench.surfaces import (
    MEGAPIXELS,
    SEEDS,
    default_methods,
    surface_cases,
    surface_jobs,
    surface_table,
    upsampled_table,
)
from phasestereo_bench.tables.plan import TIMED
from phasestereo_bench.tables.recorded import agreement_table, rows_table

_JUDGED = "opencv:sgbm", "prepared:sgbm", "fast"
"""Whose maps confidences are learned from, beside networks."""


def blur(
    *folders: Folders,
    choice: Annotated[SceneChoice, Parameter(name="*", group=SCENES)] = ALL,
    every: Annotated[Positive, Parameter(group=RUN)] = 1,
    output: RecordsFile = Path("blur.jsonl"),
    running: Annotated[RunOptions, Parameter(name="*", group=RUN)] = AS_USUAL,
) -> None:
    """Blur Middlebury pairs by known kernels, and check whether that blur is found.

    Every scene is tried 109 times: as it is; with the left or the right image blurred by Gaussians,
    disks and motions of many sizes, with noise of 1 or 2 gray levels; and with both images blurred
    alike, which is not a relative blur. Each trial becomes a record in a file of JSON lines as soon
    as it is done. A run that was interrupted goes on where it stopped when the same command is
    given again. For example:

    ```
    phasestereo bench blur ~/middlebury -o blur.jsonl
    phasestereo bench blur ~/middlebury --every 7
    ```

    Parameters
    ----------
    folders
        Official folder trees: folders that hold scenes2001, MiddEval3 and so on, or one of these,
        or one scene in it.
    every
        Run every N-th trial, for a quick look.
    output
        File for the records.
    """
    with refusals(options={"scene", "every"}):
        Suite(
            jobs=blur_jobs(choice.select(folders, "one-sided-blur"), every=every),
            cells="trials",
            names=("family", "size", "scene"),
            tables=lambda good: {"Blur that was found": blur_table(good)},
            words=lambda good: [explain_blur(good)],
            title="Estimating",
        ).run(output, running)


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
    with refusals(options={"scene", "every", "weights", "hitnet"}):
        scenes = choice.select(folders, "confidence")
        if of == "maps":
            network = rivals(hitnet)
            prepared = [f"prepared:{name}" for name in network]
            jobs = claim_jobs(scenes, [*network, *prepared, *_JUDGED], every=every)
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


def recordings(
    *folders: Path,
    method: Names = (),
    hitnet: Path | None = None,
    output: Output = Path("recordings.jsonl"),
    running: Annotated[RunOptions, Parameter(name="*")] = AS_USUAL,
) -> None:
    """Score matchers on raw frames of real rigs, whose depth nobody knows.

    Rows are held against the calibration; every method matches each frame from either side, raw
    and rectified. A run that was interrupted goes on where it stopped. For example:

    ```
    phasestereo bench recordings DATA/rigs/euroc -o recordings.jsonl
    ```

    Parameters
    ----------
    folders
        Of one rig each: its frames (cam0 and cam1, left and right, left*.png and right*.png, or
        pictures of both views) and its calibration, as `phasestereo rectify` takes a folder.
    method
        As of `bench middlebury`. Without it, ours and OpenCV's.
    hitnet
        HITNet's ONNX file for ETH3D: the network takes part, too, if onnxruntime is installed.
    output
        File for the records.
    """
    with refusals(options={"method", "hitnet"}):
        if not folders:
            raise ValueError("no folder given: where are the frames?")

        methods = [*(method or TIMED), *rivals(hitnet)]
        Suite(
            jobs=[j for place in folders for j in recording_jobs(find_recording(place), methods)],
            cells="cells",
            names=("method", "recording"),
            tables=lambda good: {
                "Rows off, px rms: mean, worst frame": rows_table(good),
                "Left and right agree; the method trusts itself": agreement_table(good),
            },
        ).run(output, running)


def surfaces(
    *folders: Folders,
    megapixels: Annotated[tuple[float, ...], SEVERAL, Parameter(group=SCENES)] = MEGAPIXELS,
    seeds: Annotated[Natural, Parameter(group=SCENES)] = SEEDS,
    method: Names = (),
    hitnet: Path | None = None,
    output: RecordsFile = Path("surfaces.jsonl"),
    running: Annotated[RunOptions, Parameter(name="*", group=RUN)] = AS_USUAL,
) -> None:
    """Score matchers on plain, slanted and curved surfaces, and on finer samplings of a scene.

    Rooms with plain walls, tables and things are rendered at several sizes. Folders add scenes
    that are upsampled, scenes with large planes, and real table tops. The table has bad-1 and bad-2
    by kind of pixel, and the share of neighbors in a column that differ by more than 2 px, beside
    that of the truth. It takes about three minutes on one core. For example:

    ```
    phasestereo bench surfaces ~/middlebury ~/planes ~/tabletop
    phasestereo bench surfaces --megapixels 12 --seeds 1 --method robust:num_disparities=auto
    ```

    Parameters
    ----------
    folders
        Official folder trees of Middlebury's scenes, of which Art, Moebius, Aloe and Lampshade1 are
        upsampled; and folders with tabletop/NAME/left.png, right.png and disparity.png. Without
        any, rooms alone.
    megapixels
        Sizes of the rooms; 0.5 and 2 without it. One of 12 takes a minute and a half to render; the
        memory of opencv:sgbm grows with pixels times disparities.
    seeds
        How many rooms of each kind and size.
    method
        What to compare, as of ``phasestereo bench middlebury``; default: ours, nothing given, and
        opencv:sgbm, which is given the range.
    hitnet
        HITNet's ONNX file for ETH3D: the network takes part, too, if onnxruntime is installed.
    output
        File for the records.
    """
    with refusals(options={"megapixels", "seeds", "method", "hitnet"}):
        cases = surface_cases(folders, megapixels=megapixels, seeds=seeds)
        Suite(
            jobs=surface_jobs(cases, [*(method or default_methods()), *rivals(hitnet)]),
            cells="maps",
            names=("method", "scene", "row"),
            tables=lambda good: {
                "Off by more than 1 / 2 px, %; stripes (of the truth), %": surface_table(good),
                "Upsampled scenes at their own scale: bad-1, %": upsampled_table(good),
            },
        ).run(output, running)

"""These commands run many jobs, keep their records, and print tables.

They score scenes with known blur, pairs degraded in many ways, frames of rigs, and surfaces.
"""

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
"""Methods, besides networks, whose maps the confidences are learned from."""


def blur(
    *folders: Folders,
    choice: Annotated[SceneChoice, Parameter(name="*", group=SCENES)] = ALL,
    every: Annotated[Positive, Parameter(group=RUN)] = 1,
    output: RecordsFile = Path("blur.jsonl"),
    running: Annotated[RunOptions, Parameter(name="*", group=RUN)] = AS_USUAL,
) -> None:
    """Blur Middlebury pairs with known kernels, and check whether the estimate finds that blur.

    The command tries every scene 109 times: as it is; with the left or the right image blurred by
    Gaussians, disks and motions of many sizes, with noise of 1 or 2 gray levels; and with both
    images blurred alike, which is not a relative blur. Each trial becomes a record in a file of
    JSON lines as soon as it is done. To continue an interrupted run, give the same command again.
    For example:

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
    """Learn what raw confidences mean, from pairs spoiled in many ways.

    Each preset matches every scene, and some rendered ones, as they are and under faults of the
    suites, one or two in a row: about 1000 matches. A file of JSON lines keeps the error counts of
    each match. To continue an interrupted run, give the same command again. The command judges the
    weights by faults and scenes that they were not learned from. For example:

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
        What to learn: what raw confidences of matches mean, or how likely maps of other matchers
        are right (`phasestereo.verify`): maps of HITNet and of StereoSGBM, on pairs as they are and
        as `phasestereo.prepare` makes them, and of the preset fast. Weights learned without a scene
        and without a matcher judge its maps of ten conditions of that scene.
    hitnet
        HITNet's ONNX file for ETH3D, for maps.
    every
        Run every N-th match, for a quick look.
    output
        File for the records.
    weights
        Rust file to write the weights to.
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
    """Score matchers on raw frames of real rigs, whose depth is unknown.

    The command compares rows with the calibration; every method matches each frame from either
    side, raw and rectified. To continue an interrupted run, give the same command again. For
    example:

    ```
    phasestereo bench recordings DATA/rigs/euroc -o recordings.jsonl
    ```

    Parameters
    ----------
    folders
        One folder per rig, with its frames (cam0 and cam1, left and right, left*.png and
        right*.png, or pictures of both views) and its calibration, as for `phasestereo rectify`.
    method
        Methods, as in `bench middlebury`. Without it, ours and OpenCV's.
    hitnet
        HITNet's ONNX file for ETH3D; the network also takes part if onnxruntime is installed.
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

    The command renders rooms with plain walls, tables and things at several sizes. Folders add
    upsampled scenes, scenes with large planes, and real table tops. The table shows bad-1 and bad-2
    by kind of pixel, and the share of neighbors in a column that differ by more than 2 px, beside
    that of the truth. The command takes about three minutes on one core. For example:

    ```
    phasestereo bench surfaces ~/middlebury ~/planes ~/tabletop
    phasestereo bench surfaces --megapixels 12 --seeds 1 --method robust:num_disparities=auto
    ```

    Parameters
    ----------
    folders
        Official folder trees of Middlebury's scenes (Art, Moebius, Aloe and Lampshade1 are
        upsampled), and folders with tabletop/NAME/left.png, right.png and disparity.png. Without
        any, only rooms.
    megapixels
        Sizes of the rooms. Without it, 0.5 and 2. A room of 12 megapixels takes a minute and a half
        to render; the memory of opencv:sgbm grows with pixels times disparities.
    seeds
        Number of rooms of each kind and size.
    method
        Methods to compare, as in ``phasestereo bench middlebury``; default: ours without a range,
        and opencv:sgbm, which gets the range.
    hitnet
        HITNet's ONNX file for ETH3D; the network also takes part if onnxruntime is installed.
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

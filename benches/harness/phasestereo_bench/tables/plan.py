"""Lists the runs for the tables of the documentation, in order."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from phasestereo_bench.blur import blur_jobs
from phasestereo_bench.cases import SUITE_SCENES, SUITES
from phasestereo_bench.costs import cost_jobs
from phasestereo_bench.datasets import Scene, find_scenes
from phasestereo_bench.middlebury import default_methods, middlebury_jobs
from phasestereo_bench.real import find_recording, real_jobs, recording_jobs
from phasestereo_bench.rigs import QUICK_SCENES
from phasestereo_bench.runner import Job
from phasestereo_bench.surfaces import surface_cases, surface_jobs
from phasestereo_bench.tables.ours import WITHOUT_SYNTHESIS, choice_jobs, rendered_jobs

RECORDINGS = ("rigs/euroc", "rigs/stereopi")
SURFACES = ("middlebury", "planes", "tabletop")
HITNET = "rivals/hitnet_eth3d.onnx"

AUTO = "robust:num_disparities=auto"
"""Our method as a user first calls it: nothing is given, not even a range."""

TIMED = ("fast", "robust", AUTO, "opencv:bm", "opencv:sgbm")
_ALSO_TIMED = ("paper", "opencv:sgbm-3way", "opencv:sgbm-5way")  # methods of the chart of time
SYNTHESIZED = ("gauss 2", "gauss 4", "disk 3", "disk 6", "motion 9", "motion 15", "mixed")
"""Degradations for the comparison with and without synthesis of the blurred image."""

WITH_OURS = ("one-sided-blur", "rigs")
"""Suites where other matchers also get prepared pairs, and are second matchers of ours."""

TIMED_ON = ("scenes2003/cones", "MiddEval3/trainingQ/Motorcycle")
"""The scenes on which time and memory are measured; the first table shows the larger one."""


@dataclass(frozen=True, slots=True)
class JobGroup:
    """Jobs that share a file of records.

    Attributes
    ----------
    name
        Name of the group, and of its file without the ending.
    jobs
        The jobs to run.
    alone
        Whether each job must run alone, because its time counts.
    """

    name: str
    jobs: Sequence[Job]
    alone: bool = False


def job_groups(root: Path, rivals: Sequence[str], *, quick: bool = False) -> list[JobGroup]:
    """Return the groups of jobs.

    Parameters
    ----------
    root
        Folder with ``middlebury``, and if possible ``planes``, ``tabletop``, ``rigs/euroc``,
        ``rigs/stereopi`` and ``real_defocus/breakfast``.
    rivals
        Learned methods that are available.
    quick
        Only the three scenes of `QUICK_SCENES`.

    Raises
    ------
    OSError, ValueError, ImportError
        If the folder holds no scene, or a package is not installed.
    """
    scenes = _scenes(root, "rigs", quick=quick)
    timed = [scene for scene in scenes if str(scene) in TIMED_ON] or scenes[:1]
    ours = [*TIMED, *rivals]

    frames = [
        job
        for place in RECORDINGS
        if (root / place).is_dir()
        for job in recording_jobs(find_recording(root / place), ours)
    ]
    costs = [job for scene in timed for job in cost_jobs(scene, _timed(rivals))]
    found = [
        *(
            JobGroup(suite, middlebury_jobs(own, _methods(suite, rivals), suite=suite))
            for suite in SUITES
            for own in [_scenes(root, suite, quick=quick)]
        ),
        JobGroup("choices", choice_jobs(scenes)),
        JobGroup("synthesis", _synthesis_jobs(scenes)),
        JobGroup("rendered", [] if quick else rendered_jobs(rivals)),
        JobGroup("surfaces", [] if quick else _surface_jobs(root, rivals)),
        JobGroup("blur", blur_jobs(scenes, every=1)),
        JobGroup("real", [*frames, *real_jobs(root, ours)]),
        JobGroup("costs", costs, alone=True),
    ]
    return [group for group in found if group.jobs]


def _scenes(root: Path, suite: str, *, quick: bool) -> list[Scene]:
    wanted = QUICK_SCENES if quick else SUITE_SCENES[suite]
    trees = [root / name for name in ("middlebury", "planes") if (root / name).is_dir()]
    found = [scene for tree in trees for scene in find_scenes(tree)]
    scenes = [scene for scene in found if str(scene) in wanted]
    if not scenes:
        raise ValueError(f"{root / 'middlebury'}: it has none of {', '.join(sorted(wanted))}")
    return scenes


def _surface_jobs(root: Path, rivals: Sequence[str]) -> list[Job]:
    there = [root / name for name in SURFACES if (root / name).is_dir()]
    return surface_jobs(surface_cases(there), [AUTO, "opencv:sgbm", *rivals])


def _synthesis_jobs(scenes: Sequence[Scene]) -> list[Job]:
    suite, methods, sides = "one-sided-blur", ["robust", WITHOUT_SYNTHESIS], ("left", "right")
    return middlebury_jobs(scenes, methods, SYNTHESIZED, suite=suite, sides=sides)


def _methods(suite: str, rivals: Sequence[str]) -> list[str]:
    """Return the jobs of a suite, and of the headline."""
    also = _timed(rivals) if suite == "sharp" else [*TIMED, *rivals]
    if suite in WITH_OURS:
        also += [*_with_ours(rivals), "prepared:opencv:sgbm"]
    return list(dict.fromkeys([*default_methods(suite), *also]))


def _timed(rivals: Sequence[str]) -> list[str]:
    return [*TIMED, *_ALSO_TIMED, *rivals, *_with_ours(rivals)]


def _with_ours(rivals: Sequence[str]) -> list[str]:
    """Return HITNet on prepared pairs, and as a second matcher."""
    networks = [name for name in rivals if name.startswith("hitnet:")]
    return [f"{way}:{name}" for name in networks for way in ("prepared", "fused")]

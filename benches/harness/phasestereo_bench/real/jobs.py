"""Lists the jobs of recordings and of real pairs."""

from collections.abc import Sequence
from pathlib import Path

from phasestereo_bench.methods import method
from phasestereo_bench.real.agreement import score_frame
from phasestereo_bench.real.frames import RigRecording
from phasestereo_bench.real.pairs import find_pairs, score_pair
from phasestereo_bench.real.rows import score_rows
from phasestereo_bench.runner import Job

ROWS, FRAMES, PAIRS = "recording-rows", "recording-frame", "real-pair"
"""The kinds of these records."""


def recording_jobs(recording: RigRecording, methods: Sequence[str]) -> list[Job]:
    """Return the jobs of a recording: the rows of each frame, and each method twice on it."""
    jobs = []
    for files in recording.frames:
        here = {"recording": recording.name, "frame": files[0].stem}
        arguments = {"folder": recording.folder, "files": files}
        jobs.append(Job({"kind": ROWS, **here}, score_rows, arguments))

        for spec in methods:
            name = str(method(spec))
            for rectified in (False, True):
                key = {"kind": FRAMES, **here, "method": name, "rectified": rectified}
                more = {"spec": spec, "rectified": rectified}
                jobs.append(Job(key, score_frame, arguments | more))

    return jobs


def real_jobs(root: Path, methods: Sequence[str]) -> list[Job]:
    """Return the jobs of the real pairs that are below a folder."""
    return [
        Job(
            {"kind": PAIRS, "pair": name, "method": str(method(spec))},
            score_pair,
            {"name": name, "folder": folder, "spec": spec},
        )
        for name, folder in find_pairs(root).items()
        for spec in methods
    ]

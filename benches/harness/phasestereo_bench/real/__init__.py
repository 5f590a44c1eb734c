"""Evidence from real rigs: recordings without a truth of depth, and real pairs that have one.

`frames` finds the pairs of a recording, `rows` holds what is found about their rows against the
calibration, `agreement` asks a matcher twice, `pairs` are those with a truth, and `jobs` puts it
together.
"""

from phasestereo_bench.real.frames import RigRecording, find_recording
from phasestereo_bench.real.jobs import real_jobs, recording_jobs

__all__ = ["RigRecording", "find_recording", "real_jobs", "recording_jobs"]

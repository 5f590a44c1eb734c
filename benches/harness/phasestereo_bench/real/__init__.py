"""Gathers evidence from real rigs: recordings without true depths, and real pairs with them.

`frames` finds the pairs of a recording, `rows` compares the estimates of their rows with the
calibration, `agreement` runs a matcher twice, `pairs` holds pairs with a truth, and `jobs` combines
them.
"""

from phasestereo_bench.real.frames import RigRecording, find_recording
from phasestereo_bench.real.jobs import real_jobs, recording_jobs

__all__ = ["RigRecording", "find_recording", "real_jobs", "recording_jobs"]

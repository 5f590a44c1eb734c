"""Confidence that is a probability: what the core's calibration is learned from, and how it holds.

`observation` matches degraded pairs and counts how far their disparities are off, `learning` fits
the weights to these counts and writes them as the core has them, `verdict` says what they are worth
on faults and scenes that were left out.

`claims` and `judging` do the same for maps of other matchers, which the core judges.
"""

from phasestereo_bench.confidence.claims import OFTEN, claim_jobs
from phasestereo_bench.confidence.judging import claims_of, judging_table
from phasestereo_bench.confidence.learning import learned_weights, write_weights
from phasestereo_bench.confidence.observation import confidence_jobs
from phasestereo_bench.confidence.verdict import held_out, verdict_table

__all__ = [
    "OFTEN",
    "claim_jobs",
    "claims_of",
    "confidence_jobs",
    "held_out",
    "judging_table",
    "learned_weights",
    "verdict_table",
    "write_weights",
]

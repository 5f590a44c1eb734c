"""Confidence as a probability: the data for the core's calibration, and tests of it.

`observation` matches degraded pairs and counts the errors of their disparities, `learning` fits the
weights to these counts and writes them in the core's form, `verdict` tests them on faults and
scenes outside the fit.

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

"""Repeats the paper's experiments on its own pairs, and puts its claims beside our results.

    from phasestereo_bench import paper

    store = Path("out/results.jsonl")
    study = paper.run_study(paper.load_pairs("middlebury"), store)
    paper.write_study(study, store, Path("out"))

`experiments` defines the blurs and the methods, `study` measures, `claims` judges, `page` writes
the results. The paper is Pedone & Heikkilä, *Blur and Contrast Invariant
Fast Stereo Matching*, ACIVS 2008.
"""

from phasestereo_bench.paper.claims import ClaimResult, claims_table, judge_claims
from phasestereo_bench.paper.page import write_study
from phasestereo_bench.paper.study import Pairs, Study, load_pairs, run_study

__all__ = [
    "ClaimResult",
    "Pairs",
    "Study",
    "claims_table",
    "judge_claims",
    "load_pairs",
    "run_study",
    "write_study",
]

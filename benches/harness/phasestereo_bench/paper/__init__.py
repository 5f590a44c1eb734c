"""The paper's experiments on its own pairs: its figures again, its claims beside what comes out.

    from phasestereo_bench import paper

    pairs = paper.load_pairs("middlebury")
    study = paper.run_study(pairs, Path("out/results.jsonl"))
    paper.write_study(study, pairs, Path("out/results.jsonl"), Path("out"))

`experiments` says what is blurred and how much, `methods` and `choices` which settings take part,
`cells` measures, `study` puts these together; `claims` judges, `reasons` explains, and `exhibit`
writes it all down. The paper is Pedone & Heikkilä, *Blur and Contrast Invariant Fast Stereo
Matching*, ACIVS 2008.
"""

from phasestereo_bench.paper.cells import Pairs, load_pairs
from phasestereo_bench.paper.exhibit import write_study
from phasestereo_bench.paper.study import Study, run_study
from phasestereo_bench.paper.wording import Claim, Finding, claims

__all__ = [
    "Claim",
    "Finding",
    "Pairs",
    "Study",
    "claims",
    "load_pairs",
    "run_study",
    "write_study",
]

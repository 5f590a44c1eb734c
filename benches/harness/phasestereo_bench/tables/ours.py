"""Makes tables of the value of our choices, and of rendered pairs that no choice was made on."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from statistics import fmean
from typing import Any

from phasestereo_bench.datasets import Pair, Scene
from phasestereo_bench.methods import method
from phasestereo_bench.middlebury import middlebury_jobs, wrong_shares
from phasestereo_bench.rendering import render_pair
from phasestereo_bench.report.tables import MISSING, Table
from phasestereo_bench.runner import Job

Record = Mapping[str, Any]

RENDERED = "rendered"
"""The kind of the records of rendered pairs."""

CHOICES = (
    "robust",
    "robust:sizes=1",
    "robust:neighborhood=5",
    "robust:window=7",
    "robust:noise_threshold=0",
    "robust:noise_threshold=0.35",
    "robust:noise_threshold=0.7",
    "robust:denoise=false",
    "robust:despike=false",
    "robust:compensate_blur=false",
    "robust:synthesis=false",
    "robust:p1=5,p2=20",
    "robust:p1=7,p2=28",
    "robust:p1=4,p2=24",
    "robust:p1=5,p2=32",
    "robust:adaptive_p2=0",
    "robust:adaptive_p2=0.5",
    "robust:adaptive_p2=2",
    "robust:subpixel=false",
    "robust:guided_median=false",
    "robust:median=0",
    "robust:speckle_size=0",
    "robust:lr_check=none,speckle_size=0",
    "fast",
    "fast:neighborhood=7",
    "fast:window=7",
    "fast:p1=3,p2=12",
    "fast:p1=4,p2=16",
    "fast:adaptive_p2=0",
    "fast:adaptive_p2=1",
    "fast:median=0",
)
"""The presets, and variants of each with one setting changed."""

COLUMNS = {
    "sharp": "sharp",
    "gauss 2": "one-sided-blur",
    "disk 3": "one-sided-blur",
    "noise 5": "rigs",
    "jpeg 70": "rigs",
}
"""The degradation of the pairs, and its suite."""

WITHOUT_SYNTHESIS = "robust:synthesis=false"

SEEDS = range(100, 110)
"""Seeds of the rendered pairs, on which no choice was made."""

_SIZE = {"height": 360, "width": 480, "num_disparities": 64}
ON_RENDERED = (
    "robust",
    "opencv:sgbm-3x3",
    "opencv:sgbm",
    "robust:sizes=1",
    "robust:sizes=1,denoise=false",
)


def choice_jobs(scenes: Sequence[Scene]) -> list[Job]:
    """Return the jobs of `choice_table`: every preset as it is, and with one setting changed."""
    return [
        job
        for name, suite in COLUMNS.items()
        for job in middlebury_jobs(scenes, CHOICES, [name], suite=suite)
    ]


def choice_table(records: Sequence[Record]) -> Table:
    """Return settings x degradations: bad-1.0 in %, means over the scenes."""
    found: dict[tuple[str, str], list[float]] = {}
    for record in (one for one in records if one["status"] == "ok"):
        cell = record["method"], record["degradation"]
        found.setdefault(cell, []).append(record["v2"]["nonocc"])

    rows = [
        (one, *(_mean(found.get((one, name), []), digits=2) for name in COLUMNS)) for one in CHOICES
    ]
    return Table.of(("settings", *COLUMNS), rows)


def rendered_jobs(rivals: Sequence[str]) -> list[Job]:
    """Return the jobs of the rendered pairs."""
    return [
        Job(
            {"kind": RENDERED, "seed": seed, "method": str(method(spec))},
            score_rendered,
            {"seed": seed, "spec": spec},
        )
        for seed in SEEDS
        for spec in (*ON_RENDERED, *rivals)
    ]


def score_rendered(seed: int, spec: str) -> dict[str, float]:
    """Match a rendered pair and return the shares of wrong pixels, %."""
    return wrong_shares(_rendered(seed), spec)


def rendered_table(records: Sequence[Record]) -> Table:
    """Return methods x bad-1.0 and bad-2.0, means over the rendered pairs."""
    rows = []
    for name in dict.fromkeys(record["method"] for record in records):
        own = [record for record in records if record["method"] == name]
        rows.append((name, *(_mean([one[bad] for one in own]) for bad in ("bad_1", "bad_2"))))
    return Table.of(("method", "bad-1.0", "bad-2.0"), rows)


def synthesis_table(records: Sequence[Record], names: Sequence[str]) -> Table:
    """Return side and synthesis (with or without) x degradations; last the mean of the blurs."""
    rows = []
    blurs = [name for name in names if name != "mixed"]

    for side in ("left", "right"):
        for spec, words in ((WITHOUT_SYNTHESIS, ", synthesis=False"), ("robust", "")):
            mine = [r for r in records if (r["side"], r["method"]) == (side, spec)]
            means = [
                _mean([r["v2"]["nonocc"] for r in mine if r["degradation"] in group])
                for group in (*([name] for name in names), blurs)
            ]
            rows.append((f"{side} image blurred{words}", *means))

    return Table.of(("", *names, "mean of the blurs"), rows)


@lru_cache(1)
def _rendered(seed: int) -> Pair:
    return render_pair(seed, **_SIZE)


def _mean(values: Sequence[float], *, digits: int = 1) -> str:
    return f"{fmean(values):.{digits}f}" if values else MISSING

"""What the page says of claims, cases and levels, in words made from the figures."""

from __future__ import annotations

from statistics import median
from typing import TYPE_CHECKING, NamedTuple

from phasestereo_bench.paper.claims import (
    FLAT,
    GAIN,
    WAYS,
    better_in_all_cases,
    cases,
    flat_in_bits,
    flatness,
    gains_at_larger_blurs,
)
from phasestereo_bench.paper.reasons import reasons

if TYPE_CHECKING:
    from collections.abc import Sequence

    from phasestereo_bench.paper.claims import Case, Flatness, Verdict
    from phasestereo_bench.paper.readings import Reading

__all__ = ["Claim", "Finding", "Shortfall", "claims", "name_of", "shortfalls", "span"]

_PROTOCOL_NAMES = {"tied": "tied to the blur, L = 4 sigma + 1", "fixed": "fixed by the sharp pair"}


class Finding(NamedTuple):
    """What became of a claim: by which settings, the verdict, and the figures it rests on."""

    way: str
    verdict: Verdict
    holds_at: str
    text: str


class Claim(NamedTuple):
    """A claim of the paper, in short and in its words, and what became of it."""

    name: str
    quote: str
    findings: list[Finding]


class Shortfall(NamedTuple):
    """A case in which claims do not hold: its name, and by levels the likely reasons."""

    name: str
    reasons: list[tuple[str, str]]


def claims(readings: Sequence[Reading]) -> list[Claim]:
    """Return the three claims of the paper with what was found."""
    found = {way.name: cases(readings, way) for way in WAYS}
    lines = {
        name: [each for each in flatness(readings) if each.protocol == protocol]
        for protocol, name in _PROTOCOL_NAMES.items()
    }
    return [
        Claim(
            "better in all cases",
            "In all the cases considered the proposed method performed relatively better",
            [_better(name, each) for name, each in found.items()],
        ),
        Claim(
            f"{GAIN:g} to 9 points in many cases at larger blurs",
            "significant improvements in quality occurred mostly for larger amounts of blur, when "
            "our method produced in many cases error percentages between 5 and 9 percent better "
            "than SAD",
            [_gains(name, each) for name, each in found.items()],
        ),
        Claim(
            "flat in b",
            "the percentage of bad pixels in the final depth-maps is fairly constant, and this "
            "justifies the use of the smallest values for b",
            [_flat(name, each) for name, each in lines.items()],
        ),
    ]


def shortfalls(readings: Sequence[Reading], found: Sequence[Case]) -> list[Shortfall]:
    """Return the cases in which claims do not hold, with the likely reasons."""
    every = []
    for case in found:
        told = [
            (f"{case.experiment.symbol} = {span(reason.levels, case.levels)}", reason.text)
            for reason in reasons(case, readings)
        ]
        if told:
            every.append(Shortfall(name_of(case), told))
    return every


def name_of(case: Case) -> str:
    """Return the name of a case."""
    return f"{case.scene.title()}, {case.experiment.title}"


def span(levels: Sequence[float], among: Sequence[float]) -> str:
    """Return levels as text, such as "3 to 9, 13", where `among` are all that there are."""
    at = [among.index(level) for level in sorted(levels)]
    starts = [i for i in at if i - 1 not in at]
    ends = [i for i in at if i + 1 not in at]
    return ", ".join(
        f"{among[start]:g}" if start == end else f"{among[start]:g} to {among[end]:g}"
        for start, end in zip(starts, ends, strict=True)
    )


def _better(way: str, found: Sequence[Case]) -> Finding:
    gains = [gain for case in found for gain in case.gains.values()]
    over_best = [gain for case in found for gain in case.gains_over_best.values()]
    whole = sum(case.is_better_throughout for case in found)
    count = f"{sum(gain > 0 for gain in gains)} of {len(gains)} levels"
    text = (
        f"better than the paper's rival at {count}, and throughout in {whole} of {len(found)} "
        f"cases; better than both SAD and normalised SAD at {sum(gain > 0 for gain in over_best)}; "
        f"by {median(gains):+.1f} points in the median, from {min(gains):+.1f} to "
        f"{max(gains):+.1f}"
    )
    return Finding(way, better_in_all_cases(found), count, text)


def _gains(way: str, found: Sequence[Case]) -> Finding:
    gains = [gain for case in found for gain in case.larger_gains.values()]
    much = sum(gain >= GAIN for gain in gains)
    count = f"{much} of {len(gains)} levels"
    text = (
        f"{GAIN:g} points or more at {count} with larger blurs, and at half of them or more in "
        f"{sum(case.gains_much for case in found)} of {len(found)} cases; {median(gains):+.1f} "
        f"points in the median, from {min(gains):+.1f} to {max(gains):+.1f}"
    )
    return Finding(way, gains_at_larger_blurs(found), count, text)


def _flat(way: str, found: Sequence[Flatness]) -> Finding:
    flat = sum(each.spread <= FLAT for each in found)
    count = f"{flat} of {len(found)} lines"
    text = f"{count} spread over {FLAT:g} points or less"
    for each in found:
        if each.spread > FLAT:
            where = f"{each.scene.title()} at sigma = {each.sigma:g}"
            text += f"; {where} spreads over {each.spread:.1f}: {_why(each)}"
    return Finding(way, flat_in_bits(found), count, text)


def _why(line: Flatness) -> str:
    """Say why a line of Figure 3 is not flat."""
    if line.spread_from_two <= FLAT:
        return (
            "that is b = 1, which keeps but a sign of each component, too little where the blur "
            f"leaves little (from b = 2 on {line.spread_from_two:.1f})"
        )
    return (
        "L does not hold the blur, and finer phases of noise are more noise "
        f"(from b = 2 on {line.spread_from_two:.1f})"
    )

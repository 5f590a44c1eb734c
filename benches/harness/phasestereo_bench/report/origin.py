"""Explains in words where numbers come from."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import starmap
from typing import Any

from phasestereo_bench.report.cells import METRICS
from phasestereo_bench.report.results import Results, knows_blur
from phasestereo_bench.report.tables import means, scene_count


def explain(results: Results, metric: str) -> str:
    """Explain the figures of a table, and which of them are bold."""
    scenes = scene_count(results, metric) or "the scenes that all methods have"
    best = " without true blur" if any(map(knows_blur, results.methods)) else ""
    return _explained(results, metric, scenes, best)


def explain_faults(results: Results, metric: str) -> str:
    """Explain the figures of `tables.fault_table`."""
    count = min(means(results, metric, (name,)).scenes for name in results.degradations)
    return _explained(results, metric, f"{count} scenes")


def _explained(results: Results, metric: str, scenes: str, best: str = "") -> str:
    title = METRICS[metric].label
    return (
        f"{title[0].upper()}{title[1:]}: {METRICS[metric].better}. Means over {scenes}, "
        f"{results.state}. Bold: the best{best}.{left_out(results, metric)}"
    )


def left_out(results: Results, metric: str) -> str:
    """Name the scenes that means leave out, and the methods without them, if any."""
    lacking = []
    for method in results.methods:
        rows = [row for row in results.degradations if results.values(metric, method, row)]
        absent = [
            place.scene
            for place in results.counted
            if any(place not in results.values(metric, method, row) for row in rows)
        ]
        lacking += [f"{method} is without {', '.join(absent)}"] if absent else []

    missing = f" Left out of means, for not all methods have them: {'; '.join(lacking)}."
    others = [place.scene for place in results.places if place not in results.counted]
    beyond = f" Not of the suite, and in no mean: {', '.join(others)}."
    return missing * bool(lacking) + beyond * bool(others)


def made_with(environments: Iterable[Mapping[str, Any]]) -> str:
    """Name the software and the machines, once if they differ only in date."""
    alike: dict[str, list[Mapping[str, Any]]] = {}
    for known in environments:
        alike.setdefault(_environment(known), []).append(known)

    return "Made with " + "; ".join(starmap(_in_words, alike.items())) + "."


def _environment(known: Mapping[str, Any]) -> str:
    """Return our version and the processor; results.json has all versions."""
    versions = known.get("versions")
    if not isinstance(versions, dict):
        return "versions that are not known"

    ours = versions.get("phasestereo")
    return f"phasestereo {ours} on {known.get('cpu')}"


def _in_words(environment: str, alike: Sequence[Mapping[str, Any]]) -> str:
    """Add the dates."""
    dates = sorted({str(known["date"]) for known in alike if known.get("date")})
    days = f", {' to '.join(dict.fromkeys((dates[0], dates[-1])))}" if dates else ""
    return environment + days

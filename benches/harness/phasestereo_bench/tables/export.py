"""Exports the numbers behind the tables as one JSON file for programs."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from phasestereo.io.drafts import replace_text
from phasestereo_bench.report.results import Results
from phasestereo_bench.surfaces.results import shares_by_kind
from phasestereo_bench.tables.headline import headline_values
from phasestereo_bench.tables.texts import read_records, read_suites

FORMAT = 1
_METRICS = {"bad_1": "v2.nonocc", "bad_2": "v3.bad_2"}
_DIGITS = 3
_LEAF = re.compile(r"[\[{][^\[\]{}]+[\]}]")  # a list or an object of plain values alone
_LEFT_OUT = ("kind", "status", "environment", "seconds", "peak_bytes", "error", "traceback")


def export(folder: Path, path: Path) -> None:
    """Write the numbers of a folder of records; the same records give the same bytes.

    Numbers without records in the folder stay as they are in the file.

    The file has ``"format"``, 1; ``"environments"`` of all runs; ``"headline"``, means of the first
    table by column and method; ``"suites"`` by name: ``"side"``, ``"scenes"`` and ``"bad_1"`` and
    ``"bad_2"``, shares of non-occluded pixels that are more than 1 and 2 px off, %, by degradation
    and method, one number a scene, null if unknown; ``"recordings"`` and ``"pairs"``, a record for
    each; ``"costs"``, seconds and bytes of each processor, those of the last one at the end;
    ``"surfaces"``: the shares of pixels that are more than 1 px off, %, by row, method and kind.

    Raises
    ------
    OSError, ValueError
        If a file cannot be read or written.
    """
    suites = read_suites(folder)
    environments: dict[str, Any] = {}
    for results in suites.values():
        environments |= dict(results.environments)

    real: dict[str, list[dict[str, Any]]] = {"recordings": [], "pairs": []}
    records, seen_in = read_records(folder, "real")
    for record in records:
        numbers = {key: value for key, value in record.items() if key not in _LEFT_OUT}
        real["pairs" if "pair" in record else "recordings"].append(_rounded(numbers))

    costs, timed_in = read_records(folder, "costs")
    environments |= {known["id"]: known for known in (*seen_in, *timed_in)}

    surfaces, _ = read_records(folder, "surfaces")
    found = {
        "headline": _rounded(headline_values(suites)),
        **real,
        "surfaces": _rounded(shares_by_kind(surfaces)),
    }

    earlier = json.loads(path.read_text("utf-8")) if path.exists() else {}
    known = {each["id"]: each for each in earlier.get("environments", ())}
    cpus = {name: each["cpu"] for name, each in (known | environments).items()}
    timed = {
        (cost["scene"], cost["degradation"], cost["method"], cpus[cost["environment"]]): cost
        for cost in (*earlier.get("costs", ()), *costs)
    }
    content = {
        "format": FORMAT,
        "environments": list((known | environments).values()),
        **{name: new or earlier.get(name, new) for name, new in found.items()},
        "costs": list(timed.values()),
        "suites": _merged(earlier.get("suites", {}), {n: _suite(one) for n, one in suites.items()}),
    }

    replace_text(path, _readable(content))


def _merged(earlier: Mapping[str, Any], suites: Mapping[str, Any]) -> dict[str, Any]:
    """Keep earlier numbers of methods that left a suite of the same scenes."""
    for name, suite in suites.items():
        if earlier.get(name, {}).get("scenes") == suite["scenes"]:
            for metric in _METRICS:
                for row, methods in suite[metric].items():
                    suite[metric][row] = earlier[name][metric].get(row, {}) | methods
    return {**earlier, **suites}


def _suite(results: Results) -> dict[str, Any]:
    metrics = {
        name: {
            row: {
                method: [found.get(place) for place in results.counted]
                for method in results.methods
                for found in [_rounded(results.values(metric, method, row))]
                if found
            }
            for row in results.degradations
        }
        for name, metric in _METRICS.items()
    }

    return {"side": results.side, "scenes": [str(place) for place in results.counted], **metrics}


def _rounded(numbers: Mapping[Any, Any]) -> dict[Any, Any]:
    return {
        key: _rounded(value)
        if isinstance(value, dict)
        else round(value, _DIGITS)
        if isinstance(value, float)
        else value
        for key, value in numbers.items()
    }


def _readable(content: Mapping[str, Any]) -> str:
    """Return JSON with each list or object of plain values on one line, so changes are readable."""
    text = json.dumps(content, indent=1, allow_nan=False)
    return _LEAF.sub(lambda found: " ".join(found[0].split()), text) + "\n"

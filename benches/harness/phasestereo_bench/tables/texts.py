"""Markdown for every marker that the documentation has, from the files of records."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from phasestereo_bench.blur import blur_table, explain_blur
from phasestereo_bench.cases import SUITES
from phasestereo_bench.report import read_results
from phasestereo_bench.report.documents import document_texts, small_print
from phasestereo_bench.report.markdown import markdown_table
from phasestereo_bench.report.origin import made_with
from phasestereo_bench.speed import explain_speed, memory_table, time_table
from phasestereo_bench.store import read_good
from phasestereo_bench.surfaces import surface_table, upsampled_table
from phasestereo_bench.tables.headline import cost_table, headline_table
from phasestereo_bench.tables.ours import choice_table, rendered_table, synthesis_table
from phasestereo_bench.tables.plan import SYNTHESIZED
from phasestereo_bench.tables.recorded import agreement_table, pairs_table, rows_table

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from phasestereo_bench.report.results import Results
    from phasestereo_bench.report.tables import Table

    Record = dict[str, Any]

_WORDS = {
    "headline": "Bad-1.0, non-occluded pixels, %: less is better. Means over {scenes} Middlebury "
    "scenes, one or both images of which were made worse as the column says. Bold: the best. "
    "s / MP and MB: of the sharp Motorcycle pair on one thread, per megapixel, and the rise of the "
    "memory; of OpenCV's matchers with the images continued, so that they answer for all columns.",
    "costs": "Medians of 3 matches, {size}, one thread, nothing else running. MB: the rise of the "
    "peak of the resident memory over that of a process that has matched a small pair, of the "
    "sharp pair.",
    "recordings-rows": "Rows off, px, root mean square over the image: mean over the frames, and "
    "the worst. The calibration is the truth; the last column is what is measured of the pair that "
    "it rectifies.",
    "recordings": "Agreement: share of the pixels whose disparity a second match, from the right "
    "image, confirms within 1 px. Trusted: share with a confidence of at least 0.5, of methods "
    "that have one. Means over the frames ± their spread. More is better.",
    "choices": "Bad-1.0, non-occluded pixels, %: less is better. Means over the scenes; one thing "
    "at a time is changed.",
    "rendered": "Bad-1.0 and bad-2.0, non-occluded pixels, %: less is better. Means over ten "
    "rendered pairs.",
    "synthesis": "Bad-1.0, non-occluded pixels, %: less is better. Means over the scenes.",
    "surfaces": "Bad-1.0 / bad-2.0, non-occluded pixels, %, means over the scenes that have at "
    "least 100 pixels of the kind: less is better. Plain: without texture. Flat, slanted, near an "
    "edge (within 2 px of a jump of more than 2 px), thin (narrower than 2 % of the width) and "
    "curved pixels are apart. Stripes: share of neighbors in a column that differ by more than 2 "
    "px, and that of the truth. Real table tops: of the sensor's own map, so only bad-2.0 counts.",
    "surfaces-upsampled": "Bad-1.0, non-occluded pixels, %, at the scale of the scenes as they "
    "are: less is better. Last the scene that loses most.",
    "real-pairs": "Bad-1.0, %: less is better. Bold: the best. Exposure: MotorcycleE. Focus: "
    "breakfast, one image focused far and one near, moved by 16 px.",
}


def read_suites(folder: Path) -> dict[str, Results]:
    """Return the results of the suites whose files of records are in a folder.

    Raises
    ------
    OSError, ValueError
        As `phasestereo_bench.report.read_results`.
    """
    files = {suite: folder / f"{suite}.jsonl" for suite in SUITES}
    return {suite: read_results([file]) for suite, file in files.items() if file.is_file()}


def read_records(folder: Path, group: str) -> tuple[list[Record], list[Record]]:
    """Return the good records of a group, and their environments; see `read_good`."""
    file = folder / f"{group}.jsonl"
    return read_good(file) if file.is_file() else ([], [])


def table_texts(folder: Path) -> dict[str, str]:
    """Return the tables of all that a folder has records of, by the names of their markers.

    Raises
    ------
    OSError, ValueError
        If a file cannot be read.
    """
    suites = read_suites(folder)

    texts: dict[str, str] = {}
    for results in suites.values():
        texts |= document_texts(results)

    costs, timed_in = read_records(folder, "costs")
    real, seen_in = read_records(folder, "real")

    if suites:
        scenes = min(len(results.counted) for results in suites.values())
        ran_in: list[Mapping[str, Any]] = [
            known for found in suites.values() for known in found.environments.values()
        ]
        words = _WORDS["headline"].format(scenes=scenes)
        texts["headline"] = _text(headline_table(suites, costs), words, [*ran_in, *timed_in])

    if costs:
        sizes = sorted({record["pixels"] for record in costs})
        megapixels = " and ".join(f"{pixels / 1e6:.2f}" for pixels in sizes)
        words = _WORDS["costs"].format(size=f"{megapixels} megapixels")
        texts["costs"] = _text(cost_table(costs), words, timed_in)

    if real:
        tables = {
            "recordings-rows": rows_table(real),
            "recordings": agreement_table(real),
            "real-pairs": pairs_table(real),
        }
        texts |= {name: _text(table, _WORDS[name], seen_in) for name, table in tables.items()}

    return texts | _own(folder) | _surfaces(folder) | _others(folder)


def _own(folder: Path) -> dict[str, str]:
    """Return the tables of what choices of ours are worth."""
    tables: dict[str, Callable[[Sequence[Record]], Table]] = {
        "choices": choice_table,
        "rendered": rendered_table,
        "synthesis": partial(synthesis_table, names=SYNTHESIZED),
    }
    texts = {}

    for name, make in tables.items():
        records, ran_in = read_records(folder, name)
        if records:
            texts[name] = _text(make(records), _WORDS[name], ran_in)

    return texts


def _surfaces(folder: Path) -> dict[str, str]:
    """Return the tables of the suite of surfaces."""
    records, ran_in = read_records(folder, "surfaces")
    tables = {
        "surfaces": surface_table(records) if records else None,
        "surfaces-upsampled": upsampled_table(records),
    }
    return {
        name: _text(table, _WORDS[name], ran_in)
        for name, table in tables.items()
        if table is not None
    }


def _others(folder: Path) -> dict[str, str]:
    """Return the table of blurs, and those of times and memory, which stand together."""
    texts = {}
    records, ran_in = read_records(folder, "blur")
    if records:
        texts["blur"] = _text(blur_table(records), explain_blur(records), ran_in)

    records, ran_in = read_records(folder, "speed")
    if records:
        memory = _text(memory_table(records), explain_speed(records), ran_in)
        texts["speed"] = f"{markdown_table(time_table(records))}\n\n{memory}"

    return texts


def _text(table: Table, words: str, environments: Sequence[Mapping[str, Any]]) -> str:
    known = {environment["id"]: environment for environment in environments}
    return f"{markdown_table(table)}\n\n{small_print(f'{words} {made_with(known.values())}')}"

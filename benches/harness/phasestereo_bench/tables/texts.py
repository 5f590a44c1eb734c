"""Makes Markdown for every marker of the documentation, from the files of records."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from phasestereo_bench.blur import blur_table, explain_blur
from phasestereo_bench.cases import SUITES
from phasestereo_bench.report.documents import document_texts, small_print
from phasestereo_bench.report.markdown import markdown_table
from phasestereo_bench.report.origin import made_with
from phasestereo_bench.report.results import Results, read_results
from phasestereo_bench.report.tables import Table
from phasestereo_bench.speed import explain_speed, memory_table, time_table
from phasestereo_bench.store import read_good
from phasestereo_bench.surfaces import surface_table, upsampled_table
from phasestereo_bench.tables.headline import cost_table, headline_table
from phasestereo_bench.tables.ours import choice_table, rendered_table, synthesis_table
from phasestereo_bench.tables.plan import SYNTHESIZED
from phasestereo_bench.tables.recorded import agreement_table, pairs_table, rows_table

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
    """Return the tables of all records in a folder, by the names of their markers.

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
    if suites:
        scenes = min(len(results.counted) for results in suites.values())
        known = [one for found in suites.values() for one in found.environments.values()]
        words = _WORDS["headline"].format(scenes=scenes)
        texts["headline"] = _text(headline_table(suites, costs), words, [*known, *timed_in])

    for group, tables in _TABLES.items():
        records, ran_in = read_records(folder, group)
        for name, make in tables.items() if records else ():
            table = make(records)
            if table is not None:
                words = explain_blur(records) if name == "blur" else _WORDS[name]
                times = ran_in if group == "costs" else ()
                texts[name] = _text(table, words.format(size=_sizes(costs)), times)

    records, ran_in = read_records(folder, "speed")
    if records:
        memory = _text(memory_table(records), explain_speed(records), ran_in)
        texts["speed"] = f"{markdown_table(time_table(records))}\n\n{memory}"

    return texts


_TABLES: dict[str, dict[str, Callable[[Sequence[Record]], Table | None]]] = {
    "costs": {"costs": cost_table},
    "real": {
        "recordings-rows": rows_table,
        "recordings": agreement_table,
        "real-pairs": pairs_table,
    },
    "choices": {"choices": choice_table},
    "rendered": {"rendered": rendered_table},
    "synthesis": {"synthesis": partial(synthesis_table, names=SYNTHESIZED)},
    "surfaces": {"surfaces": surface_table, "surfaces-upsampled": upsampled_table},
    "blur": {"blur": blur_table},
}
"""The functions that turn the records of a group into its tables, by the names of their markers."""


def _sizes(costs: Sequence[Record]) -> str:
    """Return the sizes of the timed pairs."""
    sizes = sorted({record["pixels"] for record in costs})
    return " and ".join(f"{pixels / 1e6:.2f}" for pixels in sizes) + " megapixels"


def _text(table: Table, words: str, timed_in: Sequence[Mapping[str, Any]]) -> str:
    """Return a table and its text; name the machines if the table has times."""
    known = {environment["id"]: environment for environment in timed_in}
    made = f" {made_with(known.values())}" if known else ""
    return f"{markdown_table(table)}\n\n{small_print(words + made)}"

"""Writes the files for benchmark sites, for scenes with and without a truth.

A row of `SITES` holds the demands of a site; the files of one site and size become one zip.
"""

import re
import zipfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from phasestereo.io import write_disparity
from phasestereo.io.drafts import replacing
from phasestereo_bench.datasets import Scene
from phasestereo_bench.methods import method as method_of
from phasestereo_bench.middlebury import matched_pair

_NAME = re.compile(r"[A-Za-z0-9_-]+")


@dataclass(frozen=True, slots=True)
class Site:
    """The files that a benchmark takes.

    Attributes
    ----------
    collection
        Pattern of its collections; the first group, if any, is the size.
    scenes
        Number of scenes in a whole submission, by part; one part is enough.
    disparity, time
        Files of a scene below the root of the zip, with {part}, {scene}, {name}; for Middlebury's
        sparse maps, which leave pixels out, "_s" follows the name.
    seconds
        Contents of the file of the time.
    """

    collection: str
    scenes: tuple[int, ...]
    disparity: str
    time: str | None = None
    seconds: str = "{seconds:.4f}"


SITES = {
    "MiddEval3": Site(
        r"MiddEval3/(?:training|test)([QHF])",
        (15, 30),
        "{part}/{scene}/disp0{name}{sparse}.pfm",
        "{part}/{scene}/time{name}.txt",
    ),
    "ETH3D": Site(
        r"two_view_(?:training|test)",
        (27, 47),
        "low_res_two_view/{scene}.pfm",
        "low_res_two_view/{scene}.txt",
        "runtime {seconds:.4f}",
    ),
    "KITTI2012": Site("kitti2012/testing", (195,), "{scene}.png"),
    "KITTI2015": Site("kitti2015/testing", (200,), "disp_0/{scene}.png"),
}
"""The benchmarks by name."""


def submit(
    scenes: Sequence[Scene],
    method: str,
    name: str,
    output: Path,
    *,
    progress: Callable[[int, int], object] | None = None,
) -> tuple[dict[Path, int], list[str]]:
    """Match scenes, one after the other, and write the files that their sites take.

    Parameters
    ----------
    scenes
        As `phasestereo_bench.datasets.find_scenes` returns them.
    method
        As `phasestereo_bench.method` takes it.
    name
        Name of the method on the site: letters, digits, - and _.
    output
        Folder for the files, and for one zip per site and size.
    progress
        Called as ``progress(done, total)``.

    Returns
    -------
    tuple
        The number of scenes in each zip, and messages: on scenes that were left out, and on sites
        that take more scenes.

    Raises
    ------
    OSError, TypeError, ValueError
        If an argument is wrong, a scene cannot be read, a method returns no map, or no site takes
        any of the scenes.
    """
    if not _NAME.fullmatch(name):
        raise ValueError(f"name: got {name!r}; accepts letters, digits, - and _")
    entrant = method_of(method)
    sites = {scene: _site_of(scene) for scene in scenes}
    taken = [(scene, *site) for scene, site in sites.items() if site is not None]
    if not taken:
        raise ValueError(f"no scene of {', '.join(SITES)} among {', '.join(map(str, scenes))}")

    counts = Counter(title for _, title, _ in taken)
    files: dict[str, dict[str, Path]] = {title: {} for title in counts}
    for done, (scene, title, site) in enumerate(taken, start=1):
        found = matched_pair(entrant, scene.load())
        words = {
            "part": scene.collection.rpartition("/")[2],
            "scene": scene.name,
            "name": name,
            "sparse": "_s" * bool(np.isnan(found.disparity).any()),
        }
        path = _file(output / title, site.disparity.format(**words), files[title])
        write_disparity(path, found.disparity.astype(np.float32))
        if site.time is not None:
            path = _file(output / title, site.time.format(**words), files[title])
            path.write_text(site.seconds.format(seconds=found.seconds), "ascii")
        if progress is not None:
            progress(done, len(taken))

    for title, own in files.items():
        with replacing(output / f"{title}.zip") as file, zipfile.ZipFile(file, "w", 8) as archive:
            for inside, path in own.items():
                archive.write(path, inside)

    left_out = [str(scene) for scene, site in sites.items() if site is None]
    said = [f"left out, no site takes them: {', '.join(left_out)}"] if left_out else []
    for title, count in counts.items():
        whole = SITES[title.partition("-")[0]].scenes
        if count not in whole:
            said.append(f"{title}: {count} scenes; the site takes {' or '.join(map(str, whole))}")
    return {output / f"{title}.zip": count for title, count in counts.items()}, said


def _site_of(scene: Scene) -> tuple[str, Site] | None:
    """Return the title and the contents of a scene's zip; None if no site takes the scene."""
    fits = (re.fullmatch(site.collection, scene.collection) for site in SITES.values())
    found = zip(SITES, SITES.values(), fits, strict=True)
    return next(
        (("-".join([title, *fit.groups()]), site) for title, site, fit in found if fit), None
    )


def _file(folder: Path, inside: str, files: dict[str, Path]) -> Path:
    """Return the path of a file of a zip; make its folder."""
    files[inside] = folder / inside
    files[inside].parent.mkdir(parents=True, exist_ok=True)
    return files[inside]

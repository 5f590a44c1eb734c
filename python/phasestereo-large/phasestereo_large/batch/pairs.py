"""Find pairs in lists (CSV files), and in folders with the layout of data sets."""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import TextIOWrapper
from pathlib import Path
from typing import TextIO

from phasestereo.io import read_calibration
from phasestereo.io.files import StrPath, open_regular
from phasestereo.io.folders import paths_of_rig
from phasestereo.io.limits import LIST
from phasestereo.result import LAYERS

_NEEDED = ("left", "right")
_LISTED = "list the pairs in a CSV file with columns left and right"
_COLUMNS = (*_NEEDED, "name", "num_disparities", "min_disparity", "left_mask", "right_mask")
_LONGEST = 200  # bytes of a name: with a suffix it must fit the limit of file systems
_LONGEST_LINE = 2**16  # characters of a line
_CONTROL = re.compile(r"[\0-\x1f\x7f-\x9f]")


@dataclass(frozen=True, slots=True, kw_only=True)
class PairFiles:
    """A pair of image files to match.

    Parameters
    ----------
    name
        Name of its result, without a suffix; unique within a run.
    left, right
        The files of its images.
    num_disparities, min_disparity
        The disparities to search; None: find them in the images.
    left_mask, right_mask
        Images with non-zero values at valid pixels; None: all are valid.
    """

    name: str
    left: Path
    right: Path
    num_disparities: int | None = None
    min_disparity: int = 0
    left_mask: Path | None = None
    right_mask: Path | None = None

    @property
    def files(self) -> list[Path]:
        """The files to read."""
        given = self.left, self.right, self.left_mask, self.right_mask
        return [file for file in given if file is not None]


def read_pairs(
    source: StrPath, *, num_disparities: int | None = None, min_disparity: int = 0
) -> list[PairFiles]:
    """Find the pairs in a list or a folder.

    Parameters
    ----------
    source
        - A CSV file whose first line names its columns: ``left`` and ``right``, and optionally
          ``name`` (else the name of the left file), ``num_disparities``, ``min_disparity``,
          ``left_mask`` and ``right_mask``. Paths are relative to the folder of the list.
        - A folder of scenes in Middlebury's layout, each a subfolder with ``im0.png`` and
          ``im1.png``, and with ``calib.txt``, whose ``ndisp`` gives the number of disparities to
          search.
        - A folder with both views in subfolders (``left`` and ``right``, or the names of KITTI and
          EuRoC), whose images pair up by name, else in order, or in files named left... and
          right...
    num_disparities, min_disparity
        The disparities to search if the list, or ``calib.txt``, does not give them; None: find them
        in the images of each pair.

    Raises
    ------
    OSError
        If the list or the folder cannot be read. This does not try to read the images yet.
    ValueError
        If the list has other columns, a wrong number, a repeated name or not a single pair. The
        message names the line.
    """
    place = Path(source).absolute()
    search = num_disparities, min_disparity
    pairs = list(_of_folder(place, search) if place.is_dir() else _of_list(place, search))

    if not pairs:
        raise ValueError(f"{source}: there is no pair in it")

    try:
        check_names(pairs)
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from error
    return pairs


def _of_list(path: Path, search: tuple[int | None, int]) -> Iterator[PairFiles]:
    with open_regular(path) as content, TextIOWrapper(content, "utf-8-sig", newline="") as file:
        if os.fstat(content.fileno()).st_size > LIST:
            raise ValueError(f"{path}: has more than the {LIST} bytes that a list is read to")
        try:
            rows = csv.reader(_lines(path, file), skipinitialspace=True, strict=True)
            columns = [name.strip() for name in next(filter(None, rows), ())]
            _check_columns(path, columns)
            for fields in filter(None, rows):
                where = f"{path}, line {rows.line_num}"
                yield _of_row(path.parent, where, columns, fields, search)
        except (csv.Error, UnicodeDecodeError) as error:
            raise ValueError(f"{path}: not a list in CSV and UTF-8: {error}") from error


def _lines(path: Path, file: TextIO) -> Iterator[str]:
    """Yield the lines of a list; refuse endless lines, which would fill the memory."""
    while line := file.readline(_LONGEST_LINE):
        if len(line) == _LONGEST_LINE:
            raise ValueError(f"{path}: a line has {_LONGEST_LINE} characters or more: no list")
        yield line


def _check_columns(path: Path, given: Sequence[str]) -> None:
    missing = [name for name in _NEEDED if name not in given]
    unknown = [name for name in given if name not in _COLUMNS]

    if missing or unknown or len(set(given)) < len(given):
        raise ValueError(
            f"{path}: got columns {', '.join(map(repr, given)) or 'none'}; accepts left and right, "
            f"and any of {', '.join(map(repr, _COLUMNS[2:]))}, each once, with commas between them"
        )


def _of_row(
    folder: Path,
    where: str,
    columns: Sequence[str],
    fields: Sequence[str],
    search: tuple[int | None, int],
) -> PairFiles:
    """Return the pair of one line; an empty field counts as missing."""
    if len(fields) != len(columns):
        raise ValueError(f"{where}: got {len(fields)} fields; accepts {len(columns)}, as above")

    row = {name: field.strip() for name, field in zip(columns, fields, strict=True)}
    given = {name: field for name, field in row.items() if field}
    for name in _NEEDED:
        if name not in given:
            raise ValueError(f"{where}: {name} is missing")

    files = {
        name: folder / given[name]
        for name in _COLUMNS
        if name in given and name.endswith(("left", "right", "mask"))
    }
    return PairFiles(
        name=given.get("name", files["left"].stem),
        num_disparities=_number(where, "num_disparities", given, search[0]),
        min_disparity=_number(where, "min_disparity", given, search[1]) or 0,
        **files,
    )


def _number(where: str, name: str, given: Mapping[str, str], default: int | None) -> int | None:
    try:
        return int(given[name]) if name in given else default
    except ValueError as error:
        raise ValueError(f"{where}: {name!r}: got {given[name]!r}; accepts an integer") from error


def _of_folder(folder: Path, search: tuple[int | None, int]) -> Iterator[PairFiles]:
    # Scenes in Middlebury's layout; else the views of a rig.
    scenes = sorted(path.parent for path in folder.glob("*/im0.png"))
    if scenes:
        for scene in scenes:
            yield _of_scene(scene, search)
        return

    for left, right in paths_of_rig(folder, _LISTED):
        yield PairFiles(
            name=left.stem,
            left=left,
            right=right,
            num_disparities=search[0],
            min_disparity=search[1],
        )


def _of_scene(scene: Path, search: tuple[int | None, int]) -> PairFiles:
    calibration = scene / "calib.txt"
    known = read_calibration(calibration).ndisp if calibration.is_file() else None

    return PairFiles(
        name=scene.name,
        left=scene / "im0.png",
        right=scene / "im1.png",
        num_disparities=known or search[0],
        min_disparity=search[1],
    )


def check_names(pairs: Iterable[PairFiles]) -> None:
    """Refuse pairs whose results have invalid names or would overwrite each other.

    Raises
    ------
    ValueError
        If a name is not a file name, or two pairs have the same name, or would write the same
        files.
    """
    known: dict[str, PairFiles] = {}
    for pair in pairs:
        if not _is_name(pair.name):
            raise ValueError(
                f"got name {pair.name!r}; accepts the name of a file without folders, of at most "
                f"{_LONGEST} bytes, none of them a control character, that does not begin with a "
                "dot"
            )

        key = pair.name.casefold()  # some file systems treat both as one
        if key in known:
            raise ValueError(
                f"got name {pair.name!r} for {pair.left} and for {known[key].left}; accepts each "
                "once: give names in a column of the list"
            )
        known[key] = pair

    for name, pair in known.items():
        for layer in LAYERS:
            other = name.removesuffix(f".{layer}")
            if other != name and other in known:
                raise ValueError(
                    f"got name {pair.name!r}, as the {layer} of another pair are called; "
                    "accepts another one, in a column of the list"
                )


def _is_name(name: str) -> bool:
    if name != Path(name).name or name.startswith(".") or "\\" in name:
        return False
    return len(os.fsencode(name)) <= _LONGEST and not _CONTROL.search(name)

"""Record the outcome of every pair of a batch in a file that stays sound after any end of a run.

Folders of results go through many hands, so this module checks every record against its schema. It
sets an invalid line apart, with its number, and the run matches its pair again.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from phasestereo.io.drafts import replacing
from phasestereo.io.files import StrPath
from phasestereo_large.records import Appender, check_ranges, decode, decoded, encode, read_lines

State: TypeAlias = Literal["done", "failed"]
"""The possible outcomes of a pair."""

DONE: State = "done"
FAILED: State = "failed"

_FILE = re.compile(r"[^./\\\x00-\x1f][^/\\\x00-\x1f]*")  # a name without a folder


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """The outcome of one pair.

    Parameters
    ----------
    name
        Name of the pair.
    state
        "done" or "failed".
    left, right
        The files of its images.
    num_disparities, min_disparity
        The disparities searched; None for a pair that failed before the run found them.
    recipe
        A digest of everything that the result depends on: the files (path, size, time of change),
        the disparities, the settings, the version. If the digest changed, the run matches the pair
        again.
    reason
        Why it failed.
    attempts
        Number of attempts in the run that recorded it.
    seconds
        Wall-clock time that a worker took for it, including reading and writing.
    width, height
        Size of the images.
    estimated
        Share of the pixels with an estimate, 0 to 1.
    blur
        The blur found, in words, if the settings request it.
    doubt
        Why not to trust the result as a whole, if so: the warning of `phasestereo.match`.
    files
        The files of the result, in the manifest's folder, and their lengths in bytes.
    worker
        Name of the machine and number of the process that made the last attempt.
    """

    name: str
    state: State
    left: str
    right: str
    num_disparities: int | None
    min_disparity: int
    recipe: str
    reason: str | None = None
    attempts: int = 1
    seconds: float | None = None
    width: int | None = None
    height: int | None = None
    estimated: float | None = None
    blur: str | None = None
    doubt: str | None = None
    files: dict[str, int] | None = None
    worker: str | None = None


def read_manifest(path: StrPath) -> dict[str, Record]:
    """Read a manifest, and return its records by the names of the pairs.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If one of its lines is not a record; the message names the line.
    """
    records, damaged = _read(Path(path))
    if damaged:
        raise ValueError(f"{damaged[0].where}: {damaged[0].reason}")
    return records


@dataclass(frozen=True, slots=True)
class Damage:
    """An invalid line of a manifest: its place, its fault, its text."""

    where: str
    reason: str
    line: bytes


class Manifest:
    """The records of a folder of results, old and new.

    A run replaces ``manifest.jsonl`` as a whole, in the order of the pairs, when it begins and when
    it ends. In between it appends records line by line: if a pair has two records, the later one
    counts. Saving moves invalid lines into ``manifest.damaged``.

    Parameters
    ----------
    folder
        The folder of results.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If no line of the manifest is a record: it is something else, and stays unchanged.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / "manifest.jsonl"
        self._apart = folder / "manifest.damaged"
        self._appender: Appender | None = None  # once there is something to append

        is_there = self.path.exists() or self.path.is_symlink()
        self.records, self.damaged = _read(self.path) if is_there else ({}, [])
        if self.damaged and not self.records:
            raise ValueError(f"{self.damaged[0].where}: {self.damaged[0].reason}")
        self._kept = 0  # damaged lines that ``manifest.damaged`` holds

    def add(self, record: Record) -> None:
        """Add a record; the file holds it when the call returns."""
        self.records[record.name] = record
        if self._appender is None:
            self._appender = Appender(self.path)
        self._appender.add(asdict(record))

    def save(self, names: Iterable[str]) -> None:
        """Write the whole manifest, these pairs first and in this order."""
        known = self.records
        order = dict.fromkeys([*(name for name in names if name in known), *known])

        if new := self.damaged[self._kept :]:
            with self._apart.open("ab") as file:
                file.writelines(each.line + b"\n" for each in new)
            self._kept = len(self.damaged)

        self.close()
        try:
            with replacing(self.path, flush=True) as file:
                file.writelines(encode(asdict(known[name])) for name in order)
        except OSError as error:
            reason = error.strerror or error
            raise OSError(f"{self.path} cannot be written: {reason}") from error

    def close(self) -> None:
        """Close the file."""
        if self._appender is not None:
            self._appender.close()
            self._appender = None


def _read(path: Path) -> tuple[dict[str, Record], list[Damage]]:
    """Return the records of a file, and its invalid lines."""
    records: dict[str, Record] = {}
    damaged: list[Damage] = []
    for number, line in read_lines(path):
        try:
            record = _record(line)
        except ValueError as error:
            where, reason = f"{path}, line {number}", f"no record of a batch: {error}"
            damaged.append(Damage(where, reason, line))
        else:
            records[record.name] = record
    return records, damaged


def _record(line: bytes) -> Record:
    """Return the record of a line.

    Raises
    ------
    ValueError
        If it is invalid.
    """
    record: Record = decoded(Record, decode(line))
    files = record.files or {}
    sizes = record.attempts, record.width or 0, record.height or 0, *files.values()

    check_ranges({
        "name": record.name != "",
        "num_disparities": (1 if record.num_disparities is None else record.num_disparities) > 0,
        "attempts, width, height, files": all(0 <= size <= 2**53 for size in sizes),
        "seconds": (record.seconds or 0.0) >= 0,
        "estimated": 0 <= (record.estimated or 0.0) <= 1,
        "files": all(map(_FILE.fullmatch, files)) and bool(files or record.state != DONE),
    })  # fmt: skip
    return record

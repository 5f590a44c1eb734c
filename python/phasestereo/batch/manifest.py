"""What has become of every pair of a batch: a file of records, sound after any end of a run."""

from __future__ import annotations

import errno
import json
import os
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from phasestereo.io.files import replacing

if TYPE_CHECKING:
    from collections.abc import Iterable
    from typing import BinaryIO

    from phasestereo.io.files import StrPath

DONE, FAILED = "done", "failed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """What has become of one pair.

    Parameters
    ----------
    name
        Name of the pair.
    state
        "done" or "failed".
    left, right
        The files of its images.
    num_disparities, min_disparity
        The disparities searched.
    recipe
        A digest of all that the result depends on: the files (path, size, time of change), the
        disparities, the settings, the version. A pair with another one is matched again.
    reason
        Why it failed.
    attempts
        How often it was tried in the run that recorded it.
    seconds
        Wall-clock time that a worker took for it, reading and writing included.
    width, height
        Size of the images.
    estimated
        Share of the pixels with an estimate, 0 to 1.
    blur
        What blur was found, in words, if that was asked for.
    files
        The files of the result, below the folder of the manifest, and their lengths in bytes.
    worker
        Name of the machine and number of the process that tried it last.
    """

    name: str
    state: str
    left: str
    right: str
    num_disparities: int
    min_disparity: int
    recipe: str
    reason: str | None = None
    attempts: int = 1
    seconds: float | None = None
    width: int | None = None
    height: int | None = None
    estimated: float | None = None
    blur: str | None = None
    files: dict[str, int] | None = None
    worker: str | None = None


def read_manifest(path: StrPath) -> dict[str, Record]:
    """Read a manifest; return its records by the names of the pairs.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is no manifest; the message names the line.
    """
    return _parse(Path(path), Path(path).read_bytes())


class Manifest:
    """The records of a folder of results, old and new.

    ``manifest.jsonl`` is replaced as a whole, when a run begins and when it ends. What happens in
    between goes line by line into ``manifest.log`` beside it, from which a run that was killed is
    taken up.

    Parameters
    ----------
    folder
        The folder of results.

    Raises
    ------
    OSError, ValueError
        As `read_manifest`.
    """

    def __init__(self, folder: Path) -> None:
        self.path, self._log = folder / "manifest.jsonl", folder / "manifest.log"
        self.records = read_manifest(self.path) if self.path.exists() else {}
        if self._log.exists():
            content = self._log.read_bytes()
            whole = content[: content.rfind(b"\n") + 1]  # a last line may be torn
            self.records |= _parse(self._log, whole)
        self._file: BinaryIO | None = None

    def add(self, record: Record) -> None:
        """Keep a record; it is in a file when the call returns."""
        self.records[record.name] = record
        if self._file is None:
            self._file = self._log.open("ab", buffering=0)
        line = _line(record)
        if self._file.write(line) < len(line):  # the next one would continue a torn line
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._log))

    def save(self, names: Iterable[str]) -> None:
        """Write the whole manifest, these pairs first and in this order, and end the log."""
        known = self.records
        order = dict.fromkeys([*(name for name in names if name in known), *known])
        try:
            with replacing(self.path) as file:
                file.writelines(_line(known[name]) for name in order)
        except OSError as error:
            reason = error.strerror or error
            raise OSError(f"{self.path} cannot be written: {reason}") from error
        self.close()
        self._log.unlink(missing_ok=True)

    def close(self) -> None:
        """Close the log, which stays."""
        if self._file is not None:
            self._file.close()
            self._file = None


_NAMES = tuple(field.name for field in fields(Record))


def _line(record: Record) -> bytes:
    values = {name: getattr(record, name) for name in _NAMES}
    known = {name: value for name, value in values.items() if value is not None}
    return json.dumps(known, allow_nan=False).encode() + b"\n"


def _parse(path: Path, content: bytes) -> dict[str, Record]:
    records = {}
    for number, line in enumerate(content.splitlines(), start=1):
        record = _record(line)
        if record is None:
            raise ValueError(f"{path}, line {number}: no record of a batch; remove it, or the file")
        records[record.name] = record
    return records


def _record(line: bytes) -> Record | None:
    with suppress(ValueError, TypeError):
        known = json.loads(line)
        return Record(**{name: value for name, value in known.items() if name in _NAMES})
    return None

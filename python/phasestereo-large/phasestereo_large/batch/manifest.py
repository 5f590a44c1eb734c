"""What has become of every pair of a batch: a file of records, sound after any end of a run.

Folders of results go through many hands: every record is held to its schema before it is believed.
A line that is none is set apart, with its number, and its pair is matched again.
"""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Iterable
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Annotated, Any, BinaryIO, Literal, TypeAlias

from phasestereo._extras import require
from phasestereo.io.files import StrPath, decoding, replacing

State: TypeAlias = Literal["done", "failed"]
"""What may have become of a pair."""

DONE: State = "done"
FAILED: State = "failed"

_LONGEST = 2**16  # bytes of a line; one has about 600
_MOST = 2**24  # lines of a manifest
_FILE = r"\A[^./\\\x00-\x1f][^/\\\x00-\x1f]*\Z"  # a name without a folder


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
        The disparities searched; of a pair that failed before they were found, None.
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
    doubt
        Why the result as a whole is not to be trusted, if so: what `phasestereo.match` warns of.
    files
        The files of the result, in the folder of the manifest, and their lengths in bytes.
    worker
        Name of the machine and number of the process that tried it last.
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
    """Read a manifest; return its records by the names of the pairs.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If a line of it is no record; the message names the line.
    ImportError
        If msgspec is not installed.
    """
    records, damaged = _read(Path(path))
    if damaged:
        raise ValueError(f"{damaged[0].where}: {damaged[0].reason}")
    return records


@dataclass(frozen=True, slots=True)
class Damage:
    """A line of a manifest that is no record: where it is, what is wrong with it, what it holds."""

    where: str
    reason: str
    line: bytes


class Manifest:
    """The records of a folder of results, old and new.

    ``manifest.jsonl`` is replaced as a whole, when a run begins and when it ends. What happens in
    between goes line by line into ``manifest.log`` beside it, from which a run that was killed is
    taken up. Lines that are no records go into ``manifest.damaged`` when the manifest is saved.

    Parameters
    ----------
    folder
        The folder of results.

    Raises
    ------
    OSError
        If a file cannot be read.
    ValueError
        If not a single line of the manifest is a record: it is something else, and left alone.
    ImportError
        If msgspec is not installed.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / "manifest.jsonl"
        self._log = folder / "manifest.log"
        self._apart = folder / "manifest.damaged"
        self._file: BinaryIO | None = None  # the log, once something goes into it

        self.records, self.damaged = _read(self.path) if _is_there(self.path) else ({}, [])
        if self.damaged and not self.records:
            raise ValueError(f"{self.damaged[0].where}: {self.damaged[0].reason}")

        self._kept = 0  # damaged lines that are in the file apart
        if _is_there(self._log):
            records, damaged = _read(self._log, torn=True)
            self.records |= records
            self.damaged += damaged

    def add(self, record: Record) -> None:
        """Add a record; it is in a file when the call returns."""
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

        self._set_apart()

        try:
            with replacing(self.path, flush=True) as file:
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

    def _set_apart(self) -> None:
        """Move the lines that are no records into a file of their own."""
        if self.damaged[self._kept :]:
            with self._apart.open("ab") as file:
                file.writelines(each.line + b"\n" for each in self.damaged[self._kept :])
            self._kept = len(self.damaged)


_NAMES = tuple(field.name for field in fields(Record))


def _line(record: Record) -> bytes:
    values = {name: getattr(record, name) for name in _NAMES}
    known = {name: value for name, value in values.items() if value is not None}
    return json.dumps(known, allow_nan=False).encode() + b"\n"


def _is_there(path: Path) -> bool:
    return path.exists() or path.is_symlink()


def _read(path: Path, *, torn: bool = False) -> tuple[dict[str, Record], list[Damage]]:
    """Return the records of a file, and the lines that are none; the last one may be torn."""
    records: dict[str, Record] = {}
    damaged: list[Damage] = []
    schema = _Schema()

    with decoding(path) as file:
        for number in range(1, _MOST + 1):
            line = file.readline(_LONGEST)
            # The end, or a line of the log that a killed run could not finish.
            if not line or (torn and not line.endswith(b"\n") and len(line) < _LONGEST):
                return records, damaged
            if not line.endswith(b"\n") and len(line) == _LONGEST:
                raise ValueError(f"line {number} has {_LONGEST} bytes or more: no manifest")
            try:
                record = schema.record(line)
            except ValueError as error:
                where, content = f"{path}, line {number}", line.rstrip(b"\r\n")
                damaged.append(Damage(where, f"no record of a batch: {error}", content))
            else:
                records[record.name] = record
    raise ValueError(f"has more than {_MOST} lines: no manifest")


class _Schema:
    """The schema of a line, by which msgspec checks it."""

    def __init__(self) -> None:
        msgspec: Any = require("msgspec", extra="batch")
        self._refused = msgspec.ValidationError, msgspec.DecodeError, RecursionError

        types = _types(msgspec.Meta)
        members = [
            (name, types[name]) if default is MISSING else (name, types[name], default)
            for name, default in ((field.name, field.default) for field in fields(Record))
        ]

        self._decoder = msgspec.json.Decoder(msgspec.defstruct("Line", members, kw_only=True))

    def record(self, line: bytes) -> Record:
        """Return the record of a line.

        Raises
        ------
        ValueError
            If it is none.
        """
        try:
            found = self._decoder.decode(line)
        except self._refused as error:
            raise ValueError(str(error)) from error

        record = Record(**{name: getattr(found, name) for name in _NAMES})
        if record.state == DONE and not record.files:
            raise ValueError("Object is done without `files`")
        return record


def _types(meta: Any) -> dict[str, Any]:
    """Return the type of each field, with the bounds that a run keeps to."""
    natural: Any = Annotated[int, meta(ge=0, le=2**53)]
    file: Any = Annotated[str, meta(pattern=_FILE)]

    return {
        "name": Annotated[str, meta(min_length=1)],
        "state": State,
        "left": str,
        "right": str,
        "num_disparities": Annotated[int, meta(ge=1, lt=2**31)] | None,
        "min_disparity": Annotated[int, meta(gt=-(2**31), lt=2**31)],
        "recipe": str,
        "reason": str | None,
        "attempts": natural,
        "seconds": Annotated[float, meta(ge=0)] | None,
        "width": natural | None,
        "height": natural | None,
        "estimated": Annotated[float, meta(ge=0, le=1)] | None,
        "blur": str | None,
        "doubt": str | None,
        "files": dict[file, natural] | None,
        "worker": str | None,
    }

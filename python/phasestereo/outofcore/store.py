"""What of a run is finished: a folder beside the output, which a kill at any moment leaves intact.

Every file in it is written under another name, flushed to the disk and renamed. A band is finished
when its block is there, whatever other bands are. The file ``run.json``, the first to come and the
first to go, tells what run it is: a folder without it is rubbish.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import zipfile
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, BinaryIO, TypeVar

import numpy as np

from phasestereo import surveying
from phasestereo._extras import require
from phasestereo.outofcore.sinks import place_of
from phasestereo.outofcore.sizes import tell_bytes

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from phasestereo.surveying import Survey

    Arrays = Mapping[str, NDArray[Any]]

T = TypeVar("T")

_RUN, _SURVEY, _LOCK, _DRAFT = "run.json", "survey.npz", "lock", "draft.npz"
_BLOCK = re.compile(r"tile(\d{4})-rows(\d{8})-(\d{8})\.npz")


@dataclass(frozen=True, slots=True)
class Store:
    """The finished blocks of a run; see `opened`, which makes it.

    Parameters
    ----------
    folder
        Where they are.
    """

    folder: Path

    def run(self) -> dict[str, Any] | None:
        """Return the identity of the run that the folder is of; None: of none."""
        path = self.folder / _RUN
        if not path.exists():
            return None
        return self._whole(path, _read_json)

    def bands(self, tile: int) -> list[tuple[int, int]]:
        """Return first and last row (exclusive) of the finished bands of a tile, from above."""
        found = []
        for path in self.folder.iterdir():
            name = _BLOCK.fullmatch(path.name)
            if name and int(name[1]) == tile:
                found.append((int(name[2]), int(name[3])))
        return sorted(found)

    def missing(self, tile: int, height: int) -> list[tuple[int, int]]:
        """Return the rows between the finished bands of a tile that has so many rows in all."""
        ends = [0, *(row for band in self.bands(tile) for row in band), height]
        between = zip(ends[::2], ends[1::2], strict=True)
        return [(first, last) for first, last in between if first < last]

    def survey(self, make: Callable[[], Survey]) -> Survey:
        """Return the survey of the pair; it is made once."""
        path = self.folder / _SURVEY
        if path.exists():
            return self._whole(path, surveying.load)
        found = make()
        with self._published(path, 0) as draft:
            found.save(draft)
        return found

    def save(self, tile: int, rows: tuple[int, int], block: Arrays) -> None:
        """Keep a band."""
        size = sum(array.nbytes for array in block.values())
        with self._published(self._block(tile, rows), size) as draft, draft.open("wb") as file:
            _write(file, block)

    def load(self, tile: int, rows: tuple[int, int], name: str) -> NDArray[Any]:
        """Return one array of a finished block."""
        return self._whole(self._block(tile, rows), partial(_read, name=name))

    def discard(self) -> None:
        """Remove everything: the run is over."""
        (self.folder / _RUN).unlink(missing_ok=True)
        shutil.rmtree(self.folder, ignore_errors=True)

    def _block(self, tile: int, rows: tuple[int, int]) -> Path:
        return self.folder / f"tile{tile:04}-rows{rows[0]:08}-{rows[1]:08}.npz"

    @contextmanager
    def _published(self, path: Path, size: int) -> Iterator[Path]:
        """Give the name of a draft, which takes the file's place when the block ends well."""
        draft = self.folder / _DRAFT
        try:
            yield draft
            _flush(draft)
            draft.replace(path)
            _flush(self.folder)
        except OSError as error:
            draft.unlink(missing_ok=True)
            need = f" ({tell_bytes(size)} are needed)" if size else ""
            raise OSError(
                error.errno,
                f"{error.strerror or error}{need}; what is finished is kept in {self.folder}, and "
                "the same command goes on from there",
                str(path),
            ) from error

    def _whole(self, path: Path, read: Callable[[Path], T]) -> T:
        """Read a file of the folder; one that is not as it was written ends the run."""
        try:
            return read(path)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise OSError(
                f"{path}: cannot be read ({error}): mend that, or match again from the first row "
                "with restart"
            ) from error


@contextmanager
def opened(output: Path, identity: Mapping[str, Any], *, restart: bool) -> Iterator[Store]:
    """Open the folder of finished blocks beside an output, and keep other runs from it.

    Parameters
    ----------
    output
        The file that comes out in the end.
    identity
        What the result depends on, as JSON has it.
    restart
        Whether to drop what an earlier run finished.

    Raises
    ------
    ValueError
        If an earlier run has finished bands, and differs in its identity.
    OSError
        If another run is at work, or the folder cannot be made or is of something else.
    """
    target = place_of(output)
    folder = target.with_name(target.name + ".part")
    told = json.loads(json.dumps(identity, default=np.generic.item))
    with _locked(folder):
        store = Store(folder)
        _prepare(store, told, restart=restart)
        try:
            yield store
        except Exception:
            if not any(_BLOCK.fullmatch(path.name) for path in folder.iterdir()):
                store.discard()
            raise


def _prepare(store: Store, identity: dict[str, Any], *, restart: bool) -> None:
    """Make the folder that of this run: what is in it stays, if it is of the same one."""
    path = store.folder / _RUN
    earlier = store.run()
    if earlier == identity and not restart:
        return
    found = [file for file in store.folder.iterdir() if file.name != _LOCK]
    strange = [file for file in found if not _is_ours(file)]
    if strange:
        raise OSError(f"{store.folder}: holds {strange[0].name}, which is not of a run; move it")
    if earlier and not restart and any(_BLOCK.fullmatch(file.name) for file in found):
        raise ValueError(f"restart: got False, but {store.folder} holds finished blocks of a run "
                         f"with {_differences(earlier, identity)}; accepts True to drop "
                         "them")  # fmt: skip
    for file in sorted(found, key=lambda file: file.name != _RUN):
        file.unlink()
    with store._published(path, 0) as draft:
        draft.write_text(json.dumps(identity, indent=2), encoding="utf-8")


def _is_ours(file: Path) -> bool:
    return file.name in (_RUN, _SURVEY, _DRAFT) or bool(_BLOCK.fullmatch(file.name))


def _differences(earlier: dict[str, Any], now: dict[str, Any]) -> str:
    """Tell what two runs differ in."""
    told = []
    for name in earlier | now:
        before, after = earlier.get(name), now.get(name)
        if isinstance(before, dict) and isinstance(after, dict) and before != after:
            told.append(_differences(before, after) if name == "settings" else f"another {name}")
        elif before != after:
            told.append(f"{name} {before} (now {after})")
    return ", ".join(told)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder, which the system frees when the process ends, however it does."""
    filelock = require("filelock", extra="large")
    path = folder / _LOCK
    while True:
        folder.mkdir(exist_ok=True)
        lock = filelock.FileLock(path)
        try:
            lock.acquire(timeout=0)
        except filelock.Timeout as error:
            raise OSError(f"{folder}: another run is at work there; wait for its end") from error
        except FileNotFoundError:
            continue  # the run before removed the folder just now
        if path.exists():
            break
        lock.release()
    try:
        yield
    finally:
        lock.release()
        if folder.is_dir() and not (folder / _RUN).exists():  # the run is over, or never began
            with suppress(OSError):  # other files stay, and so does a lock that others hold
                path.unlink(missing_ok=True)
                folder.rmdir()


def _write(file: BinaryIO, arrays: Arrays) -> None:
    named: dict[str, Any] = dict(arrays)
    try:
        np.savez(file, **named)
    except ValueError as error:  # zipfile, which cannot close an archive that is cut short
        raise (error.__context__ or error) from None


def _read_json(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(path.read_bytes())
    return found


def _read(path: Path, name: str) -> NDArray[Any]:
    with np.load(path, allow_pickle=False) as arrays:
        found: NDArray[Any] = arrays[name]
        return found


def _flush(path: Path) -> None:
    """Have a file, or the names in a folder, reach the disk."""
    if os.name == "nt" and path.is_dir():
        return  # which cannot be opened there
    number = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(number)
    finally:
        os.close(number)

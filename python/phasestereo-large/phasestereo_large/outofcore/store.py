"""The finished part of a run: a folder beside the output that survives a kill at any moment.

The run writes every file under another name, flushes it to the disk and renames it. A band is
finished when its block exists, independently of other bands. A file's name ends in a digest of its
name, its contents and its run: the run rejects a file that was damaged, renamed or taken from
another run, and matches its band again. The file ``run.json``, written first and removed first,
names the run: a folder without it is garbage.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np
from numpy.typing import NDArray

from phasestereo._extras import require
from phasestereo.io.drafts import DRAFTS, publish
from phasestereo_large import bands
from phasestereo_large.locks import locked
from phasestereo_large.outofcore.sinks import place_of
from phasestereo_large.outofcore.sizes import format_bytes
from phasestereo_large.statistics import PairStatistics

Arrays = Mapping[str, NDArray[Any]]
Rows = tuple[int, int]

T = TypeVar("T")

_RUN, _LOCK, _DRAFT = "run.json", "lock", "draft.npz"
_KEPT = re.compile(r"(.+)-([0-9a-f]{32})\.npz")
_BLOCK = re.compile(r"rows(\d{8})-(\d{8})")
_STATISTICS = "statistics"


class Store:
    """The finished blocks of a run; see `opened`, which makes it.

    Parameters
    ----------
    folder
        Their folder.
    identity
        The values that determine the result of the run.
    """

    def __init__(self, folder: Path, identity: Mapping[str, Any]) -> None:
        self.folder = folder
        self.again: list[str] = []
        """The work to do again, and why, in words."""
        self._key = _key(identity)
        self._files: dict[str, Path] = {}  # intact files by name, without digest and suffix

    def recorded_identity(self) -> dict[str, Any] | None:
        """Return the request of this folder's run; None without a run, {} if it is damaged."""
        path = self.folder / _RUN
        if not path.exists():
            return None

        with suppress(ValueError, RecursionError, KeyError, TypeError):
            content = json.loads(path.read_bytes())
            found: dict[str, Any] = content["run"]
            if content["digest"] == _key(found).hex():
                return found

        return {}

    def check(self) -> None:
        """Find the intact files, and the work to do again."""
        self._files.clear()
        self.again.clear()

        for path in sorted(self.folder.iterdir()):
            if kept := _KEPT.fullmatch(path.name):
                if self._digest(kept[1], path) == kept[2]:
                    self._files[kept[1]] = path
                else:
                    self.again.append(f"{path.name} is damaged: its rows are matched again")

        for (_, above), (first, last) in pairwise([(0, 0), *self.bands()]):
            if first > above:
                self.again.append(
                    f"rows {above} to {first - 1} above rows {first} to {last - 1} are "
                    "missing: they are matched again"
                )

    def drop_damaged(self) -> None:
        """Remove the damaged files."""
        for path in self.folder.iterdir():
            kept = _KEPT.fullmatch(path.name) and path not in self._files.values()
            if kept or path.match(DRAFTS):
                path.unlink()

    @property
    def has_blocks(self) -> bool:
        """Whether any band is finished."""
        return next(self._blocks(), None) is not None

    def bands(self) -> list[Rows]:
        """Return the first and last row (exclusive) of the finished bands, from above.

        If two overlap, as after a partial restore, one counts.
        """
        found: list[Rows] = []
        for first, last in sorted(self._blocks()):
            if first >= (found[-1][1] if found else 0) and last > first:
                found.append((first, last))
        return found

    def gaps(self, height: int) -> list[Rows]:
        """Return the rows that are not finished, from above."""
        bands = [(0, 0), *self.bands(), (height, height)]
        return [(above, below) for (_, above), (below, _) in pairwise(bands) if above < below]

    def pair_statistics(self, make: Callable[[], PairStatistics]) -> PairStatistics:
        """Return the statistics of the pair; gather them once."""
        if _STATISTICS in self._files:
            return self._whole(_STATISTICS, bands.load)

        found = make()
        with self._published(_STATISTICS, 0) as draft:
            found.save(draft)
        return found

    def save(self, rows: Rows, block: Arrays) -> None:
        """Save a band."""
        size = sum(array.nbytes for array in block.values())
        with self._published(_block(rows), size) as draft, draft.open("wb") as file:
            _write(file, block)

    def load(self, rows: Rows, name: str) -> NDArray[Any]:
        """Return one array of a finished block."""
        return self._whole(_block(rows), partial(_read, name=name))

    def discard(self) -> None:
        """Remove everything: the run is over."""
        (self.folder / _RUN).unlink(missing_ok=True)
        shutil.rmtree(self.folder, ignore_errors=True)

    def _blocks(self) -> Iterator[Rows]:
        """Yield the rows of each intact block."""
        for name in self._files:
            if kept := _BLOCK.fullmatch(name):
                yield int(kept[1]), int(kept[2])

    def _digest(self, name: str, path: Path) -> str:
        digest = hashlib.blake2b(name.encode(), digest_size=16, key=self._key)
        with path.open("rb") as file:
            while piece := file.read(2**20):
                digest.update(piece)
        return digest.hexdigest()

    @contextmanager
    def _published(self, name: str, size: int) -> Iterator[Path]:
        """Yield the name of a draft; it gets this name when the block ends without an error."""
        draft = self.folder / _DRAFT
        try:
            yield draft
            path = self.folder / f"{name}-{self._digest(name, draft)}.npz"
            publish(draft, path)
        except OSError as error:
            with suppress(OSError):
                draft.unlink(missing_ok=True)
            need = f" ({format_bytes(size)} are needed)" if size else ""
            message = f"{error.strerror or error}{need}"
            raise OSError(error.errno, message, str(self.folder / name)) from error

        self._files[name] = path

    def _whole(self, name: str, read: Callable[[Path], T]) -> T:
        """Read a file of the folder; a file damaged since the check ends the run."""
        path = self._files[name]
        try:
            return read(path)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise OSError(
                f"{path}: cannot be read ({error}): the same command does it again"
            ) from error


@contextmanager
def opened(output: Path, identity: Mapping[str, Any], *, restart: bool) -> Iterator[Store]:
    """Open the folder of finished blocks beside an output, and keep other runs from it.

    Parameters
    ----------
    output
        The final output file.
    identity
        The values that determine the result, in JSON form.
    restart
        Whether to drop the finished bands of an earlier run.

    Raises
    ------
    ValueError
        If an earlier run has finished bands, and differs in its identity.
    OSError
        If another run is active, or the folder cannot be made or belongs to something else.
    """
    target = place_of(output)
    folder = target.with_name(target.name + ".part")
    # In the form read from the file: JSON has no tuples.
    plain = json.loads(json.dumps(identity, default=np.generic.item))

    with _alone(folder):
        store = Store(folder, plain)
        _prepare(store, plain, restart=restart)
        with _naming_the_folder(store):
            yield store


@contextmanager
def _naming_the_folder(store: Store) -> Iterator[None]:
    """Name the folder of finished bands in an error that ends the run; drop an empty one."""
    try:
        yield
    except Exception as error:
        if not store.has_blocks:
            store.discard()
        elif isinstance(error, OSError) and error.errno is not None:
            kept = f"what is finished is kept in {store.folder}"
            message = f"{error.strerror}; {kept}, and the same command goes on from there"
            raise OSError(error.errno, message, error.filename) from error
        raise


def _prepare(store: Store, identity: dict[str, Any], *, restart: bool) -> None:
    """Prepare the folder for this run; finished bands of the same run stay."""
    earlier = store.recorded_identity()
    found = [file for file in store.folder.iterdir() if file.name != _LOCK]
    strange = [file for file in found if not _is_ours(file)]
    if strange:
        raise OSError(f"{store.folder}: holds {strange[0].name}, which is not of a run; move it")

    blocks = any(_is_block(file) for file in found)

    if earlier in (identity, {}) and not restart:
        store.check()
        if earlier or store.has_blocks or not blocks:  # if its blocks are ours, the run is ours
            store.drop_damaged()
            if not earlier:
                _begin(store, identity)
            return

    if earlier is not None and not restart and blocks:
        differences = _differences(earlier, identity) if earlier else f"a damaged {_RUN}"
        raise ValueError(f"restart: got False, but {store.folder} holds finished blocks of a run "
                         f"with {differences}; accepts True to drop them")  # fmt: skip

    # The name of the run goes first: without it the rest is garbage, even if a kill comes here.
    for file in sorted(found, key=lambda file: file.name != _RUN):
        file.unlink()
    if blocks and not restart:
        store.again.append(f"{store.folder} has no {_RUN}, so its blocks are matched again")
    _begin(store, identity)


def _begin(store: Store, identity: dict[str, Any]) -> None:
    """Write the identity of the run into the folder."""
    content = {"digest": _key(identity).hex(), "run": identity}
    draft = store.folder / _DRAFT
    try:
        draft.write_text(json.dumps(content, indent=2), encoding="utf-8")
        publish(draft, store.folder / _RUN)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(store.folder / _RUN)) from error


def _key(identity: Mapping[str, Any]) -> bytes:
    return hashlib.blake2b(json.dumps(identity, sort_keys=True).encode()).digest()


def _is_ours(file: Path) -> bool:
    kept = _KEPT.fullmatch(file.name)
    if kept is None:
        return file.name in (_RUN, _DRAFT) or file.match(DRAFTS)
    return kept[1] == _STATISTICS or bool(_BLOCK.fullmatch(kept[1]))


def _is_block(file: Path) -> bool:
    kept = _KEPT.fullmatch(file.name)
    return bool(kept and _BLOCK.fullmatch(kept[1]))


def _block(rows: Rows) -> str:
    return f"rows{rows[0]:08}-{rows[1]:08}"


def _differences(earlier: dict[str, Any], now: dict[str, Any]) -> str:
    """Return the differences between two runs, in words."""
    parts = []
    for name in earlier | now:
        before, after = earlier.get(name), now.get(name)
        if isinstance(before, dict) and isinstance(after, dict) and before != after:
            parts.append(_differences(before, after) if name == "settings" else f"another {name}")
        elif before != after:
            parts.append(f"{name} {before} (now {after})")

    return ", ".join(parts)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Keep other runs from a folder, and remove it if it holds no run to resume."""
    is_ours = False
    try:
        with locked(folder / _LOCK, require("filelock", extra="large")):
            is_ours = True
            yield
    finally:
        # The run is over, or never began.
        if is_ours and folder.is_dir() and not (folder / _RUN).exists():
            with suppress(OSError):  # other files stay, and so does a lock that another run holds
                (folder / _LOCK).unlink(missing_ok=True)
                folder.rmdir()


def _write(file: BinaryIO, arrays: Arrays) -> None:
    named: dict[str, Any] = dict(arrays)
    try:
        np.savez(file, **named)
    except ValueError as error:  # from zipfile, which cannot close a truncated archive
        raise (error.__context__ or error) from None


def _read(path: Path, name: str) -> NDArray[Any]:
    with np.load(path, allow_pickle=False) as arrays:
        return arrays[name]

"""Downloads: Middlebury's official archives, fetched, checked and unpacked, or not at all.

Here belongs how the data gets from the site into a folder that `phasestereo_bench.datasets` reads;
where each file is on the site, and its hash, is in `downloads.toml`.

Middlebury permits the use and publication of all its images and disparities, and asks for a
citation of the paper they came with:

- 2001: D. Scharstein and R. Szeliski. A taxonomy and evaluation of dense two-frame stereo
  correspondence algorithms. IJCV 47(1-3), 2002.
- 2003: D. Scharstein and R. Szeliski. High-accuracy stereo depth maps using structured light.
  CVPR 2003.
- 2005: D. Scharstein and C. Pal. Learning conditional random fields for stereo. CVPR 2007.
- 2006: H. Hirschmüller and D. Scharstein. Evaluation of cost functions for stereo matching.
  CVPR 2007.
- 2014, MiddEval3: D. Scharstein, H. Hirschmüller, Y. Kitajima, G. Krathwohl, N. Nesic, X. Wang and
  P. Westling. High-resolution stereo datasets with subpixel-accurate ground truth. GCPR 2014.
- 2021: G. Pan, T. Sun, T. Weed and D. Scharstein. Mobile stereo datasets with ground truth.
  https://vision.middlebury.edu/stereo/data/scenes2021, 2021.
"""

from __future__ import annotations

import json
import shutil
import tomllib
import zipfile
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path, PureWindowsPath
from typing import TYPE_CHECKING, Any, NamedTuple

import filelock
import pooch

from phasestereo.io import read_image
from phasestereo.io.files import decoding, replacing
from phasestereo_bench.datasets import find_scenes

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterator, Mapping

    Progress = Callable[[int, int], object]

__all__ = ["collections", "download"]

_TIMEOUT = 30  # seconds that the server may stay silent
_CHUNK = 1 << 16  # bytes between two reports of progress
_STEPS = 1000  # of progress, per file
_UNKNOWN = "unknown"

# What an archive may grow to, of its own size or at any rate: images hardly shrink at all.
_MOST_GROWTH = 100
_ALWAYS_ALLOWED = 1 << 26  # bytes


def collections() -> list[str]:
    """Return the names of what can be downloaded, such as "2001", "2005-third", "MiddEval3-Q".

    A size is part of the name: a quarter, a third, half of the full one, as Middlebury offers it;
    MiddEval3 is the training and the test set at a quarter (Q), half (H) or full size (F). 2005 and
    2006 come in one light, 2014 with other exposure (im1E) and light (im1L) of the right image.
    """
    return list(_registry())


def download(
    collection: str,
    folder: str | os.PathLike[str] | None = None,
    *,
    progress: Progress | None = None,
    base_url: str | None = None,
) -> Path:
    """Fetch a collection of Middlebury's stereo data, unless it is there.

    Only a complete one is installed: every file arrived whole, has its hash, can be decoded, and
    all the scenes are there. A hash that is not known beforehand is recorded when the collection
    is first installed, in ``<collection>.sha256.json`` in `folder`, and checked from then on;
    remove that file to trust the site anew. If a download fails, the files that had arrived are
    kept, and used by the next. Of several downloads of the same collection into the same folder one
    fetches it, and the others wait.

    Middlebury asks for a citation: see the head of this module.

    Parameters
    ----------
    collection
        One of `collections`.
    folder
        Where collections are installed, each in a folder of its own name; by default the user's
        cache. It is made if need be.
    progress
        Called as ``progress(done, total)`` with growing `done`.
    base_url
        A mirror of https://vision.middlebury.edu/stereo/, with the same paths below it.

    Returns
    -------
    Path
        The folder of the collection, to be given to `phasestereo_bench.datasets.find_scenes`.

    Raises
    ------
    OSError
        If the server cannot be reached, refuses, or breaks off; or the disk is full, or `folder`
        cannot be written to.
    ValueError
        If there is no such collection; if `base_url` is not of http or https; if what arrived is
        damaged, is not what it should be or has not the hash it should have; or if the collection
        is there, but not complete.
    """
    registry = _registry()
    if collection not in registry:
        raise ValueError(f"collection must be one of {', '.join(registry)}; got {collection!r}")
    if base_url is not None and not str(base_url).startswith(("http://", "https://")):
        raise ValueError(f"base_url must start with http:// or https://, got {base_url!r}")
    entry, target = registry[collection], _root(folder) / collection
    if not target.exists():
        target.parent.mkdir(parents=True, exist_ok=True)
        lock = filelock.FileLock(target.with_name(f".{collection}.lock"))
        with lock:
            if not target.exists():  # it may have been installed while we waited
                _install(entry, target, base_url or entry.base, progress)
    found = _count_scenes(target)
    if found < entry.scenes:
        raise ValueError(
            f"{target} has {found} scenes, not the {entry.scenes} of {collection}: remove it to "
            f"have it fetched anew"
        )
    return target


@dataclass(frozen=True, slots=True, kw_only=True)
class _Collection:
    """One table of downloads.toml, which says what the fields are."""

    base: str
    scenes: int
    url: str
    into: str
    verified: bool
    sha256: Mapping[str, str]


def _registry() -> dict[str, _Collection]:
    tables = tomllib.loads((files("phasestereo_bench") / "downloads.toml").read_text("utf-8"))
    base = tables.pop("base")
    return {name: _Collection(base=base, **table) for name, table in tables.items()}


def _root(folder: str | os.PathLike[str] | None) -> Path:
    if folder is not None:
        return Path(folder).absolute()
    return Path(pooch.os_cache("phasestereo")) / "middlebury"


def _count_scenes(folder: Path) -> int:
    try:
        return len(find_scenes(folder))
    except ValueError:
        return 0


def _install(entry: _Collection, target: Path, base: str, progress: Progress | None) -> None:
    """Fetch all files, unpack them into a draft of the collection's folder, and name it so."""
    draft = target.with_name(f".{target.name}.part")
    tree, archives = draft / "tree", draft / "archives"
    try:
        _empty(tree)  # a run that was killed leaves what it had unpacked
        recorded = _Recorded(target.with_name(f"{target.name}.sha256.json"))
        for index, (key, sha256) in enumerate(entry.sha256.items()):
            path = entry.url.format(key)
            file = _File(base.rstrip("/") + "/" + path, archives / path.replace("/", "-"))
            known = _Known(sha256, "downloads.toml") if sha256 != _UNKNOWN else recorded.get(path)
            _fetch(file, known, _Bar(progress, index, len(entry.sha256)), verified=entry.verified)
            _unpack(file, tree / entry.into, key)
            recorded.add(path, file.path)
        shutil.rmtree(archives)  # no more use, even if a scene is missing in them
        found = _count_scenes(tree)
        if found != entry.scenes:
            raise ValueError(
                f"what was fetched for {target.name} has {found} scenes, not {entry.scenes}; "
                f"it is not installed"
            )
        recorded.save()
        tree.rename(target)
    finally:
        shutil.rmtree(tree, ignore_errors=True)
        for empty in (archives, draft):
            with suppress(OSError):
                empty.rmdir()


def _empty(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)


@dataclass(frozen=True, slots=True)
class _File:
    """A file of the site, and where it is kept until the collection is installed."""

    url: str
    path: Path


class _Known(NamedTuple):
    """A hash that a file should have, and who says so."""

    sha256: str | None
    origin: object


def _fetch(file: _File, known: _Known, bar: _Bar, *, verified: bool) -> None:
    """Get a file, unless it is there with its hash; afterwards it is there as a whole."""
    source = file.url if verified else f"{file.url} (an address not verified yet)"
    downloader = pooch.HTTPDownloader(progressbar=bar, chunk_size=_CHUNK, timeout=_TIMEOUT)
    try:
        with _silence(pooch.get_logger()):
            pooch.retrieve(
                file.url,
                known.sha256,
                fname=file.path.name,
                path=file.path.parent,
                downloader=downloader,
            )
    except ValueError as error:
        raise ValueError(f"{source}: {error} The known hash is that of {known.origin}.") from error
    except OSError as error:
        if error.errno is not None:
            raise
        raise OSError(f"cannot fetch {source}: {_reason(error)}") from error
    bar.finish()


def _reason(error: OSError) -> str:
    """Return why a request failed: the server's answer, or the root of the chain of errors."""
    response = getattr(error, "response", None)
    if response is not None:
        return f"the server answered {response.status_code} {response.reason}"
    root: BaseException = error
    while root.__context__ is not None:
        root = root.__context__
    return str(root) or type(root).__name__


@contextmanager
def _silence(logger: Any) -> Iterator[None]:
    """Keep a logger from telling what goes as it should."""
    level = logger.level
    logger.setLevel("WARNING")
    try:
        yield
    finally:
        logger.setLevel(level)


class _Bar:
    """What pooch calls while it fetches one file of several, passed on as steps of the whole."""

    def __init__(self, progress: Progress | None, index: int, count: int) -> None:
        self.total = 0  # bytes, set by pooch; 0 if the server doesn't tell
        self._progress, self._index, self._count = progress, index, count
        self._received = 0

    def update(self, received: int) -> None:
        self._received += received
        if self.total > 0:
            self._report(min(_STEPS, _STEPS * self._received // self.total))

    def reset(self) -> None:
        self._received = 0

    def close(self) -> None:
        """Do nothing: a file is finished when its hash is checked."""

    def finish(self) -> None:
        self._report(_STEPS)

    def _report(self, steps: int) -> None:
        if self._progress is not None:
            self._progress(_STEPS * self._index + steps, _STEPS * self._count)


def _unpack(file: _File, into: Path, key: str) -> None:
    """Put what is in a file where it belongs; a file that cannot be decoded is removed."""
    try:
        if file.path.suffix == ".zip":
            _unzip(file.path, into)
        else:
            read_image(file.path)
            (into / key).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file.path, into / key)
    except ValueError as error:
        with file.path.open("rb") as opened:
            is_page = opened.read(64).lstrip().startswith(b"<")
        file.path.unlink()
        what = "a web page instead of the file" if is_page else "a file that cannot be used"
        raise ValueError(f"{file.url} sent {what}: {error}") from error


def _unzip(path: Path, into: Path) -> None:
    with decoding(path) as file, zipfile.ZipFile(file) as archive:
        for name in archive.namelist():
            inner = PureWindowsPath(name)  # knows both kinds of slashes, and drives
            if inner.anchor or ".." in inner.parts:
                raise ValueError(f"a file in it would be written elsewhere: {name!r}")
        size = sum(member.file_size for member in archive.infolist())
        most = _ALWAYS_ALLOWED + _MOST_GROWTH * path.stat().st_size
        if size > most:
            raise ValueError(f"its files are said to have {size} bytes, more than {most}")
        archive.extractall(into)  # which checks the length and the CRC of each


class _Recorded:
    """The hashes of what was installed once: a JSON object, SHA-256 by path on the site."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._hashes: dict[str, str] = {}
        if path.exists():
            with decoding(path) as file:
                self._hashes = {name: str(sha256) for name, sha256 in json.load(file).items()}

    def get(self, path: str) -> _Known:
        return _Known(self._hashes.get(path), self._path)

    def add(self, path: str, file: Path) -> None:
        self._hashes[path] = pooch.file_hash(str(file))

    def save(self) -> None:
        with replacing(self._path) as draft:
            draft.write(json.dumps(self._hashes, indent=1).encode())

"""Files under construction: a draft next to the target replaces it once it is complete.

There are two kinds. Files written in one go use a hidden draft, `.phasestereo-*.part`, which its
process keeps locked: an unlocked one was left by a dead process, and `remove_abandoned` may delete
it. Files that grow for hours, such as recordings, use a visible draft, `NAME.*.part.SUFFIX`: after
a crash it holds all the data, so nobody deletes it.
"""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from phasestereo.io.files import StrPath, suffix, target_of

try:
    import fcntl
except ImportError:  # Windows, where `remove_abandoned` leaves everything
    fcntl = None  # type: ignore[assignment]

DRAFTS = ".phasestereo-*.part"
"""The names of hidden drafts."""


@contextmanager
def replacing(path: StrPath, *, flush: bool = False) -> Iterator[BinaryIO]:
    """Open a draft in the file's folder; it replaces the file when the block succeeds.

    A replaced file keeps its mode.

    Parameters
    ----------
    path
        The file.
    flush
        Whether to write it through to the disk first, so that a power cut leaves it or the old one.

    Raises
    ------
    OSError
        If the folder does not exist or cannot be written to, or the path is not a regular file;
        the message names the file.
    """
    target = target_of(path)
    draft, file, lock = _locked_draft(target.parent)

    try:
        with file:
            if target.exists():
                shutil.copymode(target, draft)  # before there is anything in it to be read
            yield file
            file.flush()
            if flush:
                os.fsync(file.fileno())
        draft.replace(target)
    except OSError as error:
        if error.errno is None or error.filename is not None:
            raise
        # For example on a full disk, where the system's message names no file.
        raise OSError(error.errno, error.strerror, os.fspath(path)) from error
    finally:
        draft.unlink(missing_ok=True)
        if lock is not None:
            os.close(lock)


def replace_text(path: StrPath, text: str, *, errors: str = "strict") -> None:
    """Write a UTF-8 file as `replacing` does; `errors` as in `str.encode`.

    Raises
    ------
    OSError
        As `replacing`.
    """
    with replacing(path) as file:
        file.write(text.encode("utf-8", errors))


def draft_of(path: StrPath, suffixes: Sequence[str], what: str) -> tuple[Path, Path]:
    """Return the file that a path names, and a recording's draft next to it, not created yet.

    Raises
    ------
    OSError
        If its folder does not exist or cannot be written to, or it is not a file.
    ValueError
        If it does not end in one of the suffixes; ``what`` says what is written.
    """
    if suffix(path) not in suffixes:
        raise ValueError(
            f"path of a {what} must end in {' or '.join(suffixes)}, got {os.fspath(path)!r}"
        )

    target = target_of(path)
    draft = growing(target)
    _created(draft).close()  # only a trial shows every possible failure
    draft.unlink()
    return target, draft


def growing(target: Path) -> Path:
    """Return a name for the draft of a recording, next to its final name."""
    return target.with_name(f"{target.stem}.{secrets.token_hex(4)}.part{target.suffix}")


def publish(draft: Path, target: Path) -> None:
    """Give a file or a folder of files its name, once all of it is on the disk."""
    files = [path for path in draft.rglob("*") if path.is_file()] if draft.is_dir() else []
    for path in [*files, draft]:
        _flush(path)

    if draft.is_dir() and target.is_dir():
        shutil.rmtree(target)  # a folder that is not empty cannot be replaced
    elif target.exists():
        shutil.copymode(target, draft)
    draft.replace(target)
    _flush(target.parent)


def remove_abandoned(folder: Path) -> None:
    """Remove the hidden drafts in a folder whose processes have died.

    Without locks in the system or the file system, drafts cannot be checked: all stay.
    """
    for draft in folder.glob(DRAFTS):
        with suppress(OSError):  # locked, a folder or another user's: not ours to remove
            number = os.open(draft, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0))
            try:
                if _lock(number):
                    draft.unlink()
            finally:
                os.close(number)


def _locked_draft(folder: Path) -> tuple[Path, BinaryIO, int | None]:
    """Return a new open draft, and the handle that keeps its lock until it has its name."""
    while True:
        draft = folder / DRAFTS.replace("*", secrets.token_hex(8))
        file = _created(draft)
        if fcntl is None:
            return draft, file, None

        # A copy of the descriptor keeps the lock when the file is closed, which may still fail.
        number = os.dup(file.fileno())
        with suppress(BlockingIOError, FileNotFoundError):
            _lock(number)
            draft.stat()
            return draft, file, number

        # `remove_abandoned` deleted it between its creation and its lock.
        file.close()
        os.close(number)


def _lock(number: int) -> bool:
    """Lock an open file until it is closed; return whether there are such locks.

    Raises
    ------
    BlockingIOError
        If another process has locked it.
    """
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except (AttributeError, OSError):  # Windows, or a file system of a network
        return False
    return True


def _created(draft: Path) -> BinaryIO:
    """Open a new file; an error names its folder, the cause, which the caller knows."""
    try:
        return draft.open("xb")
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(draft.parent)) from error


def _flush(path: Path) -> None:
    """Write a file, or the names in a folder, through to the disk."""
    if os.name == "nt" and path.is_dir():
        return  # Windows cannot open a folder

    number = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(number)
    finally:
        os.close(number)

"""Files as the formats need them: opened to be decoded, replaced as a whole or not at all."""

from __future__ import annotations

import errno
import os
import secrets
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Iterator

StrPath: TypeAlias = str | os.PathLike[str]


@contextmanager
def decoding(path: StrPath) -> Iterator[BinaryIO]:
    """Open a file to decode it; what a decoder raises on bad content becomes a ValueError.

    Raises
    ------
    OSError
        If the file cannot be opened or read.
    ValueError
        If the block raised anything else; the message names the file.
    """
    with Path(path).open("rb") as file:
        try:
            yield file
        except (ImportError, MemoryError):
            raise
        except Exception as error:  # decoders of damaged files raise anything, SyntaxError included
            if isinstance(error, OSError) and error.errno is not None:
                raise
            told = isinstance(error, ValueError | OSError)
            reason = error if told else f"damaged, or not what it claims to be ({error!r})"
            raise ValueError(f"{os.fspath(path)}: {reason}") from error


@contextmanager
def replacing(path: StrPath) -> Iterator[BinaryIO]:
    """Open a draft in the file's folder; it takes the file's place when the block ends well.

    Raises
    ------
    OSError
        If the folder does not exist or cannot be written to, or the path is not a regular file.
    """
    target = target_of(path)
    draft = target.with_name(f".{secrets.token_hex(8)}.part")
    try:
        with created(draft) as file:
            yield file
        draft.replace(target)
    finally:
        draft.unlink(missing_ok=True)


def target_of(path: StrPath) -> Path:
    """Return the file that is to be written: a symbolic link stays, what it names is replaced.

    Raises
    ------
    OSError
        If its folder does not exist, or something else than a file has its name.
    """
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "no such folder", str(target.parent))
    if target.exists() and not target.is_file():
        raise OSError(f"{os.fspath(path)} exists and is not a regular file")
    return target


def created(draft: Path) -> BinaryIO:
    """Open a new file; where that fails, its folder is to blame, of which the caller knows."""
    try:
        return draft.open("xb")
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(draft.parent)) from error


def suffix(path: StrPath) -> str:
    """Return the lower-case suffix of a path, with its dot."""
    return Path(path).suffix.lower()

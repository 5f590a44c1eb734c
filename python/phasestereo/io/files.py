"""Files for the formats: checked before they are opened, then opened for decoding."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, TypeAlias

StrPath: TypeAlias = str | os.PathLike[str]


def open_regular(path: StrPath) -> BinaryIO:
    """Open a file for reading if it is regular: a FIFO would block, a device has no end.

    Raises
    ------
    OSError
        If it cannot be opened, or is something else.
    """
    refuse_special(path, Path(path).stat().st_mode)  # some devices act when they are opened
    file = open(path, "rb", opener=_open_without_waiting)  # noqa: SIM115 -- the caller closes it

    # Another file may have taken the name between the two checks.
    try:
        refuse_special(path, os.fstat(file.fileno()).st_mode)
    except BaseException:
        file.close()
        raise

    return file


def _open_without_waiting(name: str, flags: int) -> int:
    """Open a file as `open` would; a FIFO that nobody writes to would block it."""
    return os.open(name, flags | getattr(os, "O_NONBLOCK", 0))


def refuse_special(path: StrPath, mode: int) -> None:
    """Refuse anything but regular files and folders, by the mode from `os.stat`."""
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise OSError(errno.EINVAL, "not a regular file (a FIFO, device or socket)", str(path))


def read_bounded(file: BinaryIO, most: int) -> bytes:
    """Read a small file completely, or refuse it by its size.

    Raises
    ------
    ValueError
        If it is larger than the limit.
    """
    size = os.fstat(file.fileno()).st_size
    if size > most:
        raise ValueError(f"has more than the {most} bytes that such a file is read to")
    return file.read(size)  # which allocates the size it is asked for


def check_head(path: StrPath, head: bytes) -> None:
    """Refuse anything but a regular file with this start, before a library opens it by name.

    Raises
    ------
    OSError
        If it cannot be opened, or is not a regular file.
    ValueError
        If it begins differently.
    """
    with open_regular(path) as file:
        if file.read(len(head)) != head:
            raise ValueError(f"{os.fspath(path)}: does not begin with {head!r}, as its kind does")


@contextmanager
def decoding(path: StrPath) -> Iterator[BinaryIO]:
    """Open a file for decoding; a decoder's error on bad content becomes a ValueError.

    Raises
    ------
    OSError
        If the file cannot be opened or read, or is not a regular file.
    ValueError
        If the block raised anything else; the message names the file.
    """
    with open_regular(path) as file, named(os.fspath(path)):
        yield file


@contextmanager
def named(name: str) -> Iterator[None]:
    """Decode in this block; a decoder's error on bad content becomes a ValueError.

    Raises
    ------
    OSError
        If the system cannot read.
    ValueError
        If a decoder raised anything else, or our code a ValueError; the message begins with the
        name. Other errors of our code are bugs, and pass unchanged.
    """
    try:
        yield
    except ImportError:
        raise
    except MemoryError as error:
        raise ValueError(f"{name}: asks for more memory than there is") from error
    except Exception as error:  # decoders of damaged files raise anything, SyntaxError included
        if is_of_the_system(error) or _is_a_bug(error):
            raise
        is_worded = isinstance(error, ValueError | OSError)  # in terms of the file's content
        reason = error if is_worded else f"damaged, or not what it claims to be ({error!r})"
        raise ValueError(f"{name}: {reason}") from error


def _is_a_bug(error: Exception) -> bool:
    """Return whether our own code raised an error that it never raises on purpose.

    C functions that it calls, such as `struct.unpack`, raise their own kinds of errors there.
    """
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    module = "" if trace is None else trace.tb_frame.f_globals.get("__name__", "")
    bugs = LookupError | TypeError | AttributeError | ZeroDivisionError | AssertionError | NameError
    return module.startswith("phasestereo") and isinstance(error, bugs)


def is_of_the_system(error: Exception) -> bool:
    """Return whether the system refuses a file, rather than a decoder its content.

    For bad content, decoders raise an OSError without a number; and the system answers EINVAL to an
    offset that a file made up.
    """
    return isinstance(error, OSError) and error.errno not in (None, errno.EINVAL)


def describe_error(error: Exception) -> str:
    """Return an error as one line; system errors name their file."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return str(error) or type(error).__name__


def target_of(
    path: StrPath, kind: str = "a regular file", is_kind: Callable[[Path], bool] = Path.is_file
) -> Path:
    """Return the file to write: a symbolic link stays, its target is replaced.

    Parameters
    ----------
    path
        The file.
    kind, is_kind
        What may be replaced under this name: in words, and a test that recognizes it.

    Raises
    ------
    OSError
        If its folder does not exist, or something else has its name.
    """
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "no such folder", str(target.parent))
    if target.exists() and not is_kind(target):
        raise OSError(f"{os.fspath(path)} exists and is not {kind}")
    return target


def suffix(path: StrPath) -> str:
    """Return the lower-case suffix of a path, with its dot."""
    return Path(path).suffix.lower()

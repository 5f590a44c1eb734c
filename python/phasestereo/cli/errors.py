"""What a user can get wrong, as distinguished from what a programmer can."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from phasestereo.io.files import describe_error
from phasestereo.io.image import is_picture

RUN_FAILED = 1
WRONG_USAGE = 2
UNTRUSTED = 3


class CommandError(Exception):
    """Something for the user to fix.

    Parameters
    ----------
    message
        One line: what was wrong, and what would be right.
    code
        The exit code of the process.
    """

    def __init__(self, message: str, code: int = RUN_FAILED) -> None:
        super().__init__(message)
        self.code = code


@contextmanager
def refusals(*, options: Collection[str] = ()) -> Iterator[None]:
    """Turn what the library refuses in this block into a `CommandError`.

    Everything it does not document to raise passes: that is a bug, and shows its traceback.

    Parameters
    ----------
    options
        Arguments, and fields of `Known`, that come from options of the same name. Where a message
        begins with one of them, the command line was wrong, else the run failed.
    """
    try:
        yield
    except (OSError, ValueError, TypeError, MemoryError, RuntimeError, ImportError) as error:
        message = describe_error(error)
        argument, colon, rest = message.removeprefix("known.").partition(":")
        if argument in options:
            raise CommandError(option(argument) + colon + rest, WRONG_USAGE) from error
        raise CommandError(message) from error


def option(argument: str) -> str:
    """Return the command line's spelling of this argument."""
    return "--" + argument.replace("_", "-")


def refuse_picture(argument: str, path: str | Path) -> None:
    """Refuse a picture where a calibration is wanted; its reader refuses what is not a file at all.

    Raises
    ------
    CommandError
        If it is one.
    """
    if Path(path).is_file() and is_picture(path):
        raise CommandError(
            f"{option(argument)}: got {path}, which is a picture; accepts a file of numbers",
            WRONG_USAGE,
        )


def claim(argument: str, path: Path, taken: Iterable[Path | None]) -> None:
    """Refuse to write a file that is read, or that another option writes; make its folder.

    Raises
    ------
    CommandError
        If it is one of these, or its folder cannot be made.
    """
    if any(_is_same(path, other) for other in taken if other):
        raise CommandError(
            f"{option(argument)}: {path} is an input or another output; accepts a file of its own",
            WRONG_USAGE,
        )
    with refusals():
        path.parent.mkdir(parents=True, exist_ok=True)


def _is_same(path: Path, other: Path) -> bool:
    """Return whether two paths name one file; either may not exist yet."""
    if path.exists() and other.exists():
        return path.samefile(other)
    return os.path.realpath(path) == os.path.realpath(other)

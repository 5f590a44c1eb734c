"""What a user can get wrong, told apart from what a programmer can."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from phasestereo.io.image import is_picture

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

RUN_FAILED = 1
WRONG_USAGE = 2
UNTRUSTED = 3


class CommandError(Exception):
    """Something for the user to mend.

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
        Arguments that come from options of the same name. Where a message begins with one of
        them, the command line was wrong, else the run failed.
    """
    try:
        yield
    except (OSError, ValueError, TypeError, MemoryError, RuntimeError, ImportError) as error:
        message = _describe(error)
        argument, colon, rest = message.partition(":")
        if argument in options:
            raise CommandError(option(argument) + colon + rest, WRONG_USAGE) from error
        raise CommandError(message) from error


def option(argument: str) -> str:
    """Return how the command line spells the argument of this name."""
    return "--" + argument.replace("_", "-")


def refuse_picture(argument: str, path: str | Path) -> None:
    """Refuse a picture where a calibration is wanted; what is no file at all is told by its reader.

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


def _describe(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return str(error) or type(error).__name__

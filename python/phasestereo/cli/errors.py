"""Errors that a user can fix, kept apart from a programmer's; and reports that end the run."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType

from phasestereo import _core
from phasestereo.cli.terminal import say
from phasestereo.io.files import describe_error
from phasestereo.io.image import is_picture
from phasestereo.rig.findings import Finding, untrusted

RUN_FAILED = 1
WRONG_USAGE = 2
UNTRUSTED = 3

_LONG = ["num_disparities", "min_disparity", "max_disparity", "min_depth", "max_depth"]
_LONG += ["left_mask", "right_mask"]
_NAMES = "|".join([*_LONG, "vertical", *(setting.name for setting in _core.SETTINGS)])
_ARGUMENT = re.compile(
    rf"(?<![\w./\\'`-])(?:where (?P<absent>{_NAMES}) is None|(?P<flag>{_NAMES})=(?P<on>True|False)|"
    rf"(?P<name>(?=[a-z0-9]+_)(?:{_NAMES})))(?![\w/\\'`-]|\.\w)"
)
"""Arguments of Python in sentences; not in quotes, and not in the names of files."""


class CommandError(Exception):
    """Something for the user to fix.

    Parameters
    ----------
    message
        One line: the mistake, and the accepted values.
    code
        The exit code of the process.
    """

    def __init__(self, message: str, code: int = RUN_FAILED) -> None:
        super().__init__(message)
        self.code = code


@contextmanager
def refusals(
    *,
    options: Collection[str] = (),
    renamed: Mapping[str, str] = MappingProxyType({}),
) -> Iterator[None]:
    """Turn the library's documented errors into a `CommandError` in this block.

    All other errors pass: they are bugs, and show their traceback.

    Parameters
    ----------
    options
        Arguments, and fields of `Known`, that come from options of the same name. If a message
        begins with one of them, the command line was wrong; otherwise the run failed.
    renamed
        The same for arguments that come from options of other names.
    """
    try:
        yield
    except (OSError, ValueError, TypeError, MemoryError, RuntimeError, ImportError) as error:
        message = describe_error(error)
        argument, colon, rest = message.removeprefix("known.").partition(":")
        if argument in options or argument in renamed:
            name = option(renamed.get(argument, argument))
            raise CommandError(name + colon + rest, WRONG_USAGE) from error
        raise CommandError(message) from error


def option(argument: str) -> str:
    """Return the command line's spelling of this argument."""
    return "--" + argument.replace("_", "-")


def spelled(sentence: str) -> str:
    """Return a sentence of the library with the command line's spelling of its arguments."""
    return _ARGUMENT.sub(_spelled, sentence)


def _spelled(found: re.Match[str]) -> str:
    if found["absent"]:
        return f"without {option(found['absent'])}"
    if found["flag"]:
        return option(found["flag"] if found["on"] == "True" else f"no_{found['flag']}")
    return option(found["name"])


def wrong(argument: str, message: str) -> CommandError:
    """Return the error for an argument with a wrong value."""
    return CommandError(f"{option(argument)}: {message}", WRONG_USAGE)


def refuse_picture(argument: str, path: str | Path) -> None:
    """Refuse a picture in place of a calibration; the reader refuses paths that are not files.

    Raises
    ------
    CommandError
        If it is a picture.
    """
    if Path(path).is_file() and is_picture(path):
        raise wrong(argument, f"got {path}, which is a picture; accepts a file of numbers")


def claim(
    targets: Iterable[tuple[str, Path | None]],
    sources: Iterable[Path | None],
    suffixes: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> list[Path]:
    """Return the files to write and make their folders; refuse source files.

    Parameters
    ----------
    targets
        Each with its argument; None: not wanted.
    sources
        The files that are read.
    suffixes
        The accepted suffixes of an argument's file; arguments not listed accept all.

    Raises
    ------
    CommandError
        If one is a source, is given twice or has another suffix, or its folder cannot be made.
    """
    taken = [path for path in sources if path]
    files = [(argument, path) for argument, path in targets if path is not None]
    for argument, path in files:
        if any(_is_same(path, other) for other in taken):
            raise wrong(
                argument, f"{path} is an input or another output; accepts a file of its own"
            )
        accepted = suffixes.get(argument, (path.suffix.lower(),))
        if path.suffix.lower() not in accepted:
            raise wrong(argument, f"got {path}; accepts {', '.join(accepted)}")
        taken.append(path)
        with refusals():
            path.parent.mkdir(parents=True, exist_ok=True)
    return [path for _, path in files]


def _is_same(path: Path, other: Path) -> bool:
    """Return whether two paths name the same file; either may not exist yet."""
    if path.exists() and other.exists():
        return path.samefile(other)
    return os.path.realpath(path) == os.path.realpath(other)


def worded(found: Iterable[Finding]) -> list[str]:
    """Return one line per finding."""
    return [f"{one.severity}: {spelled(one.sentence)}" for one in found]


def show_findings(found: Iterable[Finding]) -> None:
    """Print one line per finding on standard error."""
    for line in worded(found):
        say(line)


def refuse_warnings(found: Iterable[Finding]) -> None:
    """Exit with the code for an untrusted match and the first warning, if there is a warning.

    Raises
    ------
    CommandError
        If there is a warning.
    """
    for one in found:
        if one.severity == "warning":
            raise CommandError(one.sentence, UNTRUSTED)


def refuse_untrusted(found: Iterable[Finding]) -> None:
    """Exit with the code for an untrusted match, if a finding distrusts it.

    Raises
    ------
    CommandError
        If one does.
    """
    grave = untrusted(found)
    if grave:
        raise CommandError("not to be trusted, for what the warnings say", UNTRUSTED)

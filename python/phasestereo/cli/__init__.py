"""The command line: one module per command, and here the code that all of them share.

Exit codes: 0 success, 1 the run failed, 2 the command line was wrong, 3 --strict and an untrusted
match. An error that the user can fix is one line on standard error; any other error is a traceback.
Importing this package needs the extra ``cli``; `phasestereo.__main__` reports when it is missing.
"""

# No `from __future__ import annotations`: cyclopts reads these annotations at run time.

import os
import re
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import entry_points
from typing import Annotated

from cyclopts import App, CycloptsError, Parameter, UnusedCliTokensError

import phasestereo
from phasestereo.cli import match
from phasestereo.cli.errors import WRONG_USAGE, CommandError, spelled
from phasestereo.cli.help import EXPERT, Help
from phasestereo.cli.terminal import print_lines, say

__all__ = ["app", "run"]

_HELP = f"""{phasestereo.__doc__.splitlines()[0]} For example:

```
phasestereo match left.png right.png -o out.pfm
```
"""

_HELP_FORMATTER = Help()

COMMANDS = "phasestereo.cli"
"""The entry point group by which other distributions add commands."""

_LIVE = "'phasestereo[live]' (in a clone: '.[live]' ./python/phasestereo-live)"

OTHERS = {
    "live": (
        "Match every frame of a video, a folder of images, a recording, or a pair of cameras.",
        _LIVE,
    ),
    "calibrate": ("Calibrate two cameras from pictures or a video of a board.", _LIVE),
    "rig": ("Test two cameras while they run.", _LIVE),
    "batch": (
        "Match many pairs, on all processors of this machine or on a Dask cluster.",
        "'phasestereo[batch]' (in a clone: '.[batch]' ./python/phasestereo-large)",
    ),
    "large": (
        "Match a pair larger than memory, from file to file.\n\n"
        "The command reads, matches and writes the pair band by band. After an interruption, the "
        "same command continues.",
        "'phasestereo[large]' (in a clone: '.[large]' ./python/phasestereo-large)",
    ),
    "asp": (
        "Match a tile of the Ames Stereo Pipeline, which calls this command.",
        "'phasestereo[cli,geo]' (in a clone: '.[cli,geo]' ./python/phasestereo-large)",
    ),
    "demo": (
        "Show what one image out of focus does to stereo matching.\n\n"
        "Renders a pair with its true disparities, degrades the left image (defocus, contrast, "
        "noise), and matches the sharp and the degraded pair by phase codes, SAD and normalized "
        "SAD, and by OpenCV's StereoSGBM. Takes a few seconds.",
        "./benches/harness (in a clone)",
    ),
    "bench": (
        "Score matchers, and repeat the paper's experiments.",
        "./benches/harness (in a clone)",
    ),
}
"""Commands of our other distributions: their help, readable without an import, and the
requirement that pip installs."""

OURS = {
    "check": (
        "phasestereo.cli.check:check",
        "Diagnose a stereo pair: what keeps it from being matched well.\n\n"
        "The exit code is 0 whatever is found, unless --strict is given.",
    ),
    "verify": (
        "phasestereo.cli.verify:verify",
        "Judge a disparity map of any origin by the images that it is of.",
    ),
    "prepare": (
        "phasestereo.cli.prepare:prepare",
        "Prepare a pair for another matcher: rectified, rows aligned, equally sharp and bright.",
    ),
    "restore": (
        "phasestereo.cli.prepare:restore",
        "Bring a map of a prepared pair back into the left image as it came.",
    ),
    "rectify": (
        "phasestereo.cli.rectify:rectify",
        "Rectify a stereo pair, by a calibration or from the images alone.",
    ),
    "doctor": (
        "phasestereo.cli.doctor:doctor",
        "Say what is installed here, how fast it is, and whether its results are right.",
    ),
    "try": (
        "phasestereo.cli.trying:try_it",
        "Match a pair that is made here, its left image out of focus, and open the page of it.",
    ),
}
"""The commands imported only when called: their modules and their help."""

app = App(
    name="phasestereo",
    help=_HELP,
    version=phasestereo.__version__,
    help_format="markdown",
    help_formatter=_HELP_FORMATTER,
    default_parameter=Parameter(negative_iterable=()),
)
app.command(match.match)
for _name, (_place, _text) in OURS.items():
    # Imported only when called, so that the other commands start fast.
    app.command(_place, name=_name, help=_text)


def _missing(requirement: str) -> Callable[..., None]:
    """Return a command that refuses any arguments and names the requirement to install."""

    def refuse(*_: Annotated[str, Parameter(allow_leading_hyphen=True, show=False)]) -> None:
        raise CommandError(
            f"this command is not installed; it comes with: pip install {requirement}"
        )

    return refuse


_HOME = re.compile(r"(--[\w-]+=)?(~/.*)", re.DOTALL)
"""A path that shells leave as it is behind an equals sign, and that would make a folder ``~``."""


def _add_commands_of_others() -> None:
    """Add the entry points of other distributions, and placeholders for ours not installed."""
    found = {point.name: point.value for point in entry_points(group=COMMANDS)}
    for name in OTHERS | found:
        text, requirement = OTHERS.get(name, (None, ""))
        if name in found:
            app.command(found[name], name=name, help=text)
        else:
            note = f"{text}\n\nNot installed; it comes with: pip install {requirement}"
            app.command(_missing(requirement), name=name, help=note)


_add_commands_of_others()


def run(arguments: Sequence[str]) -> int:
    """Run one command; return its exit code.

    Parameters
    ----------
    arguments
        The words after the program's name on the command line.
    """
    # Closed, as by >&-, they are None, and the next file would get what C writes there.
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: PTH123, SIM115 - not closed
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: PTH123, SIM115
    try:
        _execute(arguments)
        sys.stdout.flush()
    except UnusedCliTokensError as error:
        words = " ".join(error.unused_tokens or ())
        return _refuse(CommandError(f"unknown arguments: {words}", WRONG_USAGE))
    except CycloptsError as error:
        return _refuse(CommandError(str(error), WRONG_USAGE))
    except CommandError as error:
        return _refuse(error)
    except OSError as error:
        if not _is_output_broken():
            raise
        # Nothing is left to flush at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            return 1  # the reader has closed the pipe, as `| head` does
        return _refuse(CommandError(f"standard output: {error.strerror}"))
    return 0


def _is_output_broken() -> bool:
    """Return whether standard output refuses another line, as on a full disk."""
    try:
        sys.stdout.write("\n")
        sys.stdout.flush()
    except OSError:
        return True
    return False


def _execute(arguments: Sequence[str]) -> None:
    _HELP_FORMATTER.whole, _HELP_FORMATTER.left_out = EXPERT in arguments, 0
    arguments = ["--help" if word == EXPERT else _at_home(word) for word in arguments]
    command, bound, _ = app.parse_args(arguments, exit_on_error=False, print_error=False)
    command(*bound.args, **bound.kwargs)
    if _HELP_FORMATTER.left_out:
        print_lines([f"{EXPERT} shows {_HELP_FORMATTER.left_out} more options, and all of these."])


def _at_home(word: str) -> str:
    """Return a word of the command line with the home folder in the place of ~."""
    found = _HOME.fullmatch(word)
    return f"{found[1] or ''}{os.path.expanduser(found[2])}" if found else word  # noqa: PTH111 - as it came


def _refuse(error: CommandError) -> int:
    say("error: " + spelled(" ".join(str(error).split())))
    return error.code

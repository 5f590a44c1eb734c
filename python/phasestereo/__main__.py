"""The command ``phasestereo``: starts the command line, or prints how to install it."""

from __future__ import annotations

import sys

from phasestereo._extras import require

INTERRUPTED = 130  # what shells report for a command ended by Ctrl-C


def main() -> int:
    """Run the command line on the arguments of the process; return its exit code.

    Returns
    -------
    int
        0 success, 1 the run failed, 2 the command line was wrong, 130 Ctrl-C.
    """
    try:
        return _start()
    except KeyboardInterrupt:
        sys.stderr.write("phasestereo: interrupted\n")
        return INTERRUPTED


def _start() -> int:
    """Import the command line, which needs the extra ``cli``, and run it."""
    try:
        for module in ("cyclopts", "rich"):
            require(module, extra="cli")
    except ImportError as error:
        sys.stderr.write(f"phasestereo: error: {error}\n")
        return 1

    from phasestereo.cli import run  # noqa: PLC0415 - it needs the extra

    return run(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())

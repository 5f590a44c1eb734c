"""Runs programs as methods: two PNG files and the number of disparities in, a PFM file out."""

import shlex
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from phasestereo.io import read_disparity, write_image
from phasestereo_bench.arrays import Image, Map

PLACES = ("{left}", "{right}", "{num_disparities}", "{output}")
"""The placeholders of a command line: the files and the number of disparities."""


def match_program(left: Image, right: Image, num_disparities: int, *, command: str) -> Map:
    """Match with a program, which starts again for every pair.

    Parameters
    ----------
    command
        Its command line with `PLACES`, split as a shell does, but run without one.

    Raises
    ------
    OSError
        If it cannot start, or has written nothing.
    ValueError
        If it fails, or its output is not a disparity map.
    """
    with TemporaryDirectory() as folder:
        root = Path(folder)
        write_image(root / "left.png", left)
        write_image(root / "right.png", right)

        values = (root / "left.png", root / "right.png", num_disparities, root / "output.pfm")
        words = [_filled(word, values) for word in shlex.split(command)]

        done = subprocess.run(words, capture_output=True, text=True, check=False)  # noqa: S603 - named by the user
        if done.returncode != 0:
            last = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
            raise ValueError(f"{words[0]}: exit code {done.returncode}: {last}")

        return read_disparity(root / "output.pfm")


def require_places(command: str) -> None:
    """Refuse a command line without a place for the files.

    Raises
    ------
    ValueError
        If one is missing.
    """
    missing = [place for place in PLACES if place not in command and place != "{num_disparities}"]
    if missing:
        raise ValueError(f"method: got program:{command}, without {' and '.join(missing)}")


def _filled(word: str, values: tuple[object, ...]) -> str:
    for place, value in zip(PLACES, values, strict=True):
        word = word.replace(place, str(value))
    return word

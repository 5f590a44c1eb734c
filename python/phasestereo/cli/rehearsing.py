"""Trials of the files to write, before the work: each is written as a draft and removed."""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from phasestereo.cli.errors import WRONG_USAGE, CommandError, option, refusals
from phasestereo.io.image import write_image


def rehearse(argument: str, path: Path, write: Callable[..., None], *content: object) -> None:
    """Write a draft next to the file and remove it: only a trial shows every possible failure.

    Raises
    ------
    CommandError
        If the file is a folder, or `write` refuses the draft.
    """
    target = Path(os.path.realpath(path))  # a symbolic link stays; its target is replaced
    if target.is_dir():
        raise CommandError(f"{option(argument)}: {path} is a folder")

    draft = target.with_name(f".{secrets.token_hex(8)}{path.suffix}")
    with refusals():
        try:
            write(draft, *content)
        except ValueError as error:
            raise CommandError(f"{option(argument)}: {error}", WRONG_USAGE) from error
        finally:
            draft.unlink(missing_ok=True)


def rehearse_images(
    argument: str, paths: Iterable[Path] | None, like: Iterable[NDArray[Any]]
) -> None:
    """Rehearse image files for colors in the types of these images; None: no files.

    Raises
    ------
    CommandError
        As `rehearse`.
    """
    for path, image in zip(paths or (), like, strict=False):
        rehearse(argument, path, write_image, image[:1, :1][..., :3])

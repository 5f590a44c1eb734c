"""Files that grow while they are written: under a name of their own until they are complete."""

from __future__ import annotations

import os
import secrets
from collections.abc import Sequence
from pathlib import Path

from phasestereo.io.files import StrPath, created, suffix, target_of


def draft_of(path: StrPath, suffixes: Sequence[str], what: str) -> tuple[Path, Path]:
    """Return the file that a path names, and the draft beside it, which does not exist yet.

    Raises
    ------
    OSError
        If its folder does not exist or cannot be written to, or it is no file.
    ValueError
        If it does not end in one of the suffixes; ``what`` says what is written.
    """
    if suffix(path) not in suffixes:
        raise ValueError(
            f"path of a {what} must end in {' or '.join(suffixes)}, got {os.fspath(path)!r}"
        )

    target = target_of(path)
    draft = target.with_name(f"{target.stem}.{secrets.token_hex(4)}.part{target.suffix}")
    created(draft).close()  # only trying shows all that can go wrong
    draft.unlink()
    return target, draft

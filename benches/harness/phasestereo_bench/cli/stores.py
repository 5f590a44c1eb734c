"""Files of records that a run finds where it is to write its own."""

from __future__ import annotations

from itertools import count
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path


def put_aside(output: Path) -> Path:
    """Rename an earlier file to a name that no file has, and return that."""
    names = (output.with_name(f"{output.name}.bak{number or ''}") for number in count())
    aside = next(name for name in names if not name.exists())
    output.rename(aside)
    return aside
